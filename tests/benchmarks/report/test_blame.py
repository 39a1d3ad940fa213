from __future__ import annotations

from benchmarks.report.blame import lost_metres, rescues_table


def job(bev: str, town: str = "Town01", index: int = 0) -> dict[str, object]:
    return {"bev": bev, "agent": "bc", "town": town, "index": index}


def test_costs_are_summed_by_source_and_town_and_add_up_to_the_loss():
    table, figure = lost_metres(
        [
            {"job": job("blind"), "cost_m": {"road": 5.0, "route": 40.0}},
            {"job": job("blind", index=1), "cost_m": {"road": -8.0, "route": 30.0}},
            {"job": job("blind", "Town02"), "cost_m": {"road": 1.0, "route": 2.0}},
        ]
    )
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["blind", "Town01", "67", "-3", "70"],
        ["blind", "Town02", "3", "1", "2"],
    ]
    assert "blind, Town01: 67 m" in figure.picture


def test_the_point_of_no_return_is_the_last_moment_from_which_a_channel_saves_the_drive():
    rescue = {"job": job("blind"), "failure": "off_road", "failure_step": 76, "failure_m": 30.0}
    lost = {"step": 70, "route_m": 28.0, "saved_by": []}
    saved = {"step": 65, "route_m": 25.5, "saved_by": ["route", "lane"]}
    table = rescues_table([{**rescue, "attempts": [lost, saved]}, {**rescue, "attempts": [lost]}])
    assert [[cell.text for cell in row[2:]] for row in table.rows] == [
        ["off road", "route, lane", "30", "4.5"],
        ["off road", "no channel alone", "30", "\u2013"],
    ]
