"""Measuring speed: ratios taken in one run, one thread, in turn, so that they survive noise."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Mapping
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from . import speed_cameras, speed_logs, speed_traffic
from .speed_figure import Figure
from .speed_steps import Timing, env_steps, highway_steps, recorded_actions

ENV_ID = "bev_driving_env:BEVTown01-v0"
WORLDS = 64
EPISODE = {"episode": 1}
INTERSECTION: dict[str, Any] = {
    "observation": {
        "type": "GrayscaleObservation",
        "observation_shape": (192, 192),
        "stack_size": 1,
        "weights": [0.2989, 0.5870, 0.1140],
    },
    "policy_frequency": 10,
    "simulation_frequency": 20,
    "offscreen_rendering": True,
}
"""intersection-v2 with a 192 x 192 image, at BEVTown's control and physics rates."""


def measure_steps(rounds: int, seconds: float, seed: int) -> dict[str, list[float]]:
    """Time steps of all environments in turn.

    Resets are not timed: highway-env simulates seconds of traffic in its own. The car drives an
    episode with the expert's actions, recorded beforehand, so that views and routes are real.

    Args:
        rounds: How often each is timed.
        seconds: Roughly how long each timing takes.
        seed: Seed of highway-env's traffic.

    Returns:
        Seconds per step and world for ``single``, ``vector`` (64 worlds) and ``highway``, and
        seconds per ``copy`` of an observation; a list of ``rounds`` values each.
    """
    actions = recorded_actions(gym.make(ENV_ID), EPISODE)
    tiled = [np.tile(action, (WORLDS, 1)) for action in actions]
    calls: dict[str, Timing] = {
        "single": env_steps(gym.make(ENV_ID), actions, EPISODE),
        "vector": env_steps(gym.make_vec(ENV_ID, num_envs=WORLDS), tiled, EPISODE),
        "highway": highway_steps("intersection-v2", INTERSECTION, seed),
        "copy": _copy(),
    }
    batch = {"single": 1, "vector": WORLDS, "highway": 1, "copy": 1}
    repeats = {name: max(1, round(seconds / call(3))) for name, call in calls.items()}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in tqdm(range(rounds), unit="round", desc="timing"):
        for name, call in calls.items():
            times[name].append(call(repeats[name]) / batch[name])
    return times


def _copy() -> Timing:
    bev = np.ones((6, 192, 192), np.uint8)

    def run(copies: int) -> float:
        start = time.perf_counter()
        for _ in range(copies):
            bev.copy()
        return (time.perf_counter() - start) / copies

    return run


def bytes_per_world(worlds: int = WORLDS) -> float:
    """Memory that each further world of a vector environment takes, observations aside."""
    from bev_driving_env.towns.registry import compiled_town, route_book
    from bev_driving_env.world.config import WorldConfig
    from bev_driving_env.world.core import World

    town = compiled_town("Town01")
    # the longest of the fixed routes, so that no user's world is larger
    book = route_book("Town01")
    routes = [book.route("route", k, town) for k in range(book.size("route"))]
    longest = max(routes, key=lambda route: route.length_m)
    World(town, WorldConfig())
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        world = World(town, WorldConfig(), worlds)
        for k in range(worlds):
            world.place(k, longest)
        world.step(np.zeros((worlds, 2)))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # the warm-up's image is freed by now, so what is left is state
    return (after - before) / worlds


FIRST_USE = """
import time; start = time.perf_counter()
import gymnasium, numpy, bev_driving_env
imported = time.perf_counter() - start
env = gymnasium.make("BEVTown01-v0")
env.reset(seed=0); env.step(numpy.zeros(2))
print(imported, time.perf_counter() - start)
"""


def measure_first_use(rounds: int = 3) -> dict[str, float]:
    """Time a fresh process up to its first step, without and with cached machine code.

    Returns:
        Seconds: ``cold`` (compiling), ``warm`` and ``import`` (medians of the rounds).
    """
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        cold = _first_use(environment)[1]
        warm = [_first_use(environment) for _ in range(rounds)]
    return {
        "cold": cold,
        "warm": median(total for _, total in warm),
        "import": median(imported for imported, _ in warm),
    }


def _first_use(environment: Mapping[str, str]) -> tuple[float, float]:
    done = subprocess.run(
        [sys.executable, "-c", FIRST_USE],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    imported, total = done.stdout.split()
    return float(imported), float(total)


def figures(rounds: int, seconds: float, seed: int = 0) -> list[Figure]:
    """Measure everything; ratios are medians of the ratios of each round."""
    times = measure_steps(rounds, seconds, seed)

    def ratio(slow: str, fast: str) -> float:
        return median(a / b for a, b in zip(times[slow], times[fast], strict=True))

    first = measure_first_use()
    memory_mb = bytes_per_world() / 1e6
    faster, copies, per_core = (
        ratio("highway", "single"),
        ratio("single", "copy"),
        ratio("single", "vector"),
    )
    rate = {name: 1.0 / median(values) for name, values in times.items()}
    measured = [
        Figure("BEVTown01-v0, ground-truth BEV, one env", rate["single"], "steps/s"),
        Figure("BEVTown01-v0, vector env, 64 worlds", rate["vector"], "steps/s"),
        Figure("highway-env intersection-v2, 192 x 192 gray", rate["highway"], "steps/s"),
        Figure("one env / intersection-v2", faster, "x", "at least 50", faster >= 50.0),
        Figure("vector env / one env, per core", per_core, "x", "at least 1.5", per_core >= 1.5),
        Figure("copy of one observation (221 kB)", 1e6 / rate["copy"], "µs"),
        Figure("a step, in such copies", copies, "copies", "at most 35", copies <= 35.0),
        Figure("memory per further world", memory_mb, "MB", "under 2", memory_mb < 2.0),
        Figure("first use, compiling", first["cold"], "s", "under 60", first["cold"] < 60.0),
        Figure("first use, cached", first["warm"], "s", "under 3", first["warm"] < 3.0),
        Figure(
            "gymnasium and bev_driving_env imported",
            first["import"],
            "s",
            "under 0.5",
            first["import"] < 0.5,
        ),
        *speed_traffic.figures(rounds, seconds, seed),
        *speed_cameras.figures(rounds, seconds),
        *speed_logs.figures(rounds, seconds, seed),
    ]
    # PyTorch takes seconds to load, and nothing before needs it
    from . import speed_policy, speed_predictors

    return [
        *measured,
        *speed_policy.figures(rounds, seconds, seed),
        *speed_predictors.figures(rounds, seconds),
    ]
