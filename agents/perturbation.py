"""Perturbations of a driver's actions: triangular impulses on simulated time, from a seed.

After Roach's and CILRS's noise, whose impulses run on the wall clock and so never repeat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.checks import is_number, require_positive

START_S, LENGTH_S, PEAK = range(3)


@dataclass(frozen=True)
class ImpulseModel:
    """How impulses of one command come, at perturbation level 1.

    The level scales how often they come and how strong they are.

    Attributes:
        every_s: Mean time between the ends of one and the start of the next.
        length_s: Shortest and longest.
        peak: Least and greatest command at the tip, of either sign. A sum with what the driver
            asks for is clipped to [-1, 1], so above 1 an impulse may overrule the driver.
    """

    every_s: float
    length_s: tuple[float, float]
    peak: tuple[float, float]

    def __post_init__(self) -> None:
        require_positive("every_s", self.every_s)
        for name in ("length_s", "peak"):
            low, high = getattr(self, name)
            if not 0.0 < low <= high:
                raise ValueError(f"{name} must be two positive numbers in order, got {low}, {high}")


ACCELERATION_IMPULSES = ImpulseModel(every_s=10.0, length_s=(1.0, 3.0), peak=(0.3, 0.8))
STEERING_IMPULSES = ImpulseModel(every_s=5.0, length_s=(0.8, 2.0), peak=(0.6, 1.8))
"""At level 1 they overrule the expert for about a second: the car ends up in the opposing lane or
beside the road. At level 0.25 it wanders within its lane."""


def draw_impulses(
    model: ImpulseModel, level: float, until_s: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Impulses (K, 3) up to some time: start, length, peak.

    Args:
        model: How they come at level 1.
        level: From 0, none, to 1.
        until_s: The last one starts before.
        rng: Source of randomness.
    """
    impulses: list[tuple[float, float, float]] = []
    time_s = 0.0
    while level > 0.0:
        time_s += float(rng.exponential(model.every_s / level))
        length_s, peak = float(rng.uniform(*model.length_s)), float(rng.uniform(*model.peak))
        sign = 1.0 if rng.random() < 0.5 else -1.0
        if time_s >= until_s:
            break
        impulses.append((time_s, length_s, sign * level * peak))
        time_s += length_s
    return np.array(impulses, np.float64).reshape(-1, 3)


def impulse_at(impulses: NDArray[np.float64], time_s: float) -> float:
    """Sum of impulses (K, 3) at a time: each rises evenly to its peak and falls again.

    >>> impulse_at(np.array([[2.0, 1.0, 0.8]]), 2.25)
    0.4
    """
    middle = impulses[:, START_S] + impulses[:, LENGTH_S] / 2.0
    share = 1.0 - np.abs(time_s - middle) / (impulses[:, LENGTH_S] / 2.0)
    return float((impulses[:, PEAK] * np.maximum(share, 0.0)).sum())


class Perturbation:
    """The impulses of one episode.

    Args:
        level: From 0, none, to 1.
        seed: Decides all of them.
        until_s: How long the episode may last.

    Raises:
        ValueError: The level is not from 0 to 1.
    """

    def __init__(self, level: float, seed: int, until_s: float) -> None:
        if not (is_number(level) and 0.0 <= level <= 1.0):
            raise ValueError(f"perturbation level must be from 0 to 1, got {level!r}")
        rng = np.random.default_rng(seed)
        self.acceleration = draw_impulses(ACCELERATION_IMPULSES, level, until_s, rng)
        self.steering = draw_impulses(STEERING_IMPULSES, level, until_s, rng)

    def applied(self, clean: NDArray[np.float32], time_s: float) -> NDArray[np.float32]:
        """What the car is given (2,) float32 instead of a clean action, at a simulated time."""
        kick = (impulse_at(self.acceleration, time_s), impulse_at(self.steering, time_s))
        return np.clip(clean + np.array(kick, np.float32), -1.0, 1.0)
