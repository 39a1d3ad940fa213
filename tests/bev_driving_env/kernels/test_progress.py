import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_driving_env.kernels.layout import (
    DISTANCE,
    HEADING_ERROR,
    LATERAL,
    PROGRESS_COLUMNS,
    ROUTE_DONE,
    ROUTE_POSITION,
)
from bev_driving_env.kernels.progress import update_progress

SPACING_M = 0.5


def along_polyline(corners):
    """Route points every half metre along straight pieces, with the direction of each piece."""
    rows = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        length = math.dist((x0, y0), (x1, y1))
        dx, dy = (x1 - x0) / length, (y1 - y0) / length
        s = np.arange(0.0, length, SPACING_M)
        rows.append(np.column_stack([x0 + s * dx, y0 + s * dy, 0 * s + dx, 0 * s + dy]))
    return np.concatenate([*rows, [[*corners[-1], dx, dy]]])


def around_circle(radius, laps):
    """Clockwise (right-turning) laps around the origin, starting east of it heading south."""
    s = np.arange(0.0, laps * 2.0 * math.pi * radius, SPACING_M)
    c, d = np.cos(s / radius), np.sin(s / radius)
    return np.column_stack([radius * c, radius * d, -d, c])


def update(points, ego, progress=None, size=None):
    if progress is None:
        progress = np.zeros(PROGRESS_COLUMNS)
    ego = np.array([*ego, 0.0])
    update_progress(ego, points, size or len(points), SPACING_M, progress)
    return progress


def starting_at(position):
    progress = np.zeros(PROGRESS_COLUMNS)
    progress[ROUTE_POSITION] = progress[ROUTE_DONE] = position
    return progress


@settings(max_examples=50, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(0.0, 40.0), st.floats(-6, 6), st.floats(-3.1, 3.1))
def test_on_a_straight_of_any_direction_the_errors_are_those_of_plane_geometry(
    direction, along, right, turned
):
    cos, sin = math.cos(direction), math.sin(direction)
    points = along_polyline([(5.0, 3.0), (5.0 + 45.0 * cos, 3.0 + 45.0 * sin)])
    ego = (5.0 + along * cos - right * sin, 3.0 + along * sin + right * cos, direction + turned)
    progress = update(points, ego, starting_at(min(along + 2.0, 44.0)))
    assert progress[ROUTE_POSITION] == pytest.approx(along, abs=1e-9)
    assert progress[LATERAL] == pytest.approx(right, abs=1e-9)
    assert progress[DISTANCE] == pytest.approx(abs(right), abs=1e-9)
    assert progress[HEADING_ERROR] == pytest.approx(turned, abs=1e-9)


def test_south_of_an_eastward_route_is_right_of_it_and_positive():
    progress = update(along_polyline([(0, 0), (30, 0)]), (4.0, 1.5, 0.2))
    assert progress[LATERAL] == pytest.approx(1.5)
    assert progress[HEADING_ERROR] == pytest.approx(0.2)


def test_on_a_circle_position_is_arc_length_and_lateral_error_is_radial():
    points = around_circle(15.0, 1)
    for angle in np.linspace(0.05, 0.6, 12):
        for radius in (12.0, 15.0, 18.0):
            ego = (radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2 - 0.3)
            progress = update(points, ego, starting_at(15.0 * angle))
            # 3 m beside a polyline of 0.5 m pieces, projections jump by 3 / 15 * 0.5 m at corners
            assert progress[ROUTE_POSITION] == pytest.approx(15.0 * angle, abs=0.06)
            # the route turns right, so its inside is its right
            assert progress[LATERAL] == pytest.approx(15.0 - radius, abs=0.02)
            assert progress[HEADING_ERROR] == pytest.approx(-0.3, abs=0.02)


def test_beyond_the_end_the_distance_is_that_to_the_end_point():
    points = along_polyline([(0, 0), (20, 0)])
    progress = update(points, (23.0, 4.0, 0.0), starting_at(19.0))
    assert progress[ROUTE_POSITION] == pytest.approx(20.0)
    assert progress[DISTANCE] == pytest.approx(5.0)


def test_padding_behind_the_route_is_ignored():
    points = along_polyline([(0, 0), (20, 0), (20, 20)])
    progress = update(points, (20.0, 4.0, 0.0), starting_at(19.0), size=41)
    assert progress[ROUTE_POSITION] == pytest.approx(20.0)


def follow(points, corners, step_m=0.4):
    """Drive exactly along a polyline; yield the distance driven and the progress row."""
    progress, driven = np.zeros(PROGRESS_COLUMNS), 0.0
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        length = math.dist((x0, y0), (x1, y1))
        for s in np.arange(0.0, length, step_m):
            x, y = x0 + s / length * (x1 - x0), y0 + s / length * (y1 - y0)
            update(points, (x, y, math.atan2(y1 - y0, x1 - x0)), progress)
            yield driven + s, progress
        driven += length


def test_where_a_route_crosses_itself_progress_stays_on_the_right_pass():
    corners = [(0, 0), (60, 0), (60, 30), (30, 30), (30, -30)]
    for driven, progress in follow(along_polyline(corners), corners):
        assert progress[ROUTE_POSITION] == pytest.approx(driven, abs=1e-6)
        assert progress[DISTANCE] == pytest.approx(0.0, abs=1e-6)


def test_where_a_route_repeats_itself_the_second_lap_counts_on():
    lap = [(0, 0), (40, 0), (40, 20), (0, 20), (0, 0)]
    corners = [*lap, *lap[1:]]
    for driven, progress in follow(along_polyline(corners), corners):
        assert progress[ROUTE_POSITION] == pytest.approx(driven, abs=1e-6)
    assert progress[ROUTE_POSITION] > 230.0


def test_route_done_never_shrinks_while_the_position_follows_the_car_back():
    points, progress = along_polyline([(0, 0), (60, 0)]), np.zeros(PROGRESS_COLUMNS)
    rng = np.random.default_rng(0)
    x, farthest = 0.0, 0.0
    for step in rng.uniform(-3.0, 3.5, 200):
        x = float(np.clip(x + step, 0.0, 60.0))
        farthest = max(farthest, x)
        update(points, (x, 0.5, 0.0), progress)
        assert progress[ROUTE_POSITION] == pytest.approx(x, abs=1e-9)
        assert progress[ROUTE_DONE] == pytest.approx(farthest, abs=1e-9)


def test_jumping_ahead_by_more_than_the_window_earns_no_route_metres():
    progress = update(along_polyline([(0, 0), (200, 0)]), (150.0, 0.0, 0.0))
    assert progress[ROUTE_DONE] <= 11.0
    assert progress[DISTANCE] > 130.0
