from __future__ import annotations

from benchmarks.results import score
from benchmarks.tables import leaderboard_table, table


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


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("|")[1:-1]]


def test_the_papers_table_is_written_as_it_always_was(make_result):
    results = [
        make_result(bev=bev, town=town, driven_m=metres)
        for bev, metres in (("ground_truth", 100.0), ("ipm", 60.0))
        for town in ("Town01", "Town02")
    ]
    assert table(score(results)).splitlines() == [
        "| BEV source   | Agent  | Town01 route (m) | Infrac. | Clean "
        "| Town02 route (m) | Infrac. | Clean |",
        "| ------------ | ------ | ---------------: | ------: | ----: "
        "| ---------------: | ------: | ----: |",
        "| *planned*    |        |            *100* |         |       "
        "|            *100* |         |       |",
        "| ground_truth | expert |              100 |     0/1 |   1/1 "
        "|              100 |     0/1 |   1/1 |",
        "| ipm          | expert |               60 |     0/1 |   1/1 "
        "|               60 |     0/1 |   1/1 |",
    ]


def test_the_leaderboards_table_has_a_row_a_town_with_scores_and_counts(make_result, make_event):
    events = [
        make_event("collision_pedestrian"),
        make_event("collision_vehicle"),
        make_event("collision_vehicle", "other"),
        make_event("collision_static"),
        make_event("red_light"),
        make_event("off_road"),
        make_event("route_deviation"),
    ]
    results = [
        make_result(index=0),
        make_result(index=1, success=False, truncated=True, driven_m=50.0),
        make_result(town="Town02", success=False, driven_m=80.0, events=events, outside_m=25.0),
        make_result(town="Town02", index=1, success=False, driven_m=0.0, travelled_m=0.0),
    ]
    lines = leaderboard_table(score(results)).splitlines()
    assert ",".join(cells(lines[0])) == (
        "BEV source,Agent,Town,DS 2.1,DS 1.0,Route %,Penalty,"
        "Ped.,Vehicle,Static,Red,Deviation,Blocked,Timeout"
    )
    town01, town02 = (",".join(cells(line)) for line in lines[2:])
    assert town01 == "ground_truth,expert,Town01,75.0,75.0,75.0,1.000,0,0,0,0,0,0,1"
    # 2.1: 80 * 0.75 / 3.7 = 16.2 and 0; 1.0: 80 * 0.75 * 0.5 * 0.6 * 0.65 * 0.7 = 8.2 and 0;
    # penalties: 0.75 / 3.7 = 0.203 and 1
    assert town02 == "ground_truth,expert,Town02,8.1,4.1,40.0,0.601,1,1,1,1,1,0,0"
    assert len({len(line) for line in lines}) == 1


def test_names_stand_to_the_left_and_figures_to_the_right_in_the_leaderboards_table(make_result):
    rule = leaderboard_table(score([make_result()])).splitlines()[1]
    assert [cell.endswith(":") for cell in cells(rule)] == [False] * 3 + [True] * 11
