from __future__ import annotations

import csv
import io
import json

import pytest

from benchmarks.results import as_csv, as_json, score
from benchmarks.suites import Conditions
from bev_driving_env.world.infractions import INFRACTIONS


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


def test_driving_scores_and_completion_are_means_over_episodes(make_result, make_event):
    red = make_event("red_light")
    results = [
        make_result(index=0),
        make_result(index=1, success=False, driven_m=50.0, events=[red, red]),
    ]
    (entry,) = score(results)
    # 100 and 50 * 0.7 * 0.7; 100 and 50 / (1 + 2 * 0.4)
    assert entry.driving_score_1_0 == pytest.approx((100.0 + 24.5) / 2)
    assert entry.driving_score_2_1 == pytest.approx((100.0 + 50.0 / 1.8) / 2)
    assert entry.route_completion_pct == pytest.approx(75.0)
    assert entry.penalty_2_1 == pytest.approx((1.0 + 1.0 / 1.8) / 2)


def test_infractions_are_counted_by_kind_and_per_kilometre_driven(make_result, make_event):
    results = [
        make_result(
            travelled_m=400.0,
            outside_m=40.0,
            events=[make_event("red_light"), make_event("collision_vehicle", "other")],
        ),
        make_result(index=1, seed=1, travelled_m=100.0, events=[make_event("red_light")]),
        make_result(index=2, success=False, travelled_m=0.0, truncated=True),
    ]
    (entry,) = score(results)
    assert entry.infractions == {**dict.fromkeys(INFRACTIONS, 0), "red_light": 2}
    assert entry.infractions_per_km["red_light"] == pytest.approx(4.0)
    assert entry.travelled_km == pytest.approx(0.5)
    assert entry.outside_pct == pytest.approx(8.0)
    assert entry.timeouts == 1


def test_where_nothing_was_driven_infractions_per_kilometre_stay_finite(make_result, make_event):
    (entry,) = score([make_result(travelled_m=0.0, events=[make_event("blocked")])])
    assert entry.infractions_per_km["blocked"] == pytest.approx(1000.0)
    assert entry.infractions_per_km["red_light"] == 0.0
    assert entry.outside_pct == 0.0


def test_rows_hold_traffic_driving_scores_and_counts_and_json_the_events(make_result, make_event):
    events = [
        make_event("collision_static"),
        make_event("collision_vehicle", "other", actor="vehicle 12"),
    ]
    conditions = Conditions(traffic="dense", traffic_lights=True)
    result = make_result(conditions=conditions, events=events, outside_m=10.0)
    lines = as_csv([result], {}).splitlines()
    (row,) = csv.DictReader(lines)
    assert (row["traffic"], row["traffic_lights"]) == ("dense", "True")
    assert (row["driving_score_1_0"], row["driving_score_2_1"]) == ("58.5", "56.25")
    assert (row["travelled_m"], row["outside_m"]) == ("100.0", "10.0")
    assert (row["collision_static"], row["collision_vehicle"], row["red_light"]) == ("1", "0", "0")
    (episode,) = as_json([result], {})["episodes"]
    assert episode["events"] == events
    assert episode["driving_score_2_1"] == 56.25
