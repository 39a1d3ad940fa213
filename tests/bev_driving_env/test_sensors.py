"""What the car senses: images that agree with their calibration, and no way back to the world."""

import dataclasses
import gc
import hashlib
import subprocess
import sys
from collections import deque

import gymnasium as gym
import numpy as np
import pytest

from bev_driving_env import SensorFrame
from bev_driving_env.cameras.rig import Camera
from bev_driving_env.kernels.layout import JUNCTION_BIT, LANE_BIT, PITCH, ROAD_BIT, ROLL
from bev_driving_env.towns.ground import (
    ASPHALT,
    CODE_EIGHTHS,
    CODE_MATERIALS,
    SIDEWALK,
    WHITE,
)
from bev_driving_env.towns.registry import compiled_town

SMALL = (56, 120)
LARGE = (224, 480)
ANY_SEED = 5


def make(**keywords):
    keywords = {"camera_size": SMALL, **keywords}
    return gym.make("bev_driving_env:BEVTown02-v0", **keywords).unwrapped


@pytest.fixture(scope="module")
def still():
    """Large images of a fixed look, from cameras that are where predictors are told."""
    return make(camera_size=LARGE, camera_motion=False, appearance=ANY_SEED, terminate_on=())


@pytest.fixture(scope="module")
def moving():
    return make(terminate_on=())


@pytest.fixture(scope="module")
def observing():
    return make(cameras=True, terminate_on=())


def drive(env, steps, gas=0.4, steering=0.0):
    for _ in range(steps):
        env.step(np.array([gas, steering], np.float32))


# --- calibration ---------------------------------------------------------------------------------


def looked_up(pixels, grid, x, y):
    """Values of a raster at world points."""
    rows = ((y - grid.y0_m) * grid.px_per_m).astype(int)
    columns = ((x - grid.x0_m) * grid.px_per_m).astype(int)
    return pixels[rows, columns]


def ground_classes(env, ahead, left):
    """Masks of ego-frame ground points that lie well inside one class, by what the town says."""
    town = compiled_town("Town02")
    x0, y0, heading = env.ego_pose
    cos, sin = np.cos(heading), np.sin(heading)
    finest = town.ground
    rows, columns = finest.shapes[0]
    texels = finest.texels[: rows * columns].reshape(rows, columns)

    def at(dx, dy):
        x, y = x0 + (ahead + dx) * cos + (left + dy) * sin, y0 + (ahead + dx) * sin
        y = y - (left + dy) * cos
        classes = town.classes()
        return (
            looked_up(texels, finest.grid, x, y),
            looked_up(classes.pixels, classes.grid, x, y),
        )

    middle, bits = at(0.0, 0.0)
    around = [at(dx, dy) for dx in (-0.25, 0.0, 0.25) for dy in (-0.25, 0.0, 0.25)]
    no_line = all_of((bits & (LANE_BIT | JUNCTION_BIT) == 0) for _, bits in around)
    return {
        "road": all_of(codes == ASPHALT for codes, _ in around) & no_line & (bits & ROAD_BIT != 0),
        "sidewalk": all_of(codes == SIDEWALK for codes, _ in around),
        "paint": is_white(middle) & (bits & LANE_BIT != 0),
    }


def is_white(codes):
    """Which texels are white paint for at least a half."""
    second = CODE_EIGHTHS.astype(int)
    first, other = (CODE_MATERIALS == WHITE).T
    return (first * (8 - second) + other * second >= 4)[codes]


def all_of(masks):
    return np.logical_and.reduce(list(masks))


def seen_at(image, intrinsics, extrinsics, ahead, left):
    """Grey levels of ground points in an image by K and E alone; NaN where out of view."""
    points = np.stack([ahead, left, np.zeros_like(ahead), np.ones_like(ahead)])
    x, y, depth = (extrinsics.astype(float) @ points)[:3]
    depth = np.where(depth > 0.5, depth, np.nan)
    u, v, _ = intrinsics.astype(float) @ np.stack([x / depth, y / depth, np.ones_like(x)])
    height, width = image.shape[:2]
    inside = (u > 1) & (u < width - 2) & (v > 1) & (v < height - 2)
    columns, rows = (np.where(inside, p, 0).round().astype(int) for p in (u, v))
    return np.where(inside, image.mean(axis=2)[rows, columns], np.nan)


