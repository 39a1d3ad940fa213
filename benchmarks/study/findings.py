"""What the study finds: correlations, metrics compared, pairs that a metric cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..correlation import (
    Advantage,
    RankCorrelation,
    advantage,
    equal_but_different,
    order_agreement,
    rank_correlation,
)
from .driving import Driving
from .metrics import DIVERGENCE, MEAN_IOU, METRICS, ROUTE_TURN, Metric
from .variants import KINDS, Variant

EQUAL_IOU = 0.01
"""Mean IoUs that differ by no more count as equal."""
DIFFERENT_SHARE = 0.5
"""Shares of clean metres that differ by so much count as different driving."""
MOST_PAIRS = 10
FEWEST = 8
"""A correlation over fewer variants says too little to be shown."""
BY_KIND = (MEAN_IOU, "iou_route", ROUTE_TURN, DIVERGENCE)
"""Metrics that are also looked at within each kind of variant."""
UPPER_HALF = "upper half by mean IoU"


@dataclass(frozen=True)
class Row:
    """A variant with all that is known of it.

    Attributes:
        variant: The variant.
        driving: What its drives came to.
        metrics: Value of each metric by name.
    """

    variant: Variant
    driving: Driving
    metrics: Mapping[str, float]


@dataclass(frozen=True)
class Standing:
    """How well one metric foretells driving; values are turned so that more is better.

    Attributes:
        metric: The metric.
        metres: Correlation with the share of clean metres.
        drives: Correlation with the share of clean drives.
        over_mean_iou: How much higher its rho with clean metres is than mean IoU's.
    """

    metric: Metric
    metres: RankCorrelation
    drives: RankCorrelation
    over_mean_iou: Advantage


class EqualPair(NamedTuple):
    """Two variants of equal mean IoU that drive differently."""

    better: Row
    worse: Row

    @property
    def gap(self) -> float:
        """Difference of their shares of clean metres."""
        return self.better.driving.clean_share - self.worse.driving.clean_share


@dataclass(frozen=True)
class Findings:
    """What the study found.

    Attributes:
        rows: The variants.
        standings: Of each metric that can be told, strongest correlation first.
        by_kind: Spearman's rho with clean metres of ``BY_KIND``, within kinds of variants that
            have enough of them and within the half with the higher mean IoU; with their number.
        agreement: Share of pairs of variants that mean IoU puts in the order of their driving.
        pairs: Pairs with equal mean IoU and different driving, the most striking first; no
            variant is in more than two.
        equal_pairs: How many pairs have equal mean IoU.
        different_pairs: How many of them drive differently.
        tie_ceiling: What rho a metric reaches that puts all variants in the right order and tells
            apart those that drive alike, such as all that drive cleanly.
        reliability: What rho an ideal metric would reach, at most, see :func:`reliability`.
        routes: How many routes were driven.
    """

    rows: tuple[Row, ...]
    standings: tuple[Standing, ...]
    by_kind: Mapping[str, tuple[int, Mapping[str, float]]]
    agreement: float
    pairs: tuple[EqualPair, ...]
    equal_pairs: int
    different_pairs: int
    tie_ceiling: float
    reliability: float
    routes: int

    def standing(self, name: str) -> Standing | None:
        """That of one metric; None if it could not be told."""
        return next((each for each in self.standings if each.metric.name == name), None)


def findings(rows: Sequence[Row], seed: int = 0) -> Findings:
    """Find out what foretells driving.

    Args:
        rows: At least three variants.
        seed: Of the resampling.

    Raises:
        ValueError: Fewer variants, or all drive alike.
    """
    metres = np.array([row.driving.clean_share for row in rows])
    drives = np.array([row.driving.clean_drives for row in rows])
    if len(rows) < 3 or np.ptp(metres) == 0.0:
        raise ValueError(
            f"correlations need at least 3 variants that do not all drive alike, got {len(rows)} "
            f"with shares of clean metres from {min(metres, default=0):.2f} to "
            f"{max(metres, default=0):.2f}: choose more variants"
        )
    mean_iou = _values(rows, METRICS[0])
    standings = []
    for metric in METRICS:
        values = _values(rows, metric)
        if np.isfinite(values).sum() >= 3 and np.ptp(values[np.isfinite(values)]) > 0.0:
            standings.append(
                Standing(
                    metric,
                    rank_correlation(values, metres, seed),
                    rank_correlation(values, drives, seed),
                    advantage(values, mean_iou, metres, seed),
                )
            )
    pairs = equal_but_different(mean_iou, metres, EQUAL_IOU, DIFFERENT_SHARE)
    alike = np.abs(mean_iou[:, None] - mean_iou) <= EQUAL_IOU
    return Findings(
        rows=tuple(rows),
        standings=tuple(sorted(standings, key=lambda each: -abs(each.metres.spearman))),
        by_kind=_by_kind(rows, metres),
        agreement=order_agreement(mean_iou, metres),
        pairs=_striking([EqualPair(rows[pair.better], rows[pair.worse]) for pair in pairs]),
        equal_pairs=int((alike.sum() - len(rows)) // 2),
        different_pairs=len(pairs),
        tie_ceiling=_rho(np.argsort(np.argsort(metres, kind="stable")).astype(float), metres),
        reliability=reliability([row.driving.shares for row in rows]),
        routes=len(rows[0].driving.shares),
    )


def reliability(shares: Sequence[Sequence[float]]) -> float:
    """How well the outcome foretells itself on other routes.

    Spearman's rho between the variants' means over every other route and over the rest, stepped up
    to all routes (Spearman-Brown), and its root: the most that a metric without any noise of its
    own can correlate with the outcome. NaN with fewer than two routes.

    Args:
        shares: (V, R) clean share of each variant on each route.
    """
    table = np.asarray(shares, np.float64)
    if table.shape[1] < 2:
        return math.nan
    rho = _rho(table[:, ::2].mean(axis=1), table[:, 1::2].mean(axis=1))
    return math.sqrt(2.0 * rho / (1.0 + rho)) if rho > 0.0 else math.nan


def _values(rows: Sequence[Row], metric: Metric) -> NDArray[np.float64]:
    """A metric of all variants, more being better."""
    return metric.oriented(np.array([row.metrics[metric.name] for row in rows], np.float64))


def _rho(metric: NDArray[np.float64], outcome: NDArray[np.float64]) -> float:
    """Spearman's rho; NaN where too few are known."""
    if (np.isfinite(metric) & np.isfinite(outcome)).sum() < 3:
        return math.nan
    return rank_correlation(metric, outcome, resamples=1).spearman


