from __future__ import annotations

import pytest

from benchmarks.report.closed_loop import (
    broken_table,
    leaderboard_table,
    route_table,
    trajectory_figures,
)
from benchmarks.report.table import Cell, Table


def cell(table: Table, row: str, group: str, name: str) -> Cell:
    """The cell of a row in a column."""
    (k,) = (k for k, c in enumerate(table.columns) if (c.group, c.name) == (group, name))
    (found,) = (cells[k] for cells in table.rows if cells[0].value == row)
    return found


def test_the_papers_table_has_its_columns_by_town_and_its_own_figures_beside(make_result):
    results = [
        make_result(bev=bev, town=town, index=index, driven_m=metres, planned_m=120.0)
        for bev, metres in (("ground_truth", 119.0), ("cvt_kde", 60.0))
        for town in ("Town01", "Town02")
        for index in range(5)
    ]
    table = route_table(results)
    assert [column.group for column in table.columns if column.elsewhere] == [
        *["Paper, CARLA's Town01"] * 2,
        *["Paper, CARLA's Town02"] * 2,
    ]
    assert "another world" in table.caption
    name = "cvt_kde (CVT 6ch. KDE)"
    assert cell(table, name, "Town01", "Route (m)").text == "300"
    assert cell(table, name, "Town01", "Infrac.").text == "0/5"
    assert cell(table, name, "Paper, CARLA's Town01", "Route (m)").text == "261"
    assert cell(table, name, "Paper, CARLA's Town02", "Infrac.").text == "5/5"
    assert cell(table, "Whole route", "Town02", "Route (m)").text == "600"


def test_intervals_are_of_sums_over_a_towns_episodes(make_result):
    metres = [20.0, 100.0, 60.0, 40.0, 80.0]
    table = route_table([make_result(index=k, driven_m=m) for k, m in enumerate(metres)])
    low, high = cell(table, "ground_truth", "Town01", "Route (m)").interval
    # 5 times mean -/+ 1.96 standard errors of it (population, as the bootstrap has it)
    assert (low, high) == pytest.approx((300.0 - 124.0, 300.0 + 124.0), abs=20.0)


def test_how_long_the_routes_are_is_no_uncertainty(make_result):
    planned = [20.0, 100.0, 60.0, 400.0, 80.0]
    drives = [make_result(index=k, driven_m=0.99 * m, planned_m=m) for k, m in enumerate(planned)]
    interval = cell(route_table(drives), "ground_truth", "Town01", "Route (m)").interval
    assert interval == pytest.approx((0.99 * 660.0, 0.99 * 660.0))


def test_routes_that_the_paper_did_not_drive_have_no_figures_of_its(make_result):
    results = [make_result(bev="cvt_kde")]
    job = results[0].job
    other = type(results[0])(
        **{**vars(results[0]), "job": type(job)(**{**vars(job), "routes": "test"})}
    )
    assert any(column.elsewhere for column in route_table(results).columns)
    table = route_table([other])
    assert not any(column.elsewhere for column in table.columns)
    assert "paper" not in table.caption


def test_the_farthest_is_bold_and_the_truth_is_no_competitor(make_result):
    results = [
        make_result(bev=bev, driven_m=metres)
        for bev, metres in (("ground_truth", 100.0), ("ipm", 60.0), ("blind", 40.0))
    ]
    table = route_table(results)
    bold = [row[0].value for row in table.rows if row[1].best]
    assert bold == ["ipm"]


def test_those_that_reached_the_end_share_the_first_place(make_result):
    results = [
        make_result(bev=bev, driven_m=metres)
        for bev, metres in (("cvt", 99.4), ("ipm", 98.6), ("unet", 98.2))
    ]
    bold = [row[0].value for row in route_table(results).rows if row[1].best]
    assert [str(name).split()[0] for name in bold] == ["cvt", "ipm"]


def test_a_source_that_was_not_driven_in_a_town_has_dashes_there(make_result):
    table = route_table([make_result(), make_result(bev="ipm", town="Town02")])
    assert cell(table, "ipm", "Town01", "Route (m)").text == "\u2013"
    assert cell(table, "ipm", "Town02", "Route (m)").text == "100"


def test_agents_are_named_where_there_are_several(make_result):
    table = route_table([make_result(agent="bc"), make_result(agent="expert")])
    assert [row[0].value for row in table.rows[1:]] == ["ground_truth, bc", "ground_truth, expert"]


def test_the_leaderboards_table_has_a_row_a_town(make_result):
    table = leaderboard_table([make_result(), make_result(town="Town02", driven_m=50.0)])
    assert [row[2].text for row in table.rows] == ["Town01", "Town02"]
    assert table.columns[3].name == "DS 2.1"


def test_drives_that_broke_are_listed_with_what_was_raised(make_result):
    assert broken_table([make_result()]) is None
    table = broken_table([make_result(), make_result(index=3, error="...", failure="E: <no>")])
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["ground_truth", "expert", "Town01 3, seed 0", "E: <no>"]
    ]


def test_each_town_has_a_map_with_all_drivers_in_its_legend(make_result):
    results = [make_result(), make_result(bev="ipm"), make_result(town="Town02")]
    figures = trajectory_figures(results, {"command": "bev-bench run"})
    assert [figure.file for figure in figures] == ["map_Town01.png", "map_Town02.png"]
    for figure in figures:
        assert "ground_truth" in figure.picture
        assert "ipm" in figure.picture


def test_a_map_of_too_many_drivers_shows_those_without_error_models(make_result):
    doses = [f"ipm~shift=0.{k}" for k in range(1, 10)]
    few = [make_result(bev=bev) for bev in ("ipm", *doses)]
    many = [*few, make_result(bev="ipm~shift=1")]
    (figure,) = trajectory_figures(few, {})
    assert "ipm~shift=0.3" in figure.picture
    assert "left out" not in figure.caption
    (figure,) = trajectory_figures(many, {})
    assert "ipm~shift=0.3" not in figure.picture
    assert "ipm" in figure.picture
    assert "left out" in figure.caption
    (figure,) = trajectory_figures([*many[1:], make_result(bev="ipm~shift=0.95")], {})
    assert "ipm~shift=0.3" in figure.picture