def contrasts(env, frame, camera, shift=(0.0, 0.0)):
    """How far apart the classes are in an image, in spreads of the road, and the points used.

    The extrinsics may be shifted by metres ahead and to the left, to see that it matters.
    """
    ahead, left = (a.ravel() for a in np.meshgrid(np.arange(-9, 9, 0.05), np.arange(-9, 9, 0.05)))
    reach = np.hypot(ahead, left)
    near = (reach > 3.5) & (reach < 9.0)
    ahead, left = ahead[near], left[near]
    extrinsics = frame.extrinsics[camera].copy()
    extrinsics[:3, 3] += extrinsics[:3, :2] @ np.float32(shift)
    grey = seen_at(frame.images[camera], frame.intrinsics[camera], extrinsics, ahead, left)
    found = {}
    for name, mask in ground_classes(env, ahead, left).items():
        values = grey[mask & np.isfinite(grey)]
        found[name] = values if len(values) > 25 else np.full(1, np.nan)
    return {name: np.median(values) for name, values in found.items()}, found


FRONT, LEFT, RIGHT, REAR = range(4)
PLACES = [(0, 0), (0, 25), (1, 30), (3, 25)]


def test_ground_points_projected_with_k_and_e_land_on_pixels_of_their_class(still):
    # in this look paint and sidewalks are brighter than the road
    paint, sidewalk, beside, agreeing = [], [], [], []
    for episode, steps in PLACES:
        still.reset(seed=0, options={"episode": episode})
        drive(still, steps)
        frame = still.sensor_frame()
        for camera in range(4):
            medians, values = contrasts(still, frame, camera)
            paint.append(medians["paint"] - medians["road"])
            sidewalk.append(medians["sidewalk"] - medians["road"])
            if camera in (FRONT, REAR):
                moved, _ = contrasts(still, frame, camera, shift=(0.4, 0.4))
                beside.append(moved["paint"] - moved["road"])
            if np.isfinite(paint[-1]):
                middle = (medians["paint"] + medians["road"]) / 2.0
                agreeing.append((values["road"] < middle).mean())
                agreeing.append((values["paint"] > middle).mean())
    for found in (paint, sidewalk):
        assert np.isfinite(found).sum() >= 10
        assert np.nanmin(found) > 20.0
    assert np.min(agreeing) > 0.75
    # forty centimetres off, the paint is gone
    assert np.nanmax(np.abs(beside)) < 0.4 * np.nanmin(paint)


def test_the_extrinsics_stay_the_same_while_the_car_drives_and_sways(moving):
    moving.reset(seed=3)
    first = moving.sensor_frame()
    attitudes = []
    for gas, steering in [(1.0, 0.0), (1.0, 0.1), (-1.0, 0.1), (0.5, -0.2)] * 3:
        drive(moving, 3, gas, steering)
        frame = moving.sensor_frame()
        assert frame.extrinsics.tobytes() == first.extrinsics.tobytes()
        assert frame.intrinsics.tobytes() == first.intrinsics.tobytes()
        attitudes.append(moving.world.state.attitude[0].copy())
    assert np.ptp(attitudes, axis=0).min() > np.radians(0.2)


def test_the_images_of_a_swaying_car_differ_though_its_pose_is_the_same(moving):
    moving.reset(seed=3)
    level = moving.sensor_frame()
    moving.world.state.attitude[0] = np.radians([1.5, -1.0])
    swaying = moving.sensor_frame()
    assert (level.images != swaying.images).any(axis=-1).mean() > 0.2
    np.testing.assert_array_equal(level.extrinsics, swaying.extrinsics)
    np.testing.assert_array_equal(level.route_map, swaying.route_map)


def test_without_camera_motion_the_attitude_is_not_seen(still):
    still.reset(seed=3)
    level = still.sensor_frame()
    still.world.state.attitude[0] = np.radians([1.5, -1.0])
    np.testing.assert_array_equal(level.images, still.sensor_frame().images)


# --- camera motion -------------------------------------------------------------------------------


def vertical_shift(before, after, columns):
    """By how many rows a picture has moved down, in a range of columns."""
    size, most = len(before), 14
    one, other = (image[:, columns].astype(float) for image in (before, after))
    errors = {
        shift: np.abs(one[most - shift : size - most - shift] - other[most : size - most]).mean()
        for shift in range(-most + 1, most)
    }
    return min(errors, key=errors.get)


def images_at(env, pitch_deg, roll_deg):
    env.world.state.attitude[0, [PITCH, ROLL]] = np.radians([pitch_deg, roll_deg])
    return env.sensor_frame().images


@pytest.fixture(scope="module")
def swaying():
    """Large images of a car that stands in a look of its own."""
    env = make(camera_size=LARGE, appearance=ANY_SEED)
    env.reset(seed=0, options={"episode": 0})
    return env


def test_with_the_nose_down_the_front_camera_sees_everything_higher_up(swaying):
    level, braking = images_at(swaying, 0.0, 0.0), images_at(swaying, 2.0, 0.0)
    expected = np.tan(np.radians(2.0)) * swaying.sensor_frame().intrinsics[0, 0, 0]
    everywhere = slice(100, 380)
    assert vertical_shift(level[0], braking[0], everywhere) == pytest.approx(-expected, abs=2.0)
    assert vertical_shift(level[3], braking[3], everywhere) == pytest.approx(expected, abs=2.0)


