"""Measuring the cameras: beside OpenCV warping the bare ground, and as part of a step."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bev_driving_env.cameras.rig import CAMERA_SIZE, PAPER_CAMERA_SIZE, ground_points
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import world_from_ego
from bev_driving_env.towns.ground import CODE_MATERIALS

from .speed_figure import Figure

PLACES = (("Town01", 0, 60), ("Town01", 3, 100), ("Town02", 1, 80), ("Town02", 3, 30))
"""Town, evaluation episode, and after how many of the expert's steps the cameras look around."""
LOOKS = 4
"""Episode seeds at each place, and with them looks."""
MOST_WARPS = 8.0
LEAST_STEPS_PER_S = 100.0

Images = NDArray[np.uint8]


def figures(rounds: int, seconds: float) -> list[Figure]:
    """Measure the cameras; ratios are medians over places, looks and rounds."""
    rows = []
    for size in (CAMERA_SIZE, PAPER_CAMERA_SIZE):
        ours, warps, ratio = compare_with_warps(size, rounds)
        name = f"{size[0]} x {size[1]}"
        rows += [
            Figure(f"four cameras {name}", 1000.0 * ours, "ms"),
            Figure(f"four cv2.warpPerspective {name}, nearest", 1000.0 * warps, "ms"),
            Figure(
                f"cameras / warps {name}",
                ratio,
                "x",
                f"at most {MOST_WARPS:g}",
                ratio <= MOST_WARPS,
            ),
        ]
    rate = ipm_steps_per_s(seconds * rounds)
    rows.append(
        Figure(
            "one env, cameras and ipm",
            rate,
            "steps/s",
            f"at least {LEAST_STEPS_PER_S:g}",
            rate >= LEAST_STEPS_PER_S,
        )
    )
    return rows


def compare_with_warps(size: tuple[int, int], rounds: int) -> tuple[float, float, float]:
    """Time four images beside four warps of the ground to the same images, in turn.

    Args:
        size: Height and width of an image.
        rounds: How often each is timed at each place and look.

    Returns:
        Seconds for our images and for the warps (medians), and the median of their ratios.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    ours: list[float] = []
    warps: list[float] = []
    try:
        for town, episode, steps in tqdm(PLACES, unit="place", desc=f"cameras {size[1]}"):
            env = _at_place(town, episode, steps, size)
            texture = ground_image(env)
            maps = [homography(env, k) for k in range(env.sensors.settings.rig.shape[0])]
            for look in range(LOOKS):
                env.world.state.episode_seed[0] = look
                for _ in range(rounds):
                    ours.append(_time(lambda env=env: env.sensors.images(0)))  # type: ignore[misc]
                    warps.append(
                        _time(lambda t=texture, m=maps: [warp(t, one, size) for one in m])  # type: ignore[misc]
                    )
    finally:
        cv2.setNumThreads(threads)
    ratios = [a / b for a, b in zip(ours, warps, strict=True)]
    return median(ours), median(warps), median(ratios)


def _time(call: Callable[[], Any], repeats: int = 5) -> float:
    """Shortest of a few times a call takes; the first call is not counted."""
    call()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return min(taken)


def _at_place(town: str, episode: int, steps: int, size: tuple[int, int]) -> BEVTownEnv:
    """An environment whose car has driven a while."""
    from agents import Expert

    env = gym.make(f"bev_driving_env:BEV{town}-v0", camera_size=size).unwrapped
    assert isinstance(env, BEVTownEnv)
    observation, _ = env.reset(seed=0, options={"episode": episode})
    expert = Expert(env)
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
    return env


def ground_image(env: BEVTownEnv) -> Images:
    """The town's ground (rows, columns, 3) at the finest level of its texture, in plain colours."""
    ground = env.world.town.ground
    rows, columns = ground.shapes[0]
    grey = np.linspace(40, 240, 8)[CODE_MATERIALS[:, 0]].astype(np.uint8)
    codes = ground.texels[: rows * columns].reshape(rows, columns)
    return np.repeat(grey[np.minimum(codes, len(grey) - 1)][..., None], 3, axis=2)


def homography(env: BEVTownEnv, camera: int) -> NDArray[np.float64]:
    """From the pixels of a camera to those of the ground image (3, 3), for level ground."""
    rig, grid = env.sensors.settings.rig, env.world.town.ground.grid
    height, width = rig.size
    # four pixels below the horizon fix it
    corners = [
        (0, height - 1),
        (width - 1, height - 1),
        (width - 1, 0.7 * height),
        (0, 0.7 * height),
    ]
    pixels = np.array(corners, np.float64)
    seen = ground_points(rig.intrinsics()[camera], rig.extrinsics()[camera], pixels)
    texels = (world_from_ego(env.ego_pose, seen) - (grid.x0_m, grid.y0_m)) * grid.px_per_m
    matrix = cv2.getPerspectiveTransform(pixels.astype(np.float32), texels.astype(np.float32))
    return np.asarray(matrix, np.float64)


def warp(texture: Images, matrix: NDArray[np.float64], size: tuple[int, int]) -> Images:
    """What OpenCV makes of bare ground: one image (H, W, 3), nearest pixel."""
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(texture, matrix, size[::-1], flags=flags), np.uint8)


def ipm_steps_per_s(seconds: float) -> float:
    """Steps a second with cameras observed and ``ipm`` as the policy's view."""
    env = gym.make("bev_driving_env:BEVTown01-v0", bev_source="ipm", cameras=True)
    env.reset(seed=0, options={"route": 0})
    action = np.array([0.1, 0.0], np.float32)
    env.step(action)
    count, taken = 0, 0.0
    while taken < seconds:
        start = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(action)
        taken += time.perf_counter() - start
        count += 1
        if terminated or truncated:
            env.reset(options={"route": 0})
    return count / taken


def metadrive_line() -> str:
    """A line about MetaDrive's RGB camera, which is compared with where it is installed."""
    if importlib.util.find_spec("metadrive") is None:
        return "MetaDrive is not installed: its RGB camera was not compared with."
    try:
        return f"MetaDrive's RGB camera: {_metadrive_steps_per_s():.1f} steps/s."
    except Exception as error:  # it needs OpenGL and, once, a network
        return f"MetaDrive's RGB camera did not run here: {type(error).__name__}: {error}"


def _metadrive_steps_per_s(steps: int = 50) -> float:
    """Steps a second of MetaDrive with four RGB images of 112 x 240."""
    from metadrive.component.sensors.rgb_camera import RGBCamera
    from metadrive.envs.metadrive_env import MetaDriveEnv

    height, width = CAMERA_SIZE
    env = MetaDriveEnv(
        {
            "image_observation": True,
            "sensors": {"rgb_camera": (RGBCamera, width, height)},
            "vehicle_config": {"image_source": "rgb_camera"},
            "stack_size": 1,
            "log_level": 50,
        }
    )
    try:
        env.reset()
        env.step([0.0, 0.3])
        start = time.perf_counter()
        for _ in range(steps):
            env.step([0.0, 0.3])
        # one camera there, four here
        return steps / (time.perf_counter() - start) / 4.0
    finally:
        env.close()
