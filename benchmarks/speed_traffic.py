"""Measuring what traffic costs, beside an empty town, highway-v0 and MetaDrive."""

from __future__ import annotations

import importlib.util
import time
from statistics import median
from typing import Any

import gymnasium as gym
from tqdm import tqdm

from .speed_figure import Figure
from .speed_steps import Timing, env_steps, highway_steps, recorded_actions

ENV_ID = "bev_driving_env:BEVTown01-v0"
ROUTE = {"route": 3}
BUSY = {"vehicles": 30, "pedestrians": 40}
HIGHWAY: dict[str, Any] = {
    "vehicles_count": 50,
    "policy_frequency": 10,
    "simulation_frequency": 20,
    "duration": 1000,
}
"""highway-v0 with its own observation (kinematics), at BEVTown's control and physics rates."""


def measure_traffic(rounds: int, seconds: float, seed: int) -> dict[str, list[float]]:
    """Time steps without traffic, with some, with NoCrash's dense, and of highway-v0, in turn.

    Args:
        rounds: How often each is timed.
        seconds: Roughly how long each timing takes.
        seed: Seed of the traffic.

    Returns:
        Seconds per step for ``empty``, ``busy`` (30 vehicles, 40 pedestrians, signals), ``dense``
        (100 and 250, signals) and ``highway``; a list of ``rounds`` values each.
    """
    keywords: dict[str, dict[str, Any]] = {
        "empty": {},
        "busy": {"traffic": BUSY, "traffic_lights": True},
        "dense": {"traffic": "dense", "traffic_lights": True},
    }
    calls: dict[str, Timing] = {}
    for name, chosen in keywords.items():
        env = gym.make(ENV_ID, terminate_on=(), **chosen)
        calls[name] = env_steps(env, recorded_actions(env, ROUTE, seed), ROUTE, seed)
    calls["highway"] = highway_steps("highway-v0", HIGHWAY, seed)
    repeats = {name: max(1, round(seconds / call(3))) for name, call in calls.items()}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in tqdm(range(rounds), unit="round", desc="timing traffic"):
        for name, call in calls.items():
            times[name].append(call(repeats[name]))
    return times


def figures(rounds: int, seconds: float, seed: int) -> list[Figure]:
    """What traffic costs; ratios are medians of the ratios of each round."""
    times = measure_traffic(rounds, seconds, seed)

    def ratio(slow: str, fast: str) -> float:
        return median(a / b for a, b in zip(times[slow], times[fast], strict=True))

    rate = {name: 1.0 / median(values) for name, values in times.items()}
    cost, faster = ratio("busy", "empty"), ratio("highway", "busy")
    measured = [
        Figure("30 vehicles, 40 pedestrians, signals", rate["busy"], "steps/s"),
        Figure("100 vehicles, 250 pedestrians, signals", rate["dense"], "steps/s"),
        Figure("highway-env highway-v0, 50 vehicles", rate["highway"], "steps/s"),
        Figure("with 30 and 40 / empty, cost of a step", cost, "x", "at most 1.5", cost <= 1.5),
        Figure("with 100 and 250 / empty", ratio("dense", "empty"), "x"),
        Figure("with 30 and 40 / highway-v0", faster, "x", "at least 50", faster >= 50.0),
    ]
    metadrive = metadrive_steps_per_s()
    if metadrive is not None:
        faster = rate["busy"] / metadrive
        measured.append(
            Figure(
                "with 30 and 40 / MetaDrive, top-down", faster, "x", "at least 10", faster >= 10.0
            )
        )
    return measured


def metadrive_steps_per_s(steps: int = 100) -> float | None:
    """Steps a second of MetaDrive's top-down observation; None where it does not run."""
    if importlib.util.find_spec("metadrive") is None:
        return None
    try:
        from metadrive.envs.top_down_env import TopDownMetaDrive

        env = TopDownMetaDrive({"log_level": 50})
        env.reset()
    except Exception:  # its assets need a network once
        return None
    try:
        env.step([0.0, 0.3])
        start = time.perf_counter()
        for _ in range(steps):
            env.step([0.0, 0.3])
        return steps / (time.perf_counter() - start)
    finally:
        env.close()