def test_with_the_left_side_down_the_side_cameras_and_both_halves_ahead_agree(swaying):
    level, turning = images_at(swaying, 0.0, 0.0), images_at(swaying, 0.0, -2.0)
    everywhere = slice(100, 380)
    assert vertical_shift(level[1], turning[1], everywhere) <= -4
    assert vertical_shift(level[2], turning[2], everywhere) >= 4
    assert vertical_shift(level[0], turning[0], slice(20, 160)) < 0
    assert vertical_shift(level[0], turning[0], slice(320, 460)) > 0


def test_braking_lowers_the_nose_and_a_right_turn_the_left_side(moving):
    attitude = moving.world.state.attitude
    moving.reset(seed=0, options={"route": 0})
    drive(moving, 15, gas=1.0)
    assert attitude[0, PITCH] < -np.radians(1.0)
    drive(moving, 6, gas=-1.0)
    assert attitude[0, PITCH] > np.radians(1.0)
    for steering, sign in ((0.15, -1.0), (-0.15, 1.0)):
        moving.reset(seed=0, options={"route": 0})
        drive(moving, 15, gas=1.0)
        drive(moving, 5, gas=0.0, steering=steering)
        assert sign * attitude[0, ROLL] > np.radians(0.3)


def test_the_attitude_stays_within_two_degrees_and_comes_to_rest(moving):
    rng = np.random.default_rng(0)
    moving.reset(seed=0)
    most = 0.0
    for gas, steering in rng.uniform((-0.5, -1.0), (1.5, 1.0), (200, 2)):
        drive(moving, 1, gas, steering)
        most = max(most, np.abs(moving.world.state.attitude).max())
    assert np.radians(1.5) < most <= np.radians(2.0) + 1e-12
    drive(moving, 120, gas=-1.0)
    assert np.abs(moving.world.state.attitude).max() < np.radians(0.01)


# --- no way back to the world --------------------------------------------------------------------


def reachable(start):
    """Everything that can be reached from an object, without its class, the nearest first."""
    seen, todo = {}, deque([start])
    while todo:
        item = todo.popleft()
        if id(item) in seen or type(item) is type:
            continue
        seen[id(item)] = item
        yield item
        todo += gc.get_referents(item)
        if type(item) is np.ndarray:
            todo.append(item.base)


def test_nothing_but_numbers_can_be_reached_from_a_frame(observing):
    observing.reset(seed=0)
    frame = observing.sensor_frame()
    kinds = {type(item) for item in reachable(frame)}
    assert kinds <= {SensorFrame, dict, str, np.ndarray, type(None)}
    arrays = [item for item in reachable(frame) if isinstance(item, np.ndarray)]
    assert len(arrays) == 5
    for array in arrays:
        assert array.base is None
        assert array.flags.owndata
        assert array.dtype.kind in "uf"


def test_the_walk_would_find_a_world(observing):
    observing.reset(seed=4)
    frame = observing.sensor_frame()
    leaky = dataclasses.replace(frame, images=observing.world.state.ego[:])
    assert any(item is observing.world.state.ego for item in reachable(leaky))
    object.__setattr__(frame, "source", observing.sensors)
    assert any(item is observing.world for item in reachable(frame))


def test_a_frame_cannot_be_changed_but_its_arrays_are_the_receivers_own(observing):
    observation, _ = observing.reset(seed=4)
    kept = {name: array.copy() for name, array in observation.items()}
    first, pose = observing.sensor_frame(), observing.ego_pose
    untouched = first.copy()
    with pytest.raises(dataclasses.FrozenInstanceError):
        first.images = None
    for array in vars(first).values():
        assert array.flags.writeable
        array[:] = 0
    second = observing.sensor_frame()
    for name, array in vars(untouched).items():
        np.testing.assert_array_equal(getattr(second, name), array)
    for name, array in kept.items():
        np.testing.assert_array_equal(observation[name], array)
    assert observing.ego_pose == pose


def test_what_the_policy_is_shown_is_what_the_frame_holds(observing):
    observing.reset(seed=4)
    for _ in range(3):
        observation, *_ = observing.step([0.6, 0.1])
    frame = observing.sensor_frame()
    np.testing.assert_array_equal(observation["cameras"], frame.images)
    np.testing.assert_array_equal(observation["route_map"], frame.route_map)
    np.testing.assert_array_equal(observation["measurements"], frame.measurements)
    shapes = {name: (array.shape, array.dtype) for name, array in vars(frame).items()}
    assert shapes == {
        "images": ((4, *SMALL, 3), np.uint8),
        "intrinsics": ((4, 3, 3), np.float32),
        "extrinsics": ((4, 4, 4), np.float32),
        "route_map": ((192, 192), np.uint8),
        "measurements": ((3,), np.float32),
    }


