import math

import numpy as np
import pytest

from bev_driving_env.bev import bev_window
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.kernels.bev import LIGHTS, PEDESTRIANS, VEHICLES, render_worlds
from bev_driving_env.kernels.layout import (
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    RasterGrid,
)

EGO = (37.0, -12.0, 2.1)


def place(ahead, left, turned):
    """World pose of something seen from the ego."""
    cos, sin = math.cos(EGO[2]), math.sin(EGO[2])
    x, y = EGO[0] + ahead * cos + left * sin, EGO[1] + ahead * sin - left * cos
    return x, y, EGO[2] + turned


def box_depth(picture, pose, half_length, half_width):
    ahead, right = picture.frame_of(pose)
    return np.minimum(half_length - np.abs(ahead), half_width - np.abs(right))


def assert_filled(plane, depth):
    clear = np.abs(depth) > 1e-6
    np.testing.assert_array_equal((plane == 255)[clear], (depth > 0.0)[clear])


@pytest.mark.parametrize("turned", [0.013, 0.5, 1.7, -2.6])
def test_a_vehicle_is_its_footprint(draw, turned):
    pose = place(12.34, 4.56, turned)
    picture = draw(EGO, vehicles=[(*pose, 3.0, 4.7, 1.9)])
    assert_filled(picture.bev[VEHICLES], box_depth(picture, pose, 2.35, 0.95))
    # 12.34 m ahead and 4.56 m to the left
    assert picture.bev[VEHICLES, round(152 - 5 * 12.34), round(96 - 5 * 4.56)] == 255
    assert not picture.bev[PEDESTRIANS].any()


def test_a_pedestrian_has_a_half_extent_of_at_least_0_8_m(draw):
    pose = place(8.1, -3.3, 0.9)
    picture = draw(EGO, pedestrians=[(*pose, 1.0, 0.5, 0.4)])
    assert_filled(picture.bev[PEDESTRIANS], box_depth(picture, pose, 0.8, 0.8))
    assert not picture.bev[VEHICLES].any()


def test_a_longer_pedestrian_such_as_a_cyclist_keeps_its_length(draw):
    pose = place(8.1, -3.3, 0.9)
    picture = draw(EGO, pedestrians=[(*pose, 1.0, 2.2, 0.4)])
    assert_filled(picture.bev[PEDESTRIANS], box_depth(picture, pose, 1.1, 0.8))


def test_empty_slots_are_not_drawn(draw):
    empty = (*place(10.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    picture = draw(EGO, vehicles=[empty, empty], pedestrians=[empty])
    assert not picture.bev[VEHICLES].any()
    assert not picture.bev[PEDESTRIANS].any()


def test_every_vehicle_is_drawn_and_those_at_the_border_are_cut(draw):
    spots = [place(10.1, 5.2, 0.3), place(30.3, -3.1, 1.0), place(-8.1, 19.1, 0.0)]
    picture = draw(EGO, vehicles=[(*pose, 0.0, 5.0, 2.0) for pose in spots])
    depth = np.max([box_depth(picture, pose, 2.5, 1.0) for pose in spots], axis=0)
    assert_filled(picture.bev[VEHICLES], depth)


def test_a_vehicle_out_of_view_is_not_drawn(draw):
    for spot in (place(40.0, 0.0, 0.0), place(-15.0, 3.0, 0.0), place(5.0, 30.0, 0.4)):
        assert not draw(EGO, vehicles=[(*spot, 0.0, 5.0, 2.0)]).bev.any()


def test_a_vehicle_in_the_farthest_corner_of_an_odd_window_is_drawn(draw):
    pose = place(95.0, 48.0, 0.4)
    picture = draw(EGO, vehicles=[(*pose, 0.0, 5.0, 2.0)], size=200, px_per_m=2.0, ego_row=199)
    assert_filled(picture.bev[VEHICLES], box_depth(picture, pose, 2.5, 1.0))
    assert picture.bev[VEHICLES].any()


STOP_LINE = (*place(9.03, 3.21, 0.0)[:2], *place(9.41, -0.13, 0.0)[:2])


@pytest.mark.parametrize(
    ("signal", "drawn"),
    [(SIGNAL_OFF, False), (SIGNAL_GREEN, False), (SIGNAL_YELLOW, True), (SIGNAL_RED, True)],
)
def test_a_stop_line_shows_while_its_signal_says_stop(draw, signal, drawn):
    picture = draw(EGO, stop_lines=[STOP_LINE], signals=[signal])
    assert picture.bev[LIGHTS].any() == drawn


@pytest.mark.parametrize("px_per_m", [5.0, 3.0, 10.0])
def test_a_stop_line_is_6_px_thick_at_any_resolution(draw, px_per_m):
    picture = draw(EGO, stop_lines=[STOP_LINE], signals=[SIGNAL_RED], px_per_m=px_per_m)
    x0, y0, x1, y1 = STOP_LINE
    length = math.dist((x0, y0), (x1, y1))
    along, right = picture.frame_of((x0, y0, math.atan2(y1 - y0, x1 - x0)))
    depth = np.minimum.reduce([along, length - along, 3.0 / px_per_m - np.abs(right)])
    assert_filled(picture.bev[LIGHTS], depth)
    assert picture.bev[LIGHTS].any()


def test_each_stop_line_obeys_its_own_signal(draw):
    other = (*place(20.0, 3.0, 0.0)[:2], *place(20.0, 0.0, 0.0)[:2])
    both = draw(EGO, stop_lines=[STOP_LINE, other], signals=[SIGNAL_RED, SIGNAL_YELLOW])
    one = draw(EGO, stop_lines=[STOP_LINE, other], signals=[SIGNAL_GREEN, SIGNAL_YELLOW])
    assert (both.bev[LIGHTS] > one.bev[LIGHTS]).any()
    rows = np.nonzero(one.bev[LIGHTS])[0]
    assert rows.mean() == pytest.approx(152 - 5 * 20.0, abs=0.6)


def test_worlds_that_are_not_selected_keep_their_picture_and_others_do_not_mix():
    vehicles = np.zeros((3, 1, 6))
    vehicles[:, 0] = 10.0, 0.0, 0.0, 0.0, 5.0, 2.0
    vehicles[2, 0, 4] = 0.0  # the third world has no vehicle
    bev = np.full((3, 6, 192, 192), 77, np.uint8)
    render_worlds(
        bev_window(BEVGeometry()),
        np.zeros((1, 1), np.uint8),
        RasterGrid(0.0, 0.0, 10.0),
        np.zeros((0, 4)),
        np.array([True, False, True]),
        np.zeros((3, 4)),
        np.zeros((3, 2, 4)),
        np.zeros(3, np.int64),
        np.ones(3),
        np.zeros((3, 5)),
        vehicles,
        np.zeros((3, 0, 6)),
        np.zeros((3, 0), np.uint8),
        bev,
    )
    assert (bev[1] == 77).all()
    assert bev[0, VEHICLES].any()
    assert not bev[2].any()
