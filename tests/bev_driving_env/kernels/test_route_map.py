import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_driving_env.bev import bev_window
from bev_driving_env.frames import BEVGeometry, world_from_ego
from bev_driving_env.kernels.layout import Pose
from bev_driving_env.kernels.route_map import draw_route_map, gps_offset, render_route_maps

EGO = (37.0, -12.0, 2.1)
DEFAULT = BEVGeometry()
GEOMETRIES = [DEFAULT, BEVGeometry(128, 3.0, 127), BEVGeometry(200, 8.0, 100)]


def plan_ahead(*ego_points, pose=EGO):
    """Plan points 10 m apart by station, at places seen from the ego: metres ahead and left."""
    places = world_from_ego(pose, np.array(ego_points, dtype=np.float64).reshape(-1, 2))
    return np.column_stack([places, 10.0 * np.arange(1, len(places) + 1)])


def draw(plan, position=0.0, geometry=DEFAULT, pose=EGO, offset=(0.0, 0.0), size=None):
    plane = np.zeros((geometry.size, geometry.size), np.uint8)
    x, y, heading = pose
    draw_route_map(
        plane,
        bev_window(geometry),
        plan,
        len(plan) if size is None else size,
        position,
        Pose(x, y, math.cos(heading), math.sin(heading)),
        *offset,
    )
    return plane


def distance_px(geometry, column, row):
    v, u = np.mgrid[: geometry.size, : geometry.size]
    return np.hypot(u - column, v - row)


def distance_m(geometry, ahead, left):
    """Distance of every pixel centre from a point in the ego frame."""
    v, u = np.mgrid[: geometry.size, : geometry.size]
    centers = geometry.ego_from_pixel(np.stack([u, v], axis=-1))
    return np.hypot(centers[..., 0] - ahead, centers[..., 1] - left)


def assert_disc(plane, distance, radius, value):
    clear = np.abs(distance - radius) > 1e-6
    np.testing.assert_array_equal(plane[clear], np.where(distance < radius, value, 0)[clear])


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("place", [(7.03, 3.41), (0.0, 0.0), (11.9, -9.97), (11.9, 9.97)])
def test_a_point_in_view_is_a_disc_of_4_m_diameter(geometry, place):
    assert_disc(draw(plan_ahead(place), geometry=geometry), distance_m(geometry, *place), 2.0, 255)


def test_a_disc_at_a_pixel_center_is_21_pixels_wide_and_includes_its_circle():
    plane = draw(plan_ahead((10.0, 2.0), pose=(0.0, 0.0, 0.0)), pose=(0.0, 0.0, 0.0))
    v, u = np.mgrid[-10:11, -10:11]
    np.testing.assert_array_equal(plane[92:113, 76:97] == 255, u**2 + v**2 <= 100)
    assert (plane == 255).sum() == (u**2 + v**2 <= 100).sum()


def test_the_next_five_points_are_drawn_and_passed_ones_are_not():
    places = [(4.2 * k - 7.0, 0.0) for k in range(9)]
    plan = plan_ahead(*places)  # at stations 10, 20, ... 90
    for position, shown in [
        (0.0, range(5)),
        (9.9, range(5)),
        (10.0, range(1, 6)),
        (55, range(5, 9)),
    ]:
        plane = draw(plan, position)
        nearest = np.min([distance_m(DEFAULT, *places[k]) for k in shown], axis=0)
        assert_disc(plane, nearest, 2.0, 255)


def test_when_the_last_point_is_passed_nothing_is_drawn():
    plan = plan_ahead((3.0, 0.0), (9.0, 0.0))
    assert draw(plan, 19.9).any()
    assert not draw(plan, 20.0).any()


def test_points_beyond_the_valid_ones_are_ignored():
    plan = plan_ahead((5.0, 0.0), (12.0, 0.0), (80.0, 0.0))
    assert_disc(draw(plan, size=1), distance_m(DEFAULT, 5.0, 0.0), 2.0, 255)
    assert not draw(plan, size=0).any()


def test_points_are_not_joined_by_a_line():
    plane = draw(plan_ahead((5.0, 0.0), (20.0, 0.0)))
    assert not plane[100:110].any()
    assert plane[127].any()
    assert plane[52].any()


