import itertools

import cv2
import gymnasium as gym
import numpy as np
import pytest
from scipy import ndimage

import bev_driving_env  # noqa: F401 - registers the environments
from agents import Expert
from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.sources import corruptions

GEOMETRY = BEVGeometry()
ROUTE = CHANNELS.index("route")
AHEAD_M = (2.0, 10.0, 20.0, 25.0, 30.0, 40.0)
DOSES = (0.0, 0.25, 0.5, 0.75, 1.0)
LOSSES = ("pixel_dropout", "blob_dropout", "channel_dropout", "flicker", "range_misses")
RANDOM = (*LOSSES, "shift", "rotation", "ghosts")
MODELS = (*RANDOM, "dilation", "erosion", "straightening")


def corrupted(name, planes, dose, seed=0, geometry=GEOMETRY):
    return getattr(corruptions, name)(planes, dose, np.random.default_rng(seed), geometry)


def iou(first, second):
    union = np.maximum(first, second).sum(dtype=float)
    return np.minimum(first, second).sum(dtype=float) / union if union else 1.0


@pytest.fixture(scope="module")
def drive():
    """Every fourth BEV of an episode, and how the planned route turns in the next 2 to 40 m."""
    env = gym.make("BEVTown02-v0")
    observation, _ = env.reset(seed=0, options={"episode": 2})
    expert, frames, done = Expert(env), [], False
    while not done:
        world, route = env.unwrapped.world, env.unwrapped.route
        if env.unwrapped.world.state.steps[0] % 4 == 0:
            start = world.route_position_m(0)
            stations = (start + np.array([0.0, *AHEAD_M])) / route.spacing_m
            ways = route.points[np.minimum(stations, len(route.points) - 1).astype(int), 2:4]
            way = ways[:, 0] + 1j * ways[:, 1]
            left_m = (len(route.points) - 1) * route.spacing_m - start
            frames.append((observation["bev"].copy(), np.abs(np.angle(way[1:] / way[0])), left_m))
        observation, _, terminated, truncated, _ = env.step(expert.act(observation))
        done = terminated or truncated
    return frames


@pytest.fixture(scope="module")
def bevs(drive):
    return [frame for frame, _, _ in drive[::15]]


@pytest.fixture
def soft():
    return np.random.default_rng(1).integers(0, 256, (3, 192, 192), dtype=np.uint8)


def band(turn_rad, radius_m=6.0, lead_m=4.0, length_m=24.0, width_m=3.2, curvature_share=1.0):
    """A route drawn by distance: straight, then a turn (positive to the right), then straight."""
    along = np.arange(0.0, length_m, 0.05)
    bent = np.clip(along - lead_m, 0.0, radius_m * abs(turn_rad)) / radius_m
    heading = -1j * np.exp(1j * np.sign(turn_rad) * curvature_share * bent)
    centre = 96 + 152j + np.concatenate([[0.0], np.cumsum(heading * 0.05 * 5.0)[:-1]])
    rows, columns = np.mgrid[0:192, 0:192]
    pixels = columns + 1j * rows
    nearest = np.abs(pixels[..., None] - centre[::4]).argmin(axis=-1) * 4
    offset = (pixels - centre[nearest]) / heading[nearest]
    inside = (np.abs(offset.imag) <= width_m * 2.5) & (np.abs(offset.real) <= 0.6)
    return (inside * 255).astype(np.uint8)


@pytest.mark.parametrize("name", MODELS)
def test_dose_zero_is_the_identity(name, soft, bevs):
    for planes in (soft, *bevs):
        np.testing.assert_array_equal(corrupted(name, planes, 0.0), planes)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("dose", [0.0, 0.5, 1.0])
def test_the_result_is_a_new_array_of_the_same_kind(name, dose, soft):
    before = soft.copy()
    after = corrupted(name, soft, dose)
    np.testing.assert_array_equal(soft, before)
    assert not np.shares_memory(after, soft)
    assert (after.shape, after.dtype) == (soft.shape, np.uint8)


@pytest.mark.parametrize(
    "name", [name for name in MODELS if name not in ("shift", "straightening")]
)
def test_iou_falls_with_the_dose_in_every_single_frame(name, bevs):
    for seed, bev in enumerate(bevs):
        overlaps = [iou(bev, corrupted(name, bev, dose, seed)) for dose in DOSES]
        assert overlaps == sorted(overlaps, reverse=True)


