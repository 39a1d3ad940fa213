"""Measuring predictors: steps with cameras rendered and a BEV predicted, alone and in a batch.

It needs PyTorch, so it is imported only when it is measured.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from statistics import median

import gymnasium as gym
import numpy as np
import torch
from tqdm import tqdm

from bev_driving_env.cameras.rig import CameraRig
from perception.models.presets import build_model, model_spec

from .speed_figure import Figure
from .speed_steps import Timing, env_steps, recorded_actions

ENV_ID = "bev_driving_env:BEVTown01-v0"
EPISODE = {"episode": 1}
WORLDS = 8
LEAST_STEPS_PER_S = {"cvt_kde": 30.0, "ipm_unet_kde": 50.0}
"""Predictors that are measured, and what they should reach on two cores."""


def measure_steps(
    sources: Mapping[str, object], worlds: int, *, rounds: int, seconds: float
) -> dict[str, dict[str, list[float]]]:
    """Time steps of one environment and of a vector environment, in turn, PyTorch on all cores.

    Args:
        sources: BEV sources by name.
        worlds: Worlds of the vector environment; all frames go through the network as a batch.
        rounds: How often each is timed.
        seconds: Roughly how long each timing takes.

    Returns:
        For each source seconds per step and world: ``single`` and ``vector``, lists of ``rounds``
        values each.
    """
    actions = recorded_actions(gym.make(ENV_ID), EPISODE)
    tiled = [np.tile(action, (worlds, 1)) for action in actions]
    times: dict[str, dict[str, list[float]]] = {}
    for name, source in sources.items():
        calls: dict[str, Timing] = {
            "single": env_steps(gym.make(ENV_ID, bev_source=source), actions, EPISODE, seed=0),
            "vector": env_steps(
                gym.make_vec(ENV_ID, num_envs=worlds, bev_source=source), tiled, EPISODE, seed=0
            ),
        }
        batch = {"single": 1, "vector": worlds}
        repeats = {kind: max(1, round(seconds / call(2))) for kind, call in calls.items()}
        times[name] = {kind: [] for kind in calls}
        for _ in tqdm(range(rounds), unit="round", desc=f"timing {name}"):
            for kind, call in calls.items():
                times[name][kind].append(call(repeats[kind]) / batch[kind])
    return times


def preset_ms(preset: str, rounds: int) -> float:
    """Milliseconds that a preset's network, with random weights, takes for one frame."""
    spec = model_spec(preset)
    rig, side = CameraRig(size=spec.camera_size), 192
    inputs = {
        "images": torch.zeros((1, *rig.shape), dtype=torch.uint8),
        "intrinsics": torch.from_numpy(rig.intrinsics())[None],
        "extrinsics": torch.from_numpy(rig.extrinsics())[None],
        "route_map": torch.zeros((1, side, side), dtype=torch.uint8),
        "ground": torch.zeros((1, side, side, 3), dtype=torch.uint8),
    }
    model = build_model(spec).eval()
    taken = []
    with torch.inference_mode():
        model(inputs)
        for _ in range(rounds):
            start = time.perf_counter()
            model(inputs)
            taken.append(time.perf_counter() - start)
    return 1000.0 * median(taken)


def figures(rounds: int, seconds: float) -> list[Figure]:
    """Steps with predictors; ratios are medians of the ratios of each round."""
    times = measure_steps(
        {name: name for name in LEAST_STEPS_PER_S}, WORLDS, rounds=rounds, seconds=seconds
    )
    rows = []
    for name, least in LEAST_STEPS_PER_S.items():
        single, vector = times[name]["single"], times[name]["vector"]
        rate = 1.0 / median(single)
        ratio = median(b / a for a, b in zip(single, vector, strict=True))
        rows += [
            Figure(
                f"one env, cameras and {name}",
                rate,
                "steps/s",
                f"at least {least:g} on two cores",
                rate >= least,
            ),
            Figure(
                f"{name}: a step in {WORLDS} worlds / in one env",
                ratio,
                "x",
                "under 1",
                ratio < 1.0,
            ),
        ]
    rows.append(Figure("preset paper, one frame", preset_ms("paper", rounds), "ms"))
    return rows
