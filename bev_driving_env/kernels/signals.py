"""Traffic signals: what each shows, as a function of time and the episode's seed alone."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import SIGNAL_GREEN, SIGNAL_RED, SIGNAL_YELLOW
from .noise import mix, uniform

OFFSETS = 0x51674A15
"""Keeps the offsets' random numbers apart from all others of the episode."""


class SignalPlan(NamedTuple):
    """How a town's signals take turns: at each junction one approach after the other.

    Attributes:
        junction: (S,) int64 number of each signal's junction.
        phase: (S,) int64, which of the junction's phases is its own.
        phases: (S,) int64 number of phases at its junction.
        green_s: How long each approach has green.
        yellow_s: And yellow after that.
        all_red_s: And how long all have red before the next.
    """

    junction: NDArray
    phase: NDArray
    phases: NDArray
    green_s: float
    yellow_s: float
    all_red_s: float


@leaf_kernel
def show_signals(plan: SignalPlan, time_s: float, seed: int, signals: NDArray) -> None:
    """Set one world's signals (S,) to what they show at a time; each junction has its offset."""
    slot_s = plan.green_s + plan.yellow_s + plan.all_red_s
    for k in range(plan.phase.shape[0]):
        cycle_s = slot_s * plan.phases[k]
        offset_s = cycle_s * uniform(mix(seed, OFFSETS), plan.junction[k])
        since_s = (time_s + offset_s - plan.phase[k] * slot_s) % cycle_s
        if since_s < plan.green_s:
            signals[k] = SIGNAL_GREEN
        elif since_s < plan.green_s + plan.yellow_s:
            signals[k] = SIGNAL_YELLOW
        else:
            signals[k] = SIGNAL_RED