def leave_window(geometry, ahead, left):
    """Where a walk from the ego pixel towards a point leaves the image, to a thousandth pixel."""
    start = np.array([geometry.size / 2.0, geometry.ego_row])
    towards = np.array([-left, -ahead]) / math.hypot(ahead, left)
    steps = start + np.arange(0.0, 1.5 * geometry.size, 0.001)[:, None] * towards
    return steps[((steps >= 0.0) & (steps <= geometry.size - 1)).all(axis=1)][-1]


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("bearing", np.arange(-175.0, 180.0, 23.0))
def test_a_point_out_of_view_is_a_dim_disc_where_its_direction_meets_the_border(geometry, bearing):
    place = 60.3 * math.cos(math.radians(bearing)), 60.3 * math.sin(math.radians(bearing))
    plane = draw(plan_ahead(place), geometry=geometry)
    radius = 2.0 * geometry.px_per_m
    distance = distance_px(geometry, *leave_window(geometry, *place))
    clear = np.abs(distance - radius) > 0.002
    np.testing.assert_array_equal(plane[clear], np.where(distance < radius, 128, 0)[clear])


def test_straight_ahead_the_marker_is_half_a_disc_at_the_top():
    plane = draw(plan_ahead((100.0, 0.0), pose=(0.0, 0.0, 0.0)), pose=(0.0, 0.0, 0.0))
    rows, columns = np.nonzero(plane)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (0, 10, 86, 106)
    assert set(np.unique(plane)) == {0, 128}


def test_the_view_ends_with_the_outermost_pixel_centers():
    pose = (0.0, 0.0, 0.0)
    # row 0 is 30.4 m ahead, column 0 is 19.2 m left, column 191 is 19 m right, row 191 7.8 m behind
    corners = {(30.4, 19.2): 255, (30.4, -19.0): 255, (-7.8, 19.2): 255, (-7.8, -19.0): 255}
    beyond = {(30.41, 0.0): 128, (5.0, 19.21): 128, (5.0, -19.01): 128, (-7.81, 0.0): 128}
    for place, value in {**corners, **beyond}.items():
        assert draw(plan_ahead(place, pose=pose), pose=pose).max() == value


def test_only_the_first_point_out_of_view_is_marked_and_later_ones_are_not_drawn():
    first = draw(plan_ahead((5.0, 0.0), (60.0, 0.0)))
    more = draw(plan_ahead((5.0, 0.0), (60.0, 0.0), (10.0, 8.0), (10.0, 60.0)))
    np.testing.assert_array_equal(more, first)
    assert set(np.unique(first)) == {0, 128, 255}


def test_a_point_out_of_view_that_is_not_among_the_next_five_is_not_marked():
    near = [(4.5 * k, 0.0) for k in range(5)]
    assert 128 not in draw(plan_ahead(*near, (60.0, 0.0)))
    assert 128 in draw(plan_ahead(*near[:4], (60.0, 0.0)))


def test_where_a_marker_overlaps_a_disc_the_disc_stays_bright():
    disc = draw(plan_ahead((29.0, 0.5)))
    both = draw(plan_ahead((29.0, 0.5), (60.0, 0.0)))
    marker = draw(plan_ahead((60.0, 0.0)))
    assert ((disc > 0) & (marker > 0)).any()
    np.testing.assert_array_equal(both, np.maximum(disc, marker))


def test_an_offset_shifts_all_points_in_the_world_frame():
    plan = plan_ahead((5.0, 0.0), (15.0, 6.0), (60.0, 5.0))
    shifted = plan + np.array([1.3, -0.4, 0.0])
    for pose in (EGO, (36.0, -11.0, 0.4)):
        np.testing.assert_array_equal(
            draw(plan, pose=pose, offset=(1.3, -0.4)), draw(shifted, pose=pose)
        )
    assert (draw(plan) != draw(shifted)).any()


def test_whether_a_point_is_in_view_is_decided_after_the_shift():
    plan = plan_ahead((30.0, 0.0), pose=(0.0, 0.0, 0.0))
    assert draw(plan, pose=(0.0, 0.0, 0.0)).max() == 255
    assert draw(plan, pose=(0.0, 0.0, 0.0), offset=(0.5, 0.0)).max() == 128


def offsets(seeds, steps):
    return np.array([[gps_offset(seed, step) for step in steps] for seed in seeds])