@pytest.mark.parametrize("name", MODELS)
def test_average_iou_falls_strictly_with_the_dose(name, drive):
    bevs = [bev for bev, _, _ in drive[::5]]
    planes = slice(ROUTE, ROUTE + 1) if name == "straightening" else slice(None)
    means = [
        np.mean([iou(b[planes], corrupted(name, b[planes], d, k)) for k, b in enumerate(bevs)])
        for d in DOSES
    ]
    assert means[0] == 1.0
    assert np.diff(means).max() < -0.005


@pytest.mark.parametrize("name", LOSSES)
def test_what_a_dose_loses_a_larger_dose_loses_too(name):
    white = np.full((6, 192, 192), 255, np.uint8)
    for seed in range(5):
        kept = [corrupted(name, white, dose, seed) > 0 for dose in np.linspace(0.0, 1.0, 8)]
        for more, less in itertools.pairwise(kept):
            assert not (less & ~more).any()


@pytest.mark.parametrize("name", ["pixel_dropout", "blob_dropout", "channel_dropout", "flicker"])
def test_a_full_loss_leaves_nothing(name, soft):
    assert not corrupted(name, soft, 1.0).any()


@pytest.mark.parametrize("name", ["pixel_dropout", "blob_dropout", "channel_dropout", "flicker"])
def test_the_share_lost_is_the_dose(name):
    white = np.full((6, 192, 192), 255, np.uint8)
    lost = [(corrupted(name, white, 0.3, seed) == 0).mean() for seed in range(60)]
    assert np.mean(lost) == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("name", RANDOM)
def test_equal_generators_give_equal_results_and_others_do_not(name, bevs):
    results = [corrupted(name, bevs[0], 0.5, seed) for seed in range(6)]
    np.testing.assert_array_equal(results[3], corrupted(name, bevs[0], 0.5, 3))
    assert any((result != results[0]).any() for result in results[1:])


def test_lost_blobs_are_a_few_metres_wide():
    kept = corrupted("blob_dropout", np.full((1, 192, 192), 255, np.uint8), 0.3)[0]
    count, _, stats, _ = cv2.connectedComponentsWithStats((kept == 0).astype(np.uint8))
    areas_m2 = stats[1:count, cv2.CC_STAT_AREA] / 25.0
    assert 5 <= count - 1 <= 60
    assert np.median(areas_m2) > 2.0


def test_channels_are_lost_one_by_one_and_whole():
    white = np.full((6, 32, 32), 255, np.uint8)
    left = np.array([corrupted("channel_dropout", white, 0.5, seed) for seed in range(40)])
    kept = left.any(axis=(2, 3))
    np.testing.assert_array_equal(left.all(axis=(2, 3)), kept)
    assert len({tuple(row) for row in kept.tolist()}) > 20


def test_flicker_loses_whole_patches_of_3_2_m():
    left = corrupted("flicker", np.full((1, 192, 192), 255, np.uint8), 0.5)[0]
    patches = left.reshape(12, 16, 12, 16).swapaxes(1, 2).reshape(144, 256)
    np.testing.assert_array_equal(patches.min(axis=1), patches.max(axis=1))
    assert 40 < (patches[:, 0] == 0).sum() < 104


def test_misses_are_rare_near_the_ego_and_certain_from_30_m_on():
    white = np.full((6, 192, 192), 255, np.uint8)
    lost = np.mean([corrupted("range_misses", white, 1.0, s) == 0 for s in range(40)], axis=(0, 1))
    assert lost[152, 96] < 0.15
    # centre of the patch 8 to 24 px below the top: 27.2 m ahead, 1.6 m aside
    assert lost[8, 100] == pytest.approx(np.hypot(28.8, 1.6) / 30.0, abs=0.08)
    assert lost[0, 0] == 1.0  # 33 m away


@pytest.mark.parametrize("dose", [0.1, 0.3, 0.5, 1.0])
def test_edges_move_by_the_dose_of_1_6_m(dose, bevs):
    reach = dose * 8.0 + 0.5
    for plane in bevs[0][:3]:
        mask = plane > 0
        grown = ndimage.distance_transform_edt(~mask) <= reach
        shrunk = ndimage.distance_transform_edt(np.pad(mask, 9, mode="edge")) > reach
        np.testing.assert_array_equal(corrupted("dilation", plane[None], dose)[0] > 0, grown)
        result = corrupted("erosion", plane[None], dose)[0] > 0
        # beyond the border the view is unknown: compare where it does not matter
        inner = (slice(9, -9), slice(9, -9))
        np.testing.assert_array_equal(result[inner], shrunk[9:-9, 9:-9][inner])


