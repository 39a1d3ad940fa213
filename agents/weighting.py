"""Weights that make rare actions count more: inverse density, by a binned kernel estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

BINS = 40
WEIGHTINGS = ("none", "kde")
SMALLEST, LARGEST = 0.2, 8.0
"""Weights relative to the median one; a few lonely samples must not rule the gradient."""


def kde_weights(actions: NDArray[np.float32]) -> NDArray[np.float64]:
    """Weights (n,) of actions (n, 2) in [-1, 1]: one over the root of their density.

    Most of a drive is going straight at cruising speed, where every command is near 0; without
    weights the network learns little of starting off and of corners. The root is a compromise
    between the samples as they come and all actions alike.

    >>> kde_weights(np.array([[0.0, 0.0]] * 99 + [[0.5, 0.0]], np.float32))[[0, -1]].round(1)
    array([1., 8.])
    """
    bins = np.clip(((actions + 1.0) * (BINS / 2.0)).astype(np.int64), 0, BINS - 1)
    counts = np.zeros((BINS, BINS))
    np.add.at(counts, (bins[:, 0], bins[:, 1]), 1.0)
    density = gaussian_filter(counts, 1.0)[bins[:, 0], bins[:, 1]]
    weights = 1.0 / np.sqrt(density)
    return np.clip(weights / np.median(weights), SMALLEST, LARGEST)
