from __future__ import annotations

import sys

import cv2
import gymnasium as gym
import numpy as np
import pytest

from benchmarks import speed_cameras
from bev_driving_env.towns.ground import CODE_MATERIALS

SIZE = (56, 120)


@pytest.fixture(scope="module")
def env():
    made = gym.make(
        "bev_driving_env:BEVTown02-v0", camera_size=SIZE, camera_motion=False, appearance=1
    ).unwrapped
    made.reset(seed=0, options={"episode": 0})
    return made


def test_the_homography_takes_pixels_to_the_texels_of_the_ground_they_show(env):
    frame, grid = env.sensor_frame(), env.world.town.ground.grid
    x, y, heading = env.ego_pose
    rng = np.random.default_rng(0)
    compared = 0
    for camera in range(4):
        matrix = speed_cameras.homography(env, camera)
        for ahead, left in rng.uniform(-15.0, 15.0, (60, 2)):
            seen = frame.extrinsics[camera].astype(float) @ [ahead, left, 0.0, 1.0]
            if seen[2] < 0.5:
                continue
            pixel = frame.intrinsics[camera].astype(float) @ (seen[:3] / seen[2])
            texel = matrix @ pixel
            world = (
                x + ahead * np.cos(heading) + left * np.sin(heading),
                y + ahead * np.sin(heading) - left * np.cos(heading),
            )
            expected = (np.array(world) - (grid.x0_m, grid.y0_m)) * grid.px_per_m
            np.testing.assert_allclose(texel[:2] / texel[2], expected, atol=0.05)
            compared += 1
    assert compared > 60


def test_the_ground_image_is_as_large_as_the_ground_and_tells_materials_apart(env):
    image, ground = speed_cameras.ground_image(env), env.world.town.ground
    assert image.shape == (*ground.shapes[0], 3)
    assert image.dtype == np.uint8
    codes = ground.texels[: image[..., 0].size].reshape(image.shape[:2])
    greys = {material: np.unique(image[codes == material]) for material in range(8)}
    assert all(len(values) == 1 for values in greys.values())
    assert len({int(values[0]) for values in greys.values()}) == len(set(CODE_MATERIALS[:8, 0]))


def test_the_warp_that_is_compared_with_shows_the_same_road(env):
    texture = speed_cameras.ground_image(env)
    ours = env.sensors.images(0)[0].mean(axis=-1)
    warped = speed_cameras.warp(texture, speed_cameras.homography(env, 0), SIZE)
    assert warped.shape == (*SIZE, 3)
    near = slice(40, 56)
    assert np.corrcoef(ours[near].ravel(), warped[near].mean(axis=-1).ravel())[0, 1] > 0.6


def test_the_comparison_times_both_and_leaves_opencv_as_it_was(monkeypatch):
    monkeypatch.setattr(speed_cameras, "PLACES", (("Town02", 1, 3),))
    monkeypatch.setattr(speed_cameras, "LOOKS", 1)
    threads = cv2.getNumThreads()
    ours, warps, ratio = speed_cameras.compare_with_warps(SIZE, rounds=1)
    assert cv2.getNumThreads() == threads
    assert 0.0 < warps < 1.0
    assert 0.0 < ours < 1.0
    assert ratio == pytest.approx(ours / warps)


def test_a_missed_target_is_a_missed_target(monkeypatch):
    monkeypatch.setattr(speed_cameras, "compare_with_warps", lambda *_: (0.009, 0.001, 9.0))
    monkeypatch.setattr(speed_cameras, "ipm_steps_per_s", lambda *_: 99.0)
    slow = [row for row in speed_cameras.figures(1, 0.1) if row.target]
    assert len(slow) == 3
    assert not any(row.met for row in slow)
    monkeypatch.setattr(speed_cameras, "compare_with_warps", lambda *_: (0.007, 0.001, 7.0))
    monkeypatch.setattr(speed_cameras, "ipm_steps_per_s", lambda *_: 101.0)
    assert all(row.met for row in speed_cameras.figures(1, 0.1) if row.target)


def test_metadrive_is_compared_with_only_where_it_is(monkeypatch):
    monkeypatch.setattr(speed_cameras.importlib.util, "find_spec", lambda name: None)
    assert "not installed" in speed_cameras.metadrive_line()
    monkeypatch.setattr(speed_cameras.importlib.util, "find_spec", lambda name: object())
    monkeypatch.setitem(sys.modules, "metadrive", None)
    assert "did not run here" in speed_cameras.metadrive_line()