def test_dilation_and_erosion_keep_probabilities():
    planes = np.zeros((1, 64, 64), np.uint8)
    planes[0, 20:40, 20:40] = 90
    geometry = BEVGeometry(size=64, ego_row=50)
    for name in ("dilation", "erosion"):
        assert set(np.unique(corrupted(name, planes, 0.5, geometry=geometry))) == {0, 90}


@pytest.mark.parametrize("seed", range(8))
def test_a_shift_moves_a_point_by_the_dose_of_4_m_in_one_direction(seed):
    point = np.zeros((1, 192, 192), np.uint8)
    point[0, 100, 90] = 255
    moves = []
    for dose in (0.3, 0.6, 1.0):
        ((_, row, column),) = np.argwhere(corrupted("shift", point, dose, seed))
        moves.append(complex(column - 90, row - 100))
        assert abs(moves[-1]) == pytest.approx(dose * 20.0, abs=0.75)
    turns = np.angle(np.array(moves) / moves[-1])
    assert np.abs(turns).max() < 0.15


def test_shifts_go_to_all_sides_and_let_black_in():
    white = np.full((1, 192, 192), 255, np.uint8)
    left = [corrupted("shift", white, 1.0, seed)[0] for seed in range(30)]
    corners = {tuple(view[[0, 0, -1, -1], [0, -1, 0, -1]] > 0) for view in left}
    assert len(corners) >= 4
    assert all(view.mean() < 255 for view in left)


@pytest.mark.parametrize("dose", [0.2, 0.5, 1.0])
def test_rotation_turns_about_the_ego_by_the_dose_of_30_degrees(dose):
    spots = np.zeros((1, 192, 192), np.uint8)
    spots[0, 151:154, 95:98] = 255
    spots[0, 51:54, 95:98] = 255  # 20 m ahead
    sides = set()
    for seed in range(8):
        turned = corrupted("rotation", spots, dose, seed)[0]
        assert turned[152, 96] == 255
        centre = np.argwhere(turned[:140]).mean(axis=0)
        turn = np.degrees(np.arctan2(centre[1] - 96.0, 152.0 - centre[0]))
        assert abs(turn) == pytest.approx(30.0 * dose, abs=0.5)
        assert corrupted("rotation", spots, 1.0, seed)[0, :140, 96:].any() == (turn > 0)
        sides.add(turn > 0)
    assert sides == {True, False}


def test_ghosts_are_added_one_after_another_and_differ_between_channels():
    black = np.zeros((6, 192, 192), np.uint8)
    views = [corrupted("ghosts", black, k / 12.0, 5) > 0 for k in range(13)]
    areas = np.array([view.sum(axis=(1, 2)) for view in views])
    assert (np.diff(areas, axis=0) >= 0).all()
    assert all((later | view == later).all() for view, later in itertools.pairwise(views))
    # 2.6 to 28 m2 each, some partly outside or on another
    assert (areas[12] > 12 * 0.3 * 64).all()
    assert (areas[12] < 12 * 1.2 * 700).all()
    assert len({view.tobytes() for view in views[12]}) == 6


def test_ghosts_remove_nothing(bevs):
    assert (corrupted("ghosts", bevs[0], 1.0) >= bevs[0]).all()


def test_latency_picks_the_bev_of_ten_frames_ago_at_dose_one():
    history = [np.full((1, 2, 2), k, np.uint8) for k in range(20)]
    picked = [int(corruptions.latency(history, dose).max()) for dose in (0.0, 0.1, 0.5, 1.0)]
    assert picked == [19, 18, 14, 9]


def test_latency_at_the_start_of_an_episode_gives_the_oldest_bev():
    history = [np.full((1, 2, 2), k, np.uint8) for k in range(3)]
    assert corruptions.latency(history, 1.0).max() == 0
    assert corruptions.latency(history, 0.1).max() == 1


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("radius_m", [4.0, 6.0, 8.0, 12.0])
def test_a_right_angle_is_traced_round_the_corner(radius_m, side):
    mask = (band(side * np.pi / 2, radius_m) > 0).astype(np.uint8)
    points, width_px = corruptions.trace_route(mask, GEOMETRY)
    ways = np.diff(points)
    turns = np.unwrap(np.angle(ways))
    assert turns[-3] - turns[0] == pytest.approx(side * np.pi / 2, abs=0.25)
    assert width_px == pytest.approx(16.0, abs=1.5)
    in_view_m = min(24.0, 4.0 + radius_m * np.pi / 2 + (19.2 - radius_m))
    assert np.abs(ways).sum() / 5.0 == pytest.approx(in_view_m, abs=2.5)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("radius_m", [4.0, 6.0, 8.0, 12.0])
