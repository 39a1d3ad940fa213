"""Speed plans against closed forms and the limits they promise."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.speed_plan import SpeedLimits, curvature, plan_speed

STEP_M = 0.5


def path(curvatures):
    """Route points with a given curvature at each step, 0.5 m apart, starting east."""
    heading = np.concatenate([[0.0], np.cumsum(np.asarray(curvatures) * STEP_M)])
    direction = np.column_stack([np.cos(heading), np.sin(heading)])
    xy = np.vstack([[0.0, 0.0], np.cumsum(direction[:-1] * STEP_M, axis=0)])
    return np.hstack([xy, direction])


def straight(metres):
    return np.zeros(round(metres / STEP_M))


def test_a_straight_is_driven_at_cruising_speed_until_it_is_time_to_brake():
    limits = SpeedLimits(cruise_mps=6.0, braking_mps2=2.0, final_mps=3.0)
    speed = plan_speed(path(straight(100.0)), STEP_M, limits)
    left_m = 100.0 - STEP_M * np.arange(len(speed))
    np.testing.assert_allclose(speed, np.minimum(6.0, np.sqrt(3.0**2 + 2.0 * 2.0 * left_m)))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_arc_is_driven_at_the_speed_of_its_lateral_limit(side):
    limits = SpeedLimits(cruise_mps=30.0, lateral_mps2=2.0, final_mps=30.0)
    speed = plan_speed(path(np.full(200, side / 10.0)), STEP_M, limits)
    np.testing.assert_allclose(speed, math.sqrt(2.0 * 10.0))


def test_braking_for_an_arc_begins_where_the_closed_form_says():
    arc = np.full(40, 1.0 / 8.0)
    limits = SpeedLimits(cruise_mps=10.0, lateral_mps2=2.0, braking_mps2=1.5, final_mps=10.0)
    speed = plan_speed(path(np.concatenate([straight(80.0), arc, straight(40.0)])), STEP_M, limits)
    # from 10 m/s to 4 m/s (2 m/s^2 at R = 8 m) with 1.5 m/s^2 takes 28 m
    station = STEP_M * np.arange(len(speed))
    braking = np.flatnonzero(speed < 10.0)[0]
    assert station[braking] == pytest.approx(80.0 - 28.0, abs=2 * STEP_M)
    before = (station > 55.0) & (station < 78.0)
    # the arc is felt up to two samples late or early
    for edge_m, sign in ((79.0, -1.0), (81.0, 1.0)):
        closed_form = np.sqrt(4.0**2 + 2.0 * 1.5 * (edge_m - station[before]))
        assert (sign * (closed_form - speed[before]) >= 0.0).all()
    assert speed[station > 102.0].min() == 10.0  # nothing holds it back after the arc


def test_the_end_is_reached_at_the_final_speed_or_slower():
    fast = plan_speed(path(straight(50.0)), STEP_M, SpeedLimits(cruise_mps=2.0, final_mps=3.0))
    np.testing.assert_array_equal(fast, 2.0)
    slow = plan_speed(path(straight(50.0)), STEP_M, SpeedLimits(cruise_mps=6.0, final_mps=1.0))
    assert slow[-1] == 1.0


@settings(max_examples=60, deadline=None)
@given(
    bends=st.lists(st.floats(-0.25, 0.25), min_size=1, max_size=12),
    limits=st.builds(
        SpeedLimits,
        cruise_mps=st.floats(1.0, 20.0),
        lateral_mps2=st.floats(0.5, 4.0),
        braking_mps2=st.floats(0.5, 4.0),
        final_mps=st.floats(0.5, 10.0),
    ),
)
def test_a_plan_keeps_all_its_limits_on_any_path(bends, limits):
    points = path(np.repeat(bends, 16))
    speed = plan_speed(points, STEP_M, limits)
    assert len(speed) == len(points)
    assert (speed > 0.0).all()
    assert speed.max() <= limits.cruise_mps
    assert speed[-1] <= limits.final_mps
    lateral = speed**2 * np.abs(curvature(points, STEP_M))
    assert lateral.max() <= limits.lateral_mps2 * (1.0 + 1e-9)
    deceleration = (speed[:-1] ** 2 - speed[1:] ** 2) / (2.0 * STEP_M)
    assert deceleration.max() <= limits.braking_mps2 * (1.0 + 1e-9)
    # and it is the greatest such plan: every point touches one of the limits
    reach = np.sqrt(np.append(speed[1:], np.inf) ** 2 + 2.0 * limits.braking_mps2 * STEP_M)
    bend = np.maximum(np.abs(curvature(points, STEP_M)), 1e-12)
    greatest = np.minimum(np.minimum(limits.cruise_mps, np.sqrt(limits.lateral_mps2 / bend)), reach)
    greatest[-1] = min(greatest[-1], limits.final_mps)
    np.testing.assert_allclose(speed, greatest, rtol=1e-9)


def test_curvature_is_positive_to_the_right_and_does_not_jump_where_headings_wrap():
    right = path(np.full(200, 0.1))  # more than one full turn
    np.testing.assert_allclose(curvature(right, STEP_M), 0.1, atol=1e-9)
    np.testing.assert_allclose(curvature(path(np.full(200, -0.1)), STEP_M), -0.1, atol=1e-9)


@pytest.mark.parametrize("name", ["cruise_mps", "lateral_mps2", "braking_mps2", "final_mps"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_that_are_not_positive_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value}"):
        SpeedLimits(**{name: value})