def _by_kind(
    rows: Sequence[Row], metres: NDArray[np.float64]
) -> dict[str, tuple[int, Mapping[str, float]]]:
    mean_iou = _values(rows, METRICS[0])
    groups = {kind: np.array([row.variant.kind == kind for row in rows]) for kind in KINDS}
    groups[UPPER_HALF] = mean_iou >= np.median(mean_iou)
    found: dict[str, tuple[int, Mapping[str, float]]] = {}
    for name, chosen in groups.items():
        if chosen.sum() < FEWEST:
            continue
        found[name] = (
            int(chosen.sum()),
            {
                metric.name: _rho(_values(rows, metric)[chosen], metres[chosen])
                for metric in METRICS
                if metric.name in BY_KIND
            },
        )
    return found


def _striking(pairs: Sequence[EqualPair]) -> tuple[EqualPair, ...]:
    """The first pairs, without one variant being in all of them."""
    used: dict[str, int] = {}
    kept: list[EqualPair] = []
    for pair in pairs:
        specs = [pair.better.variant.spec, pair.worse.variant.spec]
        if len(kept) < MOST_PAIRS and all(used.get(spec, 0) < 2 for spec in specs):
            kept.append(pair)
            used.update({spec: used.get(spec, 0) + 1 for spec in specs})
    return tuple(kept)