@pytest.mark.parametrize("dose", [0.25, 0.5, 0.75])
def test_a_straightened_turn_is_the_turn_of_a_smaller_curvature(radius_m, side, dose):
    # long enough a lead that its direction is certain, short enough to stay in view
    shape = {"turn_rad": side * np.pi / 2, "radius_m": radius_m, "lead_m": 7.0, "length_m": 18.0}
    expected = band(curvature_share=1.0 - dose, **shape)
    result = corrupted("straightening", band(**shape)[None], dose)[0]
    assert iou(result, expected) > 0.7
    assert iou(result, expected) > iou(band(**shape), expected) + 0.05


def test_a_fully_straightened_turn_is_a_straight_of_the_same_length_and_width():
    result = corrupted("straightening", band(np.pi / 2, lead_m=10.0, length_m=22.0)[None], 1.0)[0]
    rows = np.flatnonzero(result.any(axis=1))
    assert (rows.max() - rows.min()) / 5.0 == pytest.approx(22.0, abs=1.2)
    assert (result[rows] > 0).sum(axis=1).mean() == pytest.approx(16.0, abs=1.5)
    assert iou(result, band(0.0, length_m=22.0)) > 0.75


def test_a_probable_route_stays_as_probable():
    soft = (band(np.pi / 2) > 0) * np.uint8(180)
    result = corrupted("straightening", soft[None], 0.5)
    assert set(np.unique(result)) == {0, 180}
    assert iou(result, soft[None]) < 0.8


def test_what_is_not_connected_to_the_route_stays():
    planes = band(np.pi / 2)[None].copy()
    planes[0, 5:15, 5:15] = 255
    planes[0, 60:70, 20:30] = 100  # too improbable to follow
    result = corrupted("straightening", planes, 1.0)[0]
    assert (result[5:15, 5:15] == 255).all()
    assert (result[60:70, 20:30] == 100).all()


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(0, 0), slice(0, 0)),  # nothing
        (slice(140, 153), slice(88, 104)),  # shorter than wide
        (slice(0, 60), slice(88, 104)),  # begins too far ahead
        (slice(0, 192), slice(0, 60)),  # to the side
        (slice(160, 192), slice(88, 104)),  # behind
    ],
)
def test_where_nothing_leads_away_from_the_ego_the_route_stays(rows, columns):
    planes = np.zeros((1, 192, 192), np.uint8)
    planes[0, rows, columns] = 255
    np.testing.assert_array_equal(corrupted("straightening", planes, 1.0), planes)


def test_real_turns_lose_overlap_with_every_dose_and_straights_hardly_any(drive):
    turns, straights = [], []
    for bev, turned, left_m in drive:
        route = bev[ROUTE : ROUTE + 1]
        overlaps = [iou(route, corrupted("straightening", route, dose)) for dose in DOSES]
        if turned[0] < 0.02 and turned[2] > 1.0:
            turns.append(overlaps)
        elif turned.max() < 0.01 and left_m > 40.0:
            straights.append(overlaps)
    assert min(len(turns), len(straights)) >= 5
    assert (np.diff(turns, axis=1) <= 0.005).all()
    assert np.diff(np.mean(turns, axis=0)).max() < -0.02
    assert np.mean(turns, axis=0)[-1] < 0.6
    assert np.min(straights) > 0.9


@pytest.mark.parametrize(
    "geometry",
    [
        BEVGeometry(size=16, px_per_m=20.0, ego_row=15),
        BEVGeometry(size=64, px_per_m=0.5, ego_row=0),
        BEVGeometry(size=130, px_per_m=3.3, ego_row=100),
    ],
)
@pytest.mark.parametrize("name", MODELS)
def test_any_geometry_and_any_planes_will_do(name, geometry):
    rng = np.random.default_rng(0)
    for share in (0.05, 0.5, 0.95, 1.0):
        planes = (rng.random((2, geometry.size, geometry.size)) < share).astype(np.uint8) * 255
        np.testing.assert_array_equal(corrupted(name, planes, 0.0, geometry=geometry), planes)
        for dose in (0.01, 0.5, 1.0):
            assert corrupted(name, planes, dose, geometry=geometry).shape == planes.shape
