"""The learning rate of each step."""

from __future__ import annotations

import math

WARM_UP = 0.15
"""Share of the steps in which the learning rate rises."""


def one_cycle(step: int, steps: int, peak: float) -> float:
    """Learning rate of a step: half a cosine up from peak / 25, then one down to almost 0.

    >>> one_cycle(15, 100, 1.0), round(one_cycle(99, 100, 1.0), 4)
    (1.0, 0.0004)
    """
    rise = WARM_UP * steps
    if step < rise:
        low, high, share = peak / 25.0, peak, step / rise
    else:
        low, high, share = peak, peak / 10000.0, (step - rise) / (steps - rise)
    return low + (high - low) * 0.5 * (1.0 - math.cos(math.pi * share))
