import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from bev_driving_env.kernels.fill import fill_band, fill_convex

HEIGHT, WIDTH = 40, 60
KNIFE_EDGE_PX = 1e-6


def random_polygon(rng, low=(-10.0, -10.0), high=(70.0, 50.0)):
    """Corners (K, 2) of a random convex polygon as (column, row), in either orientation."""
    points = rng.uniform(low, high, (rng.integers(3, 9), 2))
    corners = points[ConvexHull(points).vertices]
    return corners[:: rng.choice([-1, 1])]


def depth_inside(corners, shape=(HEIGHT, WIDTH)):
    """How far each pixel centre lies inside a convex polygon: negative outside."""
    row, column = np.mgrid[: shape[0], : shape[1]]
    center = corners.mean(axis=0)
    depth = np.full(shape, np.inf)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([y0 - y1, x1 - x0]) / math.dist((x0, y0), (x1, y1))
        if normal @ (center - (x0, y0)) < 0.0:
            normal = -normal
        depth = np.minimum(depth, normal[0] * (column - x0) + normal[1] * (row - y0))
    return depth


def filled(corners, shape=(HEIGHT, WIDTH)):
    plane = np.zeros(shape, np.uint8)
    spans = np.empty((len(plane), 2))
    fill_convex(plane, corners[:, 0].copy(), corners[:, 1].copy(), spans, 0, 1)
    return plane


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32))
def test_filled_pixels_are_those_inside_all_half_planes(seed):
    corners = random_polygon(np.random.default_rng(seed))
    depth = depth_inside(corners)
    clear = np.abs(depth) > KNIFE_EDGE_PX
    np.testing.assert_array_equal(filled(corners)[clear], (depth > 0.0)[clear])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32))
def test_clipping_at_the_borders_changes_nothing_inside(seed):
    corners = random_polygon(np.random.default_rng(seed), (-80.0, -60.0), (140.0, 100.0))
    wide = filled(corners + np.array([100, 100]), (HEIGHT + 200, WIDTH + 200))
    np.testing.assert_array_equal(filled(corners), wide[100:-100, 100:-100])


@pytest.mark.parametrize("offset", [(-100, 0), (100, 0), (0, -100), (0, 100)])
def test_a_polygon_outside_the_plane_draws_nothing(offset):
    corners = np.array([[10.0, 10.0], [30.0, 10.0], [30.0, 25.0], [10.0, 25.0]]) + offset
    assert not filled(corners).any()


def test_edges_count_as_inside():
    plane = filled(np.array([[3.0, 2.0], [7.0, 2.0], [7.0, 5.0], [3.0, 5.0]]))
    assert plane.sum() == 5 * 4
    assert plane[2:6, 3:8].all()


def test_a_sliver_between_pixel_centers_draws_nothing():
    assert not filled(np.array([[3.2, 2.0], [3.8, 2.0], [3.8, 30.0], [3.2, 30.0]])).any()


def test_kept_bits_survive_under_the_polygon_and_all_bits_outside_it():
    rng = np.random.default_rng(3)
    before = rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
    corners = np.array([[10.3, 5.2], [40.1, 9.7], [25.5, 33.3]])
    plane = before.copy()
    spans = np.empty((len(plane), 2))
    columns, rows = corners[:, 0].copy(), corners[:, 1].copy()
    fill_convex(plane, columns, rows, spans, 0b1010_0000, 0b0000_0101)
    inside = depth_inside(corners) > 0.0
    np.testing.assert_array_equal(plane[~inside], before[~inside])
    np.testing.assert_array_equal(plane[inside] & 0b0000_1111, 0b0101)
    np.testing.assert_array_equal(plane[inside] & 0b1010_0000, before[inside] & 0b1010_0000)
    assert not (plane[inside] & 0b0101_0000).any()


X0_M, Y0_M, PX_PER_M = -3.0, 20.0, 4.0


def band(points, left, right):
    """Fill a band on a plane of 80 m by 60 m; the pixels and their centres in the world."""
    plane = np.zeros((240, 320), np.uint8)
    left, right = np.full(len(points), left), np.full(len(points), right)
    fill_band(plane, X0_M, Y0_M, PX_PER_M, points, left, right, 0, 255)
    row, column = np.mgrid[:240, :320]
    return plane == 255, X0_M + (column + 0.5) / PX_PER_M, Y0_M + (row + 0.5) / PX_PER_M


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.9, 3.5, 5.2])
def test_a_band_along_a_straight_lies_between_its_two_lateral_offsets(angle):
    cos, sin, length = math.cos(angle), math.sin(angle), 21.13
    start = np.array([36.02, 49.03])
    points = np.array([[*start, cos, sin], [*(start + length * np.array([cos, sin])), cos, sin]])
    plane, x, y = band(points, -1.27, 3.81)
    along = (x - start[0]) * cos + (y - start[1]) * sin
    right = (y - start[1]) * cos - (x - start[0]) * sin
    expected = (along >= 0.0) & (along <= length) & (right >= -1.27) & (right <= 3.81)
    np.testing.assert_array_equal(plane, expected)


def test_a_band_along_an_arc_is_a_sector_of_a_ring_without_gaps():
    radius, angles = 14.0, np.linspace(0.3, 1.8, 60)
    cos, sin = np.cos(angles), np.sin(angles)
    points = np.column_stack([30.0 + radius * cos, 40.0 + radius * sin, -sin, cos])
    plane, x, y = band(points, -2.13, 1.37)  # clockwise: right is inside
    r, angle = np.hypot(x - 30.0, y - 40.0), np.arctan2(y - 40.0, x - 30.0)
    deepest = np.minimum.reduce(
        [r - (14.0 - 1.37), 16.13 - r, r * (angle - 0.3), r * (1.8 - angle)]
    )
    clear = np.abs(deepest) > 0.01
    np.testing.assert_array_equal(plane[clear], (deepest > 0.0)[clear])


def test_a_band_may_change_its_width_along_the_way():
    plane = np.zeros((100, 100), np.uint8)
    points = np.array([[10.0, 50.0, 1.0, 0.0], [90.0, 50.0, 1.0, 0.0]])
    left, right = np.array([-10.0, -30.0]), np.array([5.0, 5.0])
    fill_band(plane, 0.0, 0.0, 1.0, points, left, right, 0, 1)
    assert plane.sum(axis=0)[[10, 50, 89]].tolist() == pytest.approx([15, 25, 35], abs=1)
