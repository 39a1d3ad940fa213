"""How well a metric of perception foretells driving: rank correlations with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

LEVEL = 0.95
RESAMPLES = 2000


@dataclass(frozen=True)
class RankCorrelation:
    """Rank correlations of a metric with an outcome over variants, with bootstrap intervals.

    Attributes:
        variants: How many variants have both.
        spearman: Spearman's rho.
        spearman_interval: Its 95 % interval.
        kendall: Kendall's tau-b.
        kendall_interval: Its 95 % interval.
    """

    variants: int
    spearman: float
    spearman_interval: tuple[float, float]
    kendall: float
    kendall_interval: tuple[float, float]


class Pair(NamedTuple):
    """Two variants that a metric cannot tell apart, and that drive differently.

    Attributes:
        better: Number of the one that drives better.
        worse: Number of the other.
        gap: Difference of their outcomes.
    """

    better: int
    worse: int
    gap: float


def rank_correlation(
    metric: ArrayLike, outcome: ArrayLike, seed: int = 0, resamples: int = RESAMPLES
) -> RankCorrelation:
    """Correlate ranks; variants for which either is NaN are left out.

    The intervals are percentiles over resampled sets of variants (Efron's bootstrap). Resampled
    sets in which one side is constant say nothing and are left out.

    Args:
        metric: (V,) of the variants.
        outcome: (V,) what they came to in driving.
        seed: Of the resampling.
        resamples: How many.

    Raises:
        ValueError: Other shapes, or fewer than three variants with both.
    """
    x, y = np.asarray(metric, np.float64), np.asarray(outcome, np.float64)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"metric and outcome must be (V,) and (V,), got {x.shape} and {y.shape}")
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 3:
        raise ValueError(f"a correlation needs at least 3 variants with both, got {len(x)}")
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(x), size=(resamples, len(x)))
    spearman = np.array([_spearman(x[some], y[some]) for some in drawn])
    kendall = np.array([_kendall(x[some], y[some]) for some in drawn])
    return RankCorrelation(
        len(x), _spearman(x, y), _interval(spearman), _kendall(x, y), _interval(kendall)
    )


def equal_but_different(
    metric: ArrayLike, outcome: ArrayLike, tolerance: float, least_gap: float
) -> list[Pair]:
    """Pairs of variants whose metric is the same within a tolerance and whose outcome is not.

    Args:
        metric: (V,) of the variants.
        outcome: (V,) what they came to.
        tolerance: Largest difference of metrics that counts as none.
        least_gap: Smallest difference of outcomes that counts.

    Returns:
        Largest gap first.

    >>> equal_but_different([0.70, 0.705, 0.9], [100.0, 20.0, 50.0], 0.01, 30.0)
    [Pair(better=0, worse=1, gap=80.0)]
    """
    x, y = np.asarray(metric, np.float64), np.asarray(outcome, np.float64)
    alike = np.abs(x[:, None] - x) <= tolerance
    gaps = y[:, None] - y
    better, worse = np.nonzero(alike & (gaps >= least_gap))
    pairs = [Pair(int(a), int(b), float(gaps[a, b])) for a, b in zip(better, worse, strict=True)]
    return sorted(pairs, key=lambda pair: -pair.gap)


def _spearman(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return float("nan")
    return float(stats.spearmanr(x, y).statistic)


def _kendall(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return float("nan")
    return float(stats.kendalltau(x, y).statistic)


def _interval(values: NDArray[np.float64]) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan"), float("nan")
    low, high = np.quantile(known, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0]).tolist()
    return low, high