def test_before_the_first_reset_nothing_is_sensed():
    with pytest.raises(gym.error.ResetNeeded, match="sensor_frame"):
        make().sensor_frame()


# --- rigs and looks ------------------------------------------------------------------------------


def test_size_and_number_of_the_cameras_follow_the_keywords(observing):
    one = make(cameras=True, camera_size=(40, 64), camera_rig=(Camera("only", fov_deg=60.0),))
    observation, _ = one.reset(seed=0)
    assert observation in one.observation_space
    assert observation["cameras"].shape == (1, 40, 64, 3)
    frame = one.sensor_frame()
    assert (frame.intrinsics.shape, frame.extrinsics.shape) == ((1, 3, 3), (1, 4, 4))
    assert frame.intrinsics[0, 0, 0] == pytest.approx(32.0 / np.tan(np.radians(30.0)), rel=1e-5)
    names = ("front", "left", "right", "rear", "bird")
    rig = [Camera(name, yaw_deg=yaw) for name, yaw in zip(names, (0, 90, -90, 180, 0), strict=True)]
    five = make(cameras=True, camera_size=(32, 48), camera_rig=rig)
    assert five.observation_space["cameras"].shape == (5, 32, 48, 3)
    assert five.reset(seed=0)[0] in five.observation_space
    assert observing.observation_space["cameras"].shape == (4, *SMALL, 3)
    assert "cameras" not in make().observation_space.spaces


def test_a_camera_sees_the_same_whatever_others_there_are():
    rigs = (Camera("a"), Camera("b", yaw_deg=90.0)), (Camera("b", yaw_deg=90.0),)
    images = []
    for rig in rigs:
        env = make(camera_rig=rig, camera_motion=False, appearance=1)
        env.reset(seed=0, options={"episode": 1})
        images.append(env.sensor_frame().images[-1].astype(float))
    # white balance and noise are drawn camera by camera
    assert np.corrcoef(images[0].ravel(), images[1].ravel())[0, 1] > 0.97


def views_of(appearance, seeds):
    env = make(appearance=appearance)
    images = []
    for seed in seeds:
        env.reset(seed=seed, options={"episode": 0})
        images.append(env.sensor_frame().images.astype(float))
    return np.array(images)


def test_looks_differ_between_episodes_and_an_int_is_one_look_for_all():
    fixed = views_of(3, range(4))
    assert 0.0 < np.abs(fixed - fixed[0]).mean(axis=(1, 2, 3, 4)).max() < 8.0  # sensor noise
    np.testing.assert_array_equal(fixed, views_of(3, range(4)))
    other = views_of(4, [0])
    assert np.abs(other[0] - fixed[0]).mean() > 8.0
    for appearance in ("train", "test", "hard"):
        views = views_of(appearance, range(6))
        pairs = [np.abs(a - b).mean() for k, a in enumerate(views) for b in views[:k]]
        assert np.median(pairs) > 12.0
        assert min(pairs) > 2.0


def test_only_hard_looks_have_more_to_hide_behind():
    env, hard = make(appearance="test"), make(appearance="hard")
    sparse, dense = (e.world.town.scenery(dense=d) for e, d in ((env, False), (hard, True)))
    assert len(dense.boxes) > len(sparse.boxes)
    assert len(hard.world.town.solids(dense=True).boxes) > len(sparse.boxes) / 4


# --- the same pixels everywhere ------------------------------------------------------------------

DIGEST = """
import hashlib, sys
import gymnasium as gym
env = gym.make("bev_driving_env:BEVTown02-v0", cameras=True, camera_size=(56, 120)).unwrapped
observation, _ = env.reset(seed=12)
digest = hashlib.sha256()
for _ in range(4):
    for key in ("cameras", "route_map", "measurements", "bev"):
        digest.update(observation[key].tobytes())
    observation, *_ = env.step([0.7, 0.05])
frame = env.sensor_frame()
for array in vars(frame).values():
    digest.update(array.tobytes())
print(digest.hexdigest())
"""


def test_a_seed_gives_the_same_pixels_in_every_process(capsys):
    done = subprocess.run(
        [sys.executable, "-c", DIGEST], capture_output=True, text=True, timeout=300, check=True
    )
    exec(DIGEST, {})
    here = capsys.readouterr().out.strip()
    assert done.stdout.strip() == here
    assert len(here) == len(hashlib.sha256().hexdigest())


def test_asking_for_a_frame_changes_nothing(observing):
    observing.reset(seed=8)
    drive(observing, 3)
    before = observing.snapshot()
    observing.sensor_frame()
    after = observing.snapshot()
    for item in dataclasses.fields(before.state):
        one, other = (getattr(s.state, item.name) for s in (before, after))
        np.testing.assert_array_equal(one, other)
    assert before.rng_states == after.rng_states
