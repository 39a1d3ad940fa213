from __future__ import annotations

import csv
import io
import json

from benchmarks.results import as_csv, as_json, score, table


def test_scores_sum_metres_over_episodes_and_average_them_over_seeds(make_result):
    results = [
        make_result(index=0, seed=0, driven_m=100.0),
        make_result(index=1, seed=0, driven_m=50.0, infraction="off_road", infractions=2),
        make_result(index=0, seed=1, driven_m=90.0),
        make_result(index=1, seed=1, driven_m=80.0, success=False, truncated=True),
    ]
    (entry,) = score(results)
    assert entry.seeds == 2
    assert entry.episodes == 4
    assert entry.planned_m == 200.0
    assert entry.route_m == 160.0
    assert entry.infracted == 1
    assert entry.clean == 2


def test_sources_and_agents_and_towns_are_scored_apart(make_result):
    results = [
        make_result(bev=bev, agent=agent, town=town)
        for bev in ("ground_truth", "ipm")
        for agent in ("expert", "other")
        for town in ("Town01", "Town02")
    ]
    assert len(score(results)) == 8


def test_table_has_the_papers_columns_for_each_town(make_result):
    text = table(
        score(
            [
                make_result(town="Town01", driven_m=598.0, planned_m=598.0),
                make_result(
                    town="Town02",
                    driven_m=106.4,
                    planned_m=604.0,
                    success=False,
                    infraction="off_road",
                    infractions=1,
                ),
            ]
        )
    )
    header, _, planned, row = text.splitlines()
    assert header.count("route (m)") == 2
    assert [cell.strip() for cell in planned.split("|")[3:10:3]] == ["*598*", "*604*", ""]
    assert [cell.strip() for cell in row.split("|")[1:-1]] == [
        "ground_truth",
        "expert",
        "598",
        "0/1",
        "1/1",
        "106",
        "1/1",
        "0/1",
    ]
    assert len({len(line) for line in text.splitlines()}) == 1


def test_csv_has_provenance_above_and_one_parsable_line_an_episode(make_result):
    note = {"command": "bev-bench run", "seeds": [0]}
    results = [
        make_result(
            infraction="off_road",
            infractions=1,
            infraction_m=12.3456,
            infraction_pose=(1.0, 2.0, 0.5),
        ),
        make_result(index=1, error="Traceback\n ...", failure='ValueError: "no", really'),
    ]
    text = as_csv(results, note)
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments == ["# command: bev-bench run", "# seeds: [0]"]
    rows = list(csv.DictReader(io.StringIO("\n".join(text.splitlines()[2:]))))
    assert [row["infraction"] for row in rows] == ["off_road", ""]
    assert rows[0]["infraction_m"] == "12.346"
    assert (rows[0]["infraction_x"], rows[0]["infraction_y"]) == ("1.0", "2.0")
    assert rows[1]["failure"] == 'ValueError: "no", really'
    assert rows[0]["seed"] == "0"


def test_json_keeps_the_whole_traceback_and_survives_a_round_trip(make_result):
    note = {"command": "bev-bench run"}
    content = as_json([make_result(error="line 1\nline 2")], note)
    assert json.loads(json.dumps(content)) == content
    assert content["provenance"] == note
    assert content["episodes"][0]["error"] == "line 1\nline 2"
    assert content["scores"][0]["route_m"] == 99.5
