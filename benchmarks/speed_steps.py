"""Timing the steps of an environment along a recorded drive, resets aside."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

Timing = Callable[[int], float]
"""Does something a number of times and returns the mean seconds it took."""


def recorded_actions(
    env: gym.Env[Any, Any], options: Mapping[str, Any], seed: int = 0, most: int = 2000
) -> list[NDArray[np.float32]]:
    """The expert's actions on one episode, but its last, so that it never ends while timed."""
    from agents import Expert

    observation, _ = env.reset(seed=seed, options=dict(options))
    actions: list[NDArray[np.float32]] = []
    expert, ended = Expert(env), False
    while not ended and len(actions) < most:
        actions.append(expert.act(observation))
        observation, _, terminated, truncated, _ = env.step(actions[-1])
        ended = terminated or truncated
    return actions[:-5]


def env_steps(
    env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any],
    actions: Sequence[Any],
    options: Mapping[str, Any],
    seed: int | None = None,
) -> Timing:
    """Times steps along an episode, resetting (untimed) before it ends."""
    position = len(actions)

    def run(steps: int) -> float:
        nonlocal position
        taken = 0.0
        for _ in range(steps):
            if position == len(actions):
                env.reset(seed=seed, options=dict(options))
                position = 0
            start = time.perf_counter()
            env.step(actions[position])
            taken += time.perf_counter() - start
            position += 1
        return taken / steps

    return run


def highway_steps(name: str, config: Mapping[str, Any], seed: int) -> Timing:
    """Times steps of a highway-env environment; its resets, with seconds of traffic, are not."""
    env = gym.make(f"highway_env:{name}", config=dict(config))
    env.reset(seed=seed)

    def run(steps: int) -> float:
        taken = 0.0
        for _ in range(steps):
            start = time.perf_counter()
            _, _, terminated, truncated, _ = env.step(1)
            taken += time.perf_counter() - start
            if terminated or truncated:
                env.reset()
        return taken / steps

    return run
