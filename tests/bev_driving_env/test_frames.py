import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_driving_env.frames import (
    CHANNELS,
    BEVGeometry,
    ego_from_world,
    footprint,
    world_from_ego,
    wrap_angle,
)

EAST, SOUTH, WEST, NORTH = 0.0, math.pi / 2, math.pi, -math.pi / 2
meters = st.floats(-500.0, 500.0)
angles = st.floats(-10.0, 10.0)


@pytest.mark.parametrize(
    ("heading", "ahead", "left"),
    [
        (EAST, (1, 0), (0, -1)),
        (SOUTH, (0, 1), (1, 0)),
        (WEST, (-1, 0), (0, 1)),
        (NORTH, (0, -1), (-1, 0)),
    ],
)
def test_ego_x_points_ahead_and_y_to_the_left_on_every_compass_heading(heading, ahead, left):
    axes = world_from_ego((0.0, 0.0, heading), [[1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(axes, [ahead, left], atol=1e-12)


def test_a_point_ahead_left_of_a_car_heading_southeast_matches_complex_arithmetic():
    heading = math.radians(30.0)
    # in the y-south plane a clockwise turn is a positive complex angle, and left is -1j
    expected = complex(7.0, -3.0) + complex(4.0, -2.0) * np.exp(1j * heading)
    point = world_from_ego((7.0, -3.0, heading), [4.0, 2.0])
    np.testing.assert_allclose(point, [expected.real, expected.imag], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(meters, meters, angles, st.lists(st.tuples(meters, meters), min_size=1, max_size=5))
def test_world_and_ego_frames_round_trip(x, y, heading, points):
    back = ego_from_world((x, y, heading), world_from_ego((x, y, heading), points))
    np.testing.assert_allclose(back, points, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(meters, meters, angles, meters, meters)
def test_frames_keep_distances(x, y, heading, ahead, left):
    point = world_from_ego((x, y, heading), [ahead, left])
    assert math.dist(point, (x, y)) == pytest.approx(math.hypot(ahead, left), abs=1e-9)


def test_points_keep_their_leading_shape():
    points = np.zeros((2, 3, 2))
    assert world_from_ego((1.0, 2.0, 0.3), points).shape == (2, 3, 2)
    assert ego_from_world((1.0, 2.0, 0.3), points).shape == (2, 3, 2)


@settings(max_examples=100, deadline=None)
@given(st.floats(-100.0, 100.0))
def test_wrapped_angle_is_the_same_direction_between_minus_pi_and_pi(angle):
    wrapped = float(wrap_angle(angle))
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)


def test_footprint_corners_of_a_car_heading_south_go_round_from_front_left():
    corners = footprint((10.0, 20.0, SOUTH), 5.0, 2.0)
    # heading south, left is east
    np.testing.assert_allclose(corners, [[11, 22.5], [9, 22.5], [9, 17.5], [11, 17.5]], atol=1e-12)


def test_ego_origin_lies_on_column_96_row_152():
    assert BEVGeometry().pixel_from_ego([0.0, 0.0]).tolist() == [96.0, 152.0]


def test_pixels_follow_the_contract_formula():
    x, y = np.random.default_rng(0).uniform(-40.0, 40.0, (2, 50))
    expected = np.column_stack([-5.0 * y + 96.0, -5.0 * x + 152.0])
    pixels = BEVGeometry().pixel_from_ego(np.column_stack([x, y]))
    np.testing.assert_allclose(pixels, expected, atol=1e-9)


def test_default_window_shows_30_4_m_ahead_8_m_behind_and_19_2_m_to_the_left():
    ahead_left, behind = BEVGeometry().ego_from_pixel([[0.0, 0.0], [96.0, 192.0]])
    np.testing.assert_allclose(ahead_left, [30.4, 19.2])
    np.testing.assert_allclose(behind, [-8.0, 0.0])


@settings(max_examples=30, deadline=None)
@given(st.integers(8, 200), st.floats(0.5, 20.0), st.data())
def test_pixels_and_ego_points_round_trip_in_any_geometry(half_size, px_per_m, data):
    row = data.draw(st.integers(0, 2 * half_size - 1))
    geometry = BEVGeometry(size=2 * half_size, px_per_m=px_per_m, ego_row=row)
    points = np.array([[3.0, -2.0], [-7.5, 11.0], [0.0, 0.0]])
    back = geometry.ego_from_pixel(geometry.pixel_from_ego(points))
    np.testing.assert_allclose(back, points, atol=1e-9)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"size": 191}, "size .* got 191"),
        ({"size": 8}, "size .* got 8"),
        ({"size": 4096}, "size .* got 4096"),
        ({"size": 192.0}, "size .* got 192.0"),
        ({"px_per_m": 0.0}, "px_per_m .* got 0.0"),
        ({"px_per_m": 21.0}, "px_per_m .* got 21.0"),
        ({"px_per_m": math.nan}, "px_per_m .* got nan"),
        ({"ego_row": 192}, "ego_row .* got 192"),
        ({"ego_row": -1}, "ego_row .* got -1"),
        ({"size": 64}, "ego_row .* got 152"),
    ],
)
def test_a_bad_geometry_is_refused_by_name_and_value(keywords, message):
    with pytest.raises(ValueError, match=message):
        BEVGeometry(**keywords)


def test_channels_come_in_the_order_of_the_contract():
    assert CHANNELS == ("road", "route", "lane", "vehicles", "pedestrians", "lights")
