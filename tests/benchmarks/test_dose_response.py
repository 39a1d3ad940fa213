from __future__ import annotations

import io
import json
from dataclasses import replace

import pytest
from PIL import Image

from benchmarks.dose_response import Curve, Response, curves, dose_table, draw_curves
from benchmarks.report.suite_sections import dose_figures, look_table


@pytest.fixture
def results(make_result):
    driven = {"ipm": 100.0, "ipm~shift=0.5": 60.0, "ipm~shift=0.1": 80.0, "ipm~ghosts=1": 20.0}
    return [
        make_result(bev=bev, town=town, driven_m=metres, success=metres > 70.0)
        for bev, metres in driven.items()
        for town in ("Town01", "Town02")
    ]


def test_a_curve_starts_at_the_source_as_it_is_and_rises_in_dose(results):
    shift, ghosts = curves(results)
    assert shift == Curve(
        *("ipm", "expert", "shift"),
        (Response(0.0, 1.0, 2, 2), Response(0.1, 0.8, 2, 2), Response(0.5, 0.6, 0, 2)),
    )
    assert [each.dose for each in ghosts.responses] == [0.0, 1.0]


def test_other_corruptions_than_of_one_model_make_no_curve(make_result):
    bevs = ("ipm~shift=0.5,ghosts=1", "ipm~shift=0.5@route", "ipm|route=ground_truth")
    assert curves([make_result(bev=bev) for bev in bevs]) == []


def test_the_table_has_a_row_an_error_model_and_a_column_a_dose(results):
    lines = dose_table(curves(results)).splitlines()
    table = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    names = ["BEV source", "Agent", "Error model"]
    assert table[0] == [*names, "dose 0", "dose 0.1", "dose 0.5", "dose 1"]
    assert table[2] == ["ipm", "expert", "shift", "100 % (2/2)", "80 % (2/2)", "60 % (0/2)", ""]
    assert table[3] == ["ipm", "expert", "ghosts", "100 % (2/2)", "", "", "20 % (0/2)"]


def test_the_picture_says_where_it_comes_from(results):
    with Image.open(io.BytesIO(draw_curves(curves(results), {"seeds": [0]}))) as image:
        assert json.loads(image.text["provenance"]) == {"seeds": [0]}
        assert min(image.size) > 300


def test_the_report_draws_curves_of_at_least_two_doses(results):
    figures = dose_figures(results)
    assert len(figures) == 2
    for figure in figures:
        assert figure.picture.count("<polyline") == 1  # shift; ghosts has a single dose
        assert figure.picture.count("<circle") == 3
    assert "shift, 0.1: 80" in figures[0].picture
    assert dose_figures(results[:2]) == []


def test_the_report_has_a_table_of_looks_if_a_town_had_several(make_result):
    results = [
        replace(made, job=replace(made.job, appearance=look))
        for look in ("train", "hard:night")
        for made in (make_result(), make_result(town="Town02"))
    ]
    table = look_table(results)
    assert [row[2].text for row in table.rows] == ["train", "hard:night"]
    assert look_table(results[:2]) is None
