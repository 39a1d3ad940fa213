"""Random numbers that depend on nothing but a seed and a counter: rewinding repeats them."""

from __future__ import annotations

import math

import numpy as np

from .jit import leaf_kernel


@leaf_kernel
def mix(seed: int, counter: int) -> int:
    """A well-mixed 64-bit number for a seed and a counter (splitmix64, Steele et al. 2014)."""
    z = np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15) * (np.uint64(counter) + np.uint64(1))
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@leaf_kernel
def uniform(seed: int, counter: int) -> float:
    """A number in [0, 1) for a seed and a counter."""
    return float(mix(seed, counter) >> np.uint64(11)) / 9007199254740992.0


@leaf_kernel
def normal(seed: int, counter: int) -> float:
    """A standard normal number for a seed and a counter (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, 2 * counter)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, 2 * counter + 1))
