import math

import numpy as np
import pytest

from bev_driving_env.kernels.bev import ROUTE

WIDE = {"size": 960, "px_per_m": 5.0, "ego_row": 700}  # 140 m ahead, 96 m to each side


def straight_route(length=200.0, start=(10.0, -5.0), heading=0.7):
    s = np.linspace(0.0, length, int(length * 2) + 1)
    cos, sin = math.cos(heading), math.sin(heading)
    points = np.column_stack([start[0] + s * cos, start[1] + s * sin, 0 * s + cos, 0 * s + sin])
    return points, length / (len(s) - 1)


def circle_route(radius=25.0, turn=1.0):
    """A circle around the origin from (radius, 0), turning right (1) or left (-1)."""
    length = 1.5 * math.pi * radius
    s = np.linspace(0.0, length, int(length * 2) + 1)
    angle = turn * s / radius
    c, d = np.cos(angle), np.sin(angle)
    return np.column_stack([radius * c, radius * d, -d * turn, c * turn]), length / (len(s) - 1)


@pytest.mark.parametrize("seed", range(5))
def test_on_a_straight_the_route_is_a_band_3_2_m_wide_from_its_position_to_80_m_ahead(draw, seed):
    rng = np.random.default_rng(seed)
    position = rng.uniform(0.0, 110.0)
    along_route = (10.0 + position * math.cos(0.7), -5.0 + position * math.sin(0.7), 0.7)
    pose = along_route + rng.uniform(-1.0, 1.0, 3)
    picture = draw(tuple(pose), route=straight_route(), position=position, **WIDE)
    ahead, right = picture.frame_of(along_route)
    depth = np.minimum.reduce([1.6 - np.abs(right), ahead, 80.0 - ahead])
    clear = np.abs(depth) > 1e-6
    np.testing.assert_array_equal((picture.bev[ROUTE] == 255)[clear], (depth > 0.0)[clear])


def test_the_default_window_shows_16_px_by_30_4_m_of_a_straight_route(draw):
    route = straight_route(heading=0.0, start=(0.0, 0.0))
    picture = draw((20.0, 0.05, 0.0), route=route, position=20.0)
    rows, columns = np.nonzero(picture.bev[ROUTE])
    assert (rows.min(), rows.max()) == (0, 152)
    assert len(rows) == 153 * 16
    assert (columns.min(), columns.max()) == (88, 103)  # the route lies 0.05 m left of the ego


@pytest.mark.parametrize("turn", [1.0, -1.0])
@pytest.mark.parametrize("position", [0.0, 13.3, 30.0])
def test_in_a_curve_the_route_is_a_sector_of_a_ring(draw, turn, position):
    angle = turn * position / 25.0
    pose = (25.0 * math.cos(angle), 25.0 * math.sin(angle), angle + turn * math.pi / 2.0 + 0.2)
    route = circle_route(turn=turn)
    picture = draw(pose, route=route, position=position, **WIDE)
    arc = 25.0 * np.mod(turn * np.arctan2(picture.y, picture.x) - position / 25.0, 2.0 * math.pi)
    off_center = np.abs(np.hypot(picture.x, picture.y) - 25.0)
    depth = np.minimum.reduce([1.6 - off_center, arc, 80.0 - arc])
    # just behind the start the arc is almost a whole turn: far from both ends only by number
    clear = (np.abs(depth) > 0.05) & (arc < 25.0 * 2.0 * math.pi - 0.1)
    np.testing.assert_array_equal((picture.bev[ROUTE] == 255)[clear], (depth > 0.0)[clear])


def test_nothing_of_the_route_lies_behind_its_position(draw):
    picture = draw((60.0, 0.0, 0.0), route=straight_route(heading=0.0, start=(0, 0)), position=60.0)
    assert not picture.bev[ROUTE][picture.ahead < -0.01].any()
    assert picture.bev[ROUTE].any()


def test_the_route_starts_at_the_route_position_not_at_the_ego(draw):
    picture = draw((60.0, 0.0, 0.0), route=straight_route(heading=0.0, start=(0, 0)), position=70.0)
    assert picture.ahead[picture.bev[ROUTE] == 255].min() == pytest.approx(10.0, abs=0.2)


def test_the_route_stops_at_its_end(draw):
    route = straight_route(30.0, (0.0, 0.0), 0.0)
    picture = draw((11.3, 0.3, 0.0), route=route, position=11.3, **WIDE)
    assert picture.x[picture.bev[ROUTE] == 255].max() == pytest.approx(30.0, abs=0.2)


def test_bends_between_straights_leave_no_gap_in_the_band(draw):
    s = np.arange(0.0, 40.5, 0.5)
    bend = np.minimum(np.maximum(s - 15.0, 0.0), 12.5) / 8.0  # a right turn of radius 8
    x = np.concatenate([[0.0], np.cumsum(np.cos((bend[1:] + bend[:-1]) / 2.0) * 0.5)])
    y = np.concatenate([[0.0], np.cumsum(np.sin((bend[1:] + bend[:-1]) / 2.0) * 0.5)])
    route = np.column_stack([x, y, np.cos(bend), np.sin(bend)]), 0.5
    picture = draw((0.0, 0.0, 0.3), route=route, position=0.0)
    for px, py in zip(x, y, strict=True):
        near = np.hypot(picture.x - px, picture.y - py) < 1.4
        ahead_of_start = picture.x > 0.05
        before_end = picture.frame_of((x[-1], y[-1], bend[-1]))[0] < -0.05
        assert picture.bev[ROUTE][near & ahead_of_start & before_end].all()


def test_without_a_route_the_channel_is_empty(draw):
    assert not draw((0.0, 0.0, 0.0), route=None).bev[ROUTE].any()
