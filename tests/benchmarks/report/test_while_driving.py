from __future__ import annotations

import re

import pytest

from benchmarks.report.while_driving import iou_against_metres, iou_table, places_table


def test_iou_is_pooled_over_drives_and_averaged_over_the_three_static_channels(
    make_result, make_online
):
    results = [
        make_result(bev="cvt", online=make_online(0.9, 0.6, 0.3, union=1000)),
        make_result(bev="cvt", index=1, online=make_online(0.5, 0.6, 0.3, union=3000)),
        make_result(bev="ground_truth"),
    ]
    table = iou_table(results)
    (row,) = table.rows
    # (900 + 1500) / 4000
    values = [0.6, 0.6, 0.3, 0.5]
    assert [cell.value for cell in row[1:5]] == pytest.approx(values)
    assert [cell.text for cell in row[5:]] == ["0.935", "0.788", "0.332", "0.685"]
    low, high = row[1].interval
    assert (low, high) == pytest.approx((0.5, 0.9))
    assert row[4].interval == pytest.approx((1.4 / 3.0, 1.8 / 3.0))


def test_sources_that_were_not_looked_at_have_no_row(make_result, make_online):
    results = [make_result(), make_result(bev="ipm", online=make_online(0.5, 0.5, 0.5))]
    assert [row[0].value for row in iou_table(results).rows] == ["ipm"]
    assert [row[0].value for row in places_table(results).rows] == ["ipm"]


def test_a_predictor_without_lanes_has_no_mean(make_result, make_online):
    (row,) = iou_table([make_result(bev="ipm", online=make_online(0.5, 0.5))]).rows
    assert [cell.text for cell in row[1:5]] == ["0.500", "0.500", "\u2013", "\u2013"]
    assert row[4].range_text == ""


def test_divergence_is_the_median_over_moments(make_result, make_online):
    (row,) = places_table([make_result(bev="ipm", online=make_online(0.5, nats=2.0))]).rows
    assert row[5].value == pytest.approx(2.0, rel=0.3)


def test_marks_stand_for_drivers_in_towns_and_keep_the_colours_of_the_maps(
    make_result, make_online
):
    results = [
        make_result(bev="ground_truth"),
        make_result(bev="ipm", driven_m=50.0, online=make_online(0.8, 0.6, 0.4)),
        make_result(bev="ipm", town="Town02", driven_m=25.0, online=make_online(0.5, 0.5, 0.5)),
    ]
    figure = iou_against_metres(results)
    titles = re.findall(r"<title>(.*?)</title>", figure.picture)
    assert titles == [
        "ipm, Town01: IoU 0.600, 50 % of the route",
        "ipm, Town02: IoU 0.500, 25 % of the route",
    ]
    # the second of the drivers, in Okabe and Ito's palette
    assert set(re.findall(r'fill="(#\w+)"', figure.picture)) == {"#d55e00"}
    assert "Town01 circles, Town02 squares" in figure.caption


def test_without_any_measurement_there_is_no_chart(make_result):
    assert iou_against_metres([make_result()]) is None
