"""How well a metric of perception foretells driving: rank correlations with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
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


class Advantage(NamedTuple):
    """By how much one metric's Spearman rho is higher than another's.

    Attributes:
        difference: Of the two.
        interval: Its 95 % interval; one that leaves out 0 says that one metric is better.
    """

    difference: float
    interval: tuple[float, float]


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
    x, y = _known(outcome, metric)
    weights = _resampled(len(x), seed, resamples)
    return RankCorrelation(
        len(x),
        float(_spearman(x, y, _whole(x))[0]),
        _interval(_spearman(x, y, weights)),
        float(_kendall(x, y, _whole(x))[0]),
        _interval(_kendall(x, y, weights)),
    )


def advantage(
    metric: ArrayLike,
    other: ArrayLike,
    outcome: ArrayLike,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Advantage:
    """Compare two metrics on the same resampled sets of variants.

    That tells smaller differences than two intervals side by side do: what a set of variants does
    to one metric it mostly does to the other.

    Args:
        metric: (V,) of the variants, more of it being better.
        other: (V,) of another metric, likewise.
        outcome: (V,) what they came to in driving.
        seed: Of the resampling.
        resamples: How many.

    Raises:
        ValueError: As for :func:`rank_correlation`.
    """
    x, z, y = _known(outcome, metric, other)
    weights = _resampled(len(x), seed, resamples)
    differences = _spearman(x, y, weights) - _spearman(z, y, weights)
    whole = _spearman(x, y, _whole(x)) - _spearman(z, y, _whole(x))
    return Advantage(float(whole[0]), _interval(differences))


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


def order_agreement(metric: ArrayLike, outcome: ArrayLike) -> float:
    """Share of pairs that a metric puts in the order of their outcomes.

    Of all pairs with different outcomes, of which those with equal metrics count half; NaN if there
    are none.

    Args:
        metric: (V,) of the variants, more of it being better.
        outcome: (V,) what they came to.

    >>> order_agreement([0.1, 0.2, 0.2, 0.9], [0.0, 0.5, 1.0, 1.0])
    0.9
    """
    x, y = np.asarray(metric, np.float64), np.asarray(outcome, np.float64)
    farther = y[:, None] > y
    if not np.any(farther):
        return float("nan")
    return float((np.sign(x[:, None] - x)[farther].mean() + 1.0) / 2.0)


def _known(outcome: ArrayLike, *metrics: ArrayLike) -> list[Floats]:
    """Metrics and then the outcome, of the variants of which all are known."""
    values = [np.asarray(each, np.float64) for each in (*metrics, outcome)]
    shapes = [each.shape for each in values]
    if len(set(shapes)) > 1 or len(shapes[0]) != 1:
        *theirs, last = shapes
        raise ValueError(
            f"metric and outcome must be (V,) and (V,), got {', '.join(map(str, theirs))} "
            f"and {last}"
        )
    known = np.all(np.isfinite(values), axis=0)
    if known.sum() < 3:
        raise ValueError(f"a correlation needs at least 3 variants with both, got {known.sum()}")
    return [each[known] for each in values]


def _resampled(variants: int, seed: int, resamples: int) -> Floats:
    """How often each variant was drawn (R, V) in each resampled set."""
    drawn = np.random.default_rng(seed).integers(variants, size=(resamples, variants))
    counts = np.zeros((resamples, variants))
    np.add.at(counts, (np.arange(resamples)[:, None], drawn), 1.0)
    return counts


def _whole(x: Floats) -> Floats:
    """Each variant once."""
    return np.ones((1, len(x)))


def _spearman(x: Floats, y: Floats, weights: Floats) -> Floats:
    """Spearman's rho (R,) of sets that hold each variant as often as its weight (R, V) says."""
    of_x, of_y = _centred_ranks(x, weights), _centred_ranks(y, weights)
    spread = np.sqrt((weights * of_x**2).sum(axis=1) * (weights * of_y**2).sum(axis=1))
    return _ratio((weights * of_x * of_y).sum(axis=1), spread)


def _centred_ranks(x: Floats, weights: Floats) -> Floats:
    """Ranks (R, V) in each set less their mean; ties share the mean of their ranks."""
    # a rank is the number of those below, and half of those alike
    below = np.sign(x[:, None] - x) / 2.0
    ranks: Floats = weights @ below.T
    return ranks


def _kendall(x: Floats, y: Floats, weights: Floats) -> Floats:
    """Kendall's tau-b (R,) likewise; a variant and its copies are tied in both."""
    of_x, of_y = np.sign(x[:, None] - x), np.sign(y[:, None] - y)

    def pairs(signs: Floats) -> Floats:
        total: Floats = ((weights @ signs) * weights).sum(axis=1)
        return total

    return _ratio(pairs(of_x * of_y), np.sqrt(pairs(of_x**2) * pairs(of_y**2)))


def _ratio(part: Floats, whole: Floats) -> Floats:
    """NaN where one side is constant."""
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0.0)


def _interval(values: Floats) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return float("nan"), float("nan")
    low, high = np.quantile(known, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0]).tolist()
    return low, high