def test_gps_noise_is_0_55_m_per_episode_and_0_1_m_per_step_on_each_axis():
    noise = offsets(range(2000), range(20))
    episodes = noise.mean(axis=1)
    jitter = (noise - episodes[:, None]) * math.sqrt(20.0 / 19.0)
    np.testing.assert_allclose(episodes.std(axis=0), math.hypot(0.55, 0.1 / 20**0.5), rtol=0.05)
    np.testing.assert_allclose(episodes.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose(jitter.std(axis=(0, 1)), 0.1, rtol=0.02)
    # normal: 68.3 % within one sigma, 95.4 % within two
    for sigmas, share in [(1.0, 0.683), (2.0, 0.954)]:
        assert (np.abs(jitter) < 0.1 * sigmas).mean() == pytest.approx(share, abs=0.01)
        assert (np.abs(episodes) < 0.55 * sigmas).mean() == pytest.approx(share, abs=0.03)


def test_gps_noise_has_independent_axes_steps_and_episodes():
    noise = offsets(range(2000), range(4))
    jitter = noise - noise.mean(axis=1, keepdims=True)
    columns = np.column_stack([noise[:, 0], noise[:, 0] - noise[:, 1], noise[:, 2] - noise[:, 3]])
    correlation = np.corrcoef(columns, rowvar=False)
    expected = np.eye(6)
    # the first column holds the first step's jitter, which the second column holds too
    expected[[0, 2, 1, 3], [2, 0, 3, 1]] = 0.1 / math.hypot(0.55, 0.1) / math.sqrt(2.0)
    np.testing.assert_allclose(correlation, expected, atol=0.08)
    neighbours = np.corrcoef(noise[:-1, 0, 0], noise[1:, 0, 0])[0, 1]
    assert abs(neighbours) < 0.08
    assert abs(np.corrcoef(jitter[:-1, 0, 0], jitter[1:, 0, 0])[0, 1]) < 0.08


@settings(max_examples=50, deadline=None)
@given(st.integers(-(2**63), 2**63 - 1), st.integers(0, 10_000))
def test_gps_noise_repeats_for_the_same_seed_and_step_and_is_finite_for_any(seed, step):
    assert gps_offset(seed, step) == gps_offset(seed, step)
    assert gps_offset(seed, step) != gps_offset(seed, step + 1)
    assert np.abs(gps_offset(seed, step)).max() < 10 * 0.55


def render(noisy, seeds, steps, selected=(True, True, True)):
    """Three worlds with one plan each, of which the last is empty."""
    poses = np.array([[*EGO, 5.0], [3.0, 4.0, 0.3, 5.0], [0.0, 0.0, 0.0, 0.0]])
    plans = np.stack(
        [plan_ahead((5.0, 1.0), (60.0, 9.0), pose=pose[:3]) for pose in poses], dtype=np.float64
    )
    progress = np.zeros((3, 5))
    progress[1, 0] = 10.0
    maps = np.full((3, 192, 192), 77, np.uint8)
    render_route_maps(
        bev_window(DEFAULT),
        np.array(selected),
        poses,
        progress,
        plans,
        np.array([2, 2, 0]),
        np.array(seeds, dtype=np.int64),
        np.array(steps, dtype=np.int64),
        noisy,
        maps,
    )
    return maps, poses, plans


def test_each_world_is_drawn_from_its_own_plan_and_position():
    maps, poses, plans = render(False, [1, 2, 3], [0, 0, 0])
    np.testing.assert_array_equal(maps[0], draw(plans[0], 0.0, pose=poses[0, :3]))
    np.testing.assert_array_equal(maps[1], draw(plans[1], 10.0, pose=poses[1, :3]))
    assert set(np.unique(maps[0])) == {0, 128, 255}
    assert set(np.unique(maps[1])) == {0, 128}
    assert not maps[2].any()


def test_worlds_that_are_not_selected_keep_their_map():
    maps, _, _ = render(False, [1, 2, 3], [0, 0, 0], selected=(True, False, True))
    assert (maps[1] == 77).all()
    assert 77 not in maps[[0, 2]]


def test_noisy_maps_are_shifted_by_the_noise_of_their_seed_and_step_and_clean_ones_are_not():
    clean, _, _ = render(False, [1, 2, 3], [0, 0, 0])
    same, _, _ = render(False, [4, 5, 6], [7, 8, 9])
    np.testing.assert_array_equal(clean, same)
    noisy, poses, plans = render(True, [4, -5, 6], [7, 8, 9])
    shift = gps_offset(4, 7), gps_offset(-5, 8)
    np.testing.assert_array_equal(noisy[0], draw(plans[0], pose=poses[0, :3], offset=shift[0]))
    np.testing.assert_array_equal(
        noisy[1], draw(plans[1], 10.0, pose=poses[1, :3], offset=shift[1])
    )
    assert (noisy[0] != clean[0]).any()
