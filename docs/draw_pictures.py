"""Draw the pictures of README and docs into docs/pictures: towns, BEV, highway-env, cameras."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import bev_driving_env
from agents import Expert
from benchmarks.maps import PALETTE
from bev_driving_env.cameras.conditions import (
    CLEAR,
    DENSE_FOG,
    DUSK,
    LIGHT_FOG,
    LOW_SUN,
    NIGHT,
    OVERCAST,
    WET,
    Condition,
)
from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.palettes import TEST_PALETTES, TRAIN_PALETTES, Palette
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import CHANNELS
from bev_driving_env.render import TownMap, bev_image, write
from bev_driving_env.sources.ipm import IPM
from bev_driving_env.towns.registry import compiled_town, route_book

gym.register_envs(bev_driving_env)

PLACES = {
    "corner": ({"episode": 2}, 23.0),
    "junction": ({"episode": 0}, 34.0),
    "straight": ({"route": 0}, 90.0),
}
"""Where in Town01 the channels are shown: reset options, route metres."""
LOOKS: tuple[tuple[str, Condition, Palette], ...] = (
    ("train", CLEAR, TRAIN_PALETTES[0]),
    ("train", CLEAR, TRAIN_PALETTES[1]),
    ("train", OVERCAST, TRAIN_PALETTES[2]),
    ("train", WET, TRAIN_PALETTES[3]),
    ("test", LIGHT_FOG, TEST_PALETTES[0]),
    ("test", LIGHT_FOG, TEST_PALETTES[2]),
    ("test", DUSK, TEST_PALETTES[1]),
    ("test", DUSK, TEST_PALETTES[2]),
    ("hard", NIGHT, TEST_PALETTES[0]),
    ("hard", DENSE_FOG, TEST_PALETTES[1]),
    ("hard", LOW_SUN, TEST_PALETTES[2]),
    ("hard", LOW_SUN, TEST_PALETTES[0]),
)
"""The rows of the contact sheet."""
HIGHWAY_IDS = ("highway-v0", "merge-v1", "roundabout-v1", "intersection-v2", "racetrack-v1")


def draw_town(town: str, width_px: int = 760) -> NDArray[np.uint8]:
    """A town with its long routes (thin) and its evaluation episodes (thick, numbered)."""
    compiled, book = compiled_town(town), route_book(town)
    x0, _, x1, _ = compiled.bounds
    picture = TownMap(compiled, width_px / (x1 - x0 + 28.0))
    for k in range(book.size("route")):
        route = book.route("route", k, compiled)
        shifted = route.points[:, :2] + (k - 4.5) * 0.3 * route.points[:, [3, 2]] * [-1.0, 1.0]
        picture.line(shifted, PALETTE[k % len(PALETTE)], 1)
    episodes = [book.route("episode", k, compiled).points for k in range(book.size("episode"))]
    for points in episodes:
        picture.line(points, (20, 24, 32), 4)
    for points in episodes:
        picture.dot(points[-1], (255, 255, 255), 5.0)
    for k, points in enumerate(episodes):
        picture.dot(points[0], (20, 24, 32), 5.0)
        picture.label(points[0], str(k))
    return picture.image


def at(town: str, options: dict[str, int], route_m: float, **keywords: Any) -> BEVTownEnv:
    """An environment whose expert has driven some route metres."""
    env = gym.make(f"BEV{town}-v0", **keywords).unwrapped
    assert isinstance(env, BEVTownEnv)
    observation, info = env.reset(seed=0, options=options)
    expert = Expert(env)
    while info["route_m"] < route_m:
        observation, _, _, _, info = env.step(expert.act(observation))
    return env


def draw_place(options: dict[str, int], route_m: float) -> NDArray[np.uint8]:
    """The BEV in colour and its first three channels, seen by the expert at some route metre."""
    bev = at("Town01", options, route_m).ground_truth_bev()
    tiles = [bev_image(bev), *(np.repeat(plane[..., None], 3, axis=2) for plane in bev[:3])]
    for tile, name in zip(tiles, ("all channels", *CHANNELS[:3]), strict=True):
        write(tile, name, (6, 14), 0.4)
        tile[:, -2:] = 255
    return np.hstack(tiles)


def draw_highway(seed: int = 3, steps: int = 5) -> NDArray[np.uint8]:
    """The BEV of five highway-env environments, side by side."""
    tiles = []
    for env_id in HIGHWAY_IDS:
        env = bev_driving_env.BEVObservation(gym.make(f"highway_env:{env_id}"))
        observation, _ = env.reset(seed=seed)
        env.action_space.seed(seed)
        for _ in range(steps):
            observation, *_ = env.step(env.action_space.sample())
        tile = bev_image(observation["bev"])
        ego = env.geometry.pixel_from_ego([[2.5, 1.0], [2.5, -1.0], [-2.5, -1.0], [-2.5, 1.0]])
        cv2.fillPoly(tile, [ego.round().astype(np.int32)], (40, 200, 90))
        write(tile, env_id, (6, 14), 0.4)
        tile[:, -2:] = 255
        tiles.append(tile)
    return np.hstack(tiles)


def draw_looks() -> NDArray[np.uint8]:
    """One place under twelve looks, four cameras each."""
    rows = []
    for seed, (appearance, condition, palette) in enumerate(LOOKS):
        env = at("Town02", {"episode": 1}, 22.0, appearance=appearance)
        renderer = env.sensors.cameras
        look = draw_look(appearance, seed, condition=condition, palette=palette)
        left, front, right, rear = (
            renderer.render(env.world.state, 0, look)[k] for k in (1, 0, 2, 3)
        )
        row = np.hstack([left, front, right, rear])
        row = np.asarray(cv2.resize(row, (800, 93), interpolation=cv2.INTER_AREA), np.uint8)
        write(row, f"{appearance}: {look.name}", (5, 14), 0.4)
        rows.append(row)
    return np.vstack(rows)


def draw_ipm() -> NDArray[np.uint8]:
    """Projected images, the BEV of ``ipm``, and the truth, at three places."""
    rows = []
    for town, options, route_m in (
        ("Town01", {"episode": 0}, 34.0),
        ("Town01", {"episode": 2}, 23.0),
        ("Town02", {"episode": 1}, 22.0),
    ):
        appearance = "train" if town == "Town01" else "test"
        env = at(town, options, route_m, bev_source="ipm", appearance=appearance)
        frame = env.sensor_frame()
        projected, _ = IPM().project(frame)
        tiles = [projected, bev_image(env.policy_view.last()[0]), bev_image(env.ground_truth_bev())]
        for tile, name in zip(tiles, ("projected images", "ipm", "truth"), strict=True):
            write(tile, name, (6, 14), 0.4)
            tile[:, -2:] = tile[-2:] = 255
        rows.append(np.hstack(tiles))
    return np.vstack(rows)


def save_photo(path: Path, image: NDArray[np.uint8], quality: int = 66) -> None:
    """Write a small JPEG."""
    Image.fromarray(image).save(path, quality=quality, optimize=True)
    print(f"{path}: {image.shape[1]} x {image.shape[0]}, {path.stat().st_size / 1000:.0f} kB")


def save(path: Path, image: NDArray[Any]) -> None:
    """Write a small PNG of at most 64 colours."""
    Image.fromarray(image).quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {image.shape[1]} x {image.shape[0]}, {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "pictures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for town in ("Town01", "Town02"):
        save(out / f"{town}.png", draw_town(town))
    rows = [draw_place(*place) for place in PLACES.values()]
    for row, name in zip(rows, PLACES, strict=True):
        write(row, name, (6, 184), 0.4)
        row[-2:] = 255
    save(out / "channels.png", np.vstack(rows))
    save(out / "highway.png", draw_highway())
    save_photo(out / "looks.jpg", draw_looks())
    save_photo(out / "ipm.jpg", draw_ipm())
    junction = at("Town02", {"episode": 1}, 26.0, bev_source="ipm", appearance="test")
    save_photo(out / "panel.jpg", junction.draw())
    busy = at("Town02", {"route": 1}, 15.0, traffic="dense", traffic_lights=True)
    save_photo(out / "traffic.jpg", busy.draw())


if __name__ == "__main__":
    main()
