"""Intervals over routes and seeds: Efron's bootstrap, and Wilson's for shares."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

LEVEL = 0.95
RESAMPLES = 2000


def resampling_weights(
    routes: Sequence[Hashable], resamples: int = RESAMPLES, seed: int = 0
) -> NDArray[np.float64]:
    """How often each drive is in each resampled set: routes are drawn, then seeds of each route.

    Drives of one route are alike, so seeds are no substitute for routes. With one seed a route
    this is the plain bootstrap.

    Args:
        routes: (N,) the route of each drive.
        resamples: Number of sets.
        seed: Of the drawing.

    Returns:
        (resamples, N) counts.
    """
    members = [
        [k for k, route in enumerate(routes) if route == each] for each in dict.fromkeys(routes)
    ]
    sizes = np.array([len(part) for part in members])
    padded = np.array([part + [0] * (int(sizes.max()) - len(part)) for part in members])
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(members), size=(resamples, len(members)))  # (B, R)
    weights = np.zeros((resamples, len(routes)))
    for k in range(int(sizes.max())):
        there = k < sizes[drawn]  # (B, R)
        number = (rng.random(drawn.shape) * sizes[drawn]).astype(np.int64)
        sets, _ = np.nonzero(there)
        np.add.at(weights, (sets, padded[drawn, number][there]), 1.0)
    return weights


def ratio_interval(
    parts: ArrayLike, wholes: ArrayLike, weights: NDArray[np.float64]
) -> tuple[float, float]:
    """95 % interval of a ratio of sums over drives, such as a pooled IoU or a mean.

    Args:
        parts: (N,) numerators of the drives.
        wholes: (N,) denominators; ones for a mean.
        weights: Of :func:`resampling_weights`.

    Returns:
        Its ends; NaN if no resampled set has a denominator.
    """
    return percentiles(ratios(parts, wholes, weights))


def ratios(
    parts: ArrayLike, wholes: ArrayLike, weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The ratio in each resampled set, (resamples,); NaN where it has no denominator."""
    above = weights @ np.asarray(parts, np.float64)
    below = weights @ np.asarray(wholes, np.float64)
    return np.divide(above, below, out=np.full_like(above, np.nan), where=below > 0.0)


def percentiles(values: NDArray[np.float64]) -> tuple[float, float]:
    """The middle 95 % of resampled values, without those that are NaN; NaN if all are."""
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan"), float("nan")
    low, high = np.quantile(known, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0]).tolist()
    return low, high


def share_interval(count: int, whole: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share, which does not vanish at 0 and 1.

    >>> tuple(round(end, 3) for end in share_interval(8, 10))
    (0.49, 0.943)
    """
    ends = stats.binomtest(count, whole).proportion_ci(LEVEL, method="wilson")
    return float(ends.low), float(ends.high)
