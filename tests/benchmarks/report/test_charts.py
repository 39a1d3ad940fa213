from __future__ import annotations

import re

import pytest

from benchmarks.report import axes, charts
from benchmarks.report.axes import Axes, ticks
from benchmarks.report.charts import Point, colour_of, scatter, stacked_bars


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 97.0, [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]),
        (0.83, 0.91, [0.82, 0.84, 0.86, 0.88, 0.90, 0.92]),
        (-12.0, 31.0, [-20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0]),
        (0.4, 0.4, [-0.2, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
    ],
)
def test_ticks_are_round_and_cover_the_range(low, high, expected):
    assert ticks(low, high) == pytest.approx(expected)


@pytest.mark.parametrize("high", [1e-4, 0.7, 3.0, 99.9, 1e6])
def test_there_are_never_many_ticks(high):
    made = ticks(0.0, high)
    assert 3 <= len(made) <= 7
    assert made[0] == 0.0
    assert made[-1] >= high


def test_the_corners_of_the_axes_lie_at_the_margins():
    frame = Axes([0.0, 0.5, 1.0], [0.0, 100.0])
    right, bottom = axes.WIDTH - axes.RIGHT, axes.HEIGHT - axes.BOTTOM
    assert frame.place(0.0, 0.0) == (axes.LEFT, bottom)
    assert frame.place(1.0, 100.0) == (right, axes.TOP)
    assert frame.place(0.25, 50.0) == pytest.approx(
        (axes.LEFT + (right - axes.LEFT) / 4, (axes.TOP + bottom) / 2)
    )


def test_marks_lie_where_their_values_are_and_carry_their_titles():
    points = [
        Point(0.0, 0.0, "a", "at zero", 0),
        Point(0.6, 100.0, "b", "at the <top>", 1),
    ]
    made = scatter(points, "x", "y")
    circles = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="6" fill="(#\w+)">', made)
    right, bottom = axes.WIDTH - axes.RIGHT, axes.HEIGHT - axes.BOTTOM
    # ticks of both axes end at the largest values
    assert circles == [
        (f"{axes.LEFT:.1f}", f"{bottom:.1f}", colour_of(0)),
        (f"{right:.1f}", f"{axes.TOP:.1f}", colour_of(1)),
    ]
    assert "<title>at the &lt;top&gt;</title>" in made


@pytest.mark.parametrize("shape", charts.SHAPES)
def test_every_shape_can_be_drawn(shape):
    made = scatter([Point(0.5, 1.0, "a", "t", 0, shape)], "x", "y")
    assert made.count("<title>t</title>") == 1


def bars(made: str) -> list[tuple[float, float]]:
    """Left and right ends of the bars' parts."""
    found = re.findall(r'<rect x="([-\d.]+)" y="[\d.]+" width="([\d.]+)"', made)
    return [(float(x), float(x) + float(width)) for x, width in found]


def test_parts_of_a_bar_follow_each_other_and_negative_ones_lie_left_of_zero():
    made = stacked_bars({"a": {"p": 30.0, "q": -20.0, "r": 50.0}}, ["p", "q", "r"], "m")
    # ticks from -20 to 80 over the width between the margins
    unit = (axes.WIDTH - 2 * axes.RIGHT) / 100.0
    zero = axes.RIGHT + 20.0 * unit
    p, q, r = bars(made)
    assert p == pytest.approx((zero, zero + 30.0 * unit), abs=0.2)
    assert q == pytest.approx((axes.RIGHT, zero), abs=0.2)
    assert r == pytest.approx((zero + 30.0 * unit, zero + 80.0 * unit), abs=0.2)
    assert "a: 60 m" in made


def test_several_negative_parts_do_not_lie_over_each_other():
    made = stacked_bars({"a": {"p": -10.0, "q": -30.0}}, ["p", "q"], "m")
    p, q = bars(made)
    assert p[0] == pytest.approx(q[1], abs=0.2)
    assert q[1] - q[0] == pytest.approx(3.0 * (p[1] - p[0]), rel=0.02)


def test_charts_without_values_are_drawn_too():
    assert "<svg" in stacked_bars({}, [], "m")
    assert "<svg" in scatter([], "x", "y")
