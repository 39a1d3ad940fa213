"""The study's tables and its conclusion, worded by what was found."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from bev_driving_env.markdown import markdown
from perception.evaluation_tables import short_name

from ..correlation import RankCorrelation
from .findings import (
    BY_KIND,
    DIFFERENT_SHARE,
    EQUAL_IOU,
    EqualPair,
    Findings,
    Row,
    Standing,
)
from .metrics import DIVERGENCE, MEAN_IOU, METRICS, ONLINE, OPEN_LOOP, ROUTE_TURN

OUTCOMES = ("clean_share", "clean_drives")
STRONG, FAIR = 0.9, 0.7
"""Spearman's rho from which a proxy is called good, and fair."""
FEW = 20
"""Of fewer variants no verdict is given, whatever the intervals."""
SMALL = 0.05
"""Least share that divides equal pairs that matter from those that do not."""


def as_csv(rows: Sequence[Row], note: Mapping[str, Any]) -> str:
    """A row a variant, below comment lines that start with ``#`` and hold the provenance."""
    buffer = io.StringIO()
    for key, value in note.items():
        buffer.write(f"# {key}: {value if isinstance(value, str) else json.dumps(value)}\n")
    names = [metric.name for metric in METRICS]
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["variant", "kind", "drives", *OUTCOMES, "failed", "infractions", *names])
    for row in rows:
        driving = row.driving
        counted = " ".join(f"{name}:{count}" for name, count in driving.infractions.items())
        outcome = [f"{getattr(driving, name):.6g}" for name in OUTCOMES]
        values = [f"{row.metrics[name]:.6g}" for name in names]
        about = [row.variant.spec, row.variant.kind, len(driving.shares)]
        writer.writerow([*about, *outcome, driving.failed, counted, *values])
    return buffer.getvalue()


def as_markdown(found: Findings, agent: str, footnote: str) -> str:
    """The whole study as Markdown."""
    kinds = Counter(row.variant.kind for row in found.rows)
    counted = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    parts = [
        "# Which metric foretells driving?",
        f"{len(found.rows)} variants ({counted}), each driven by `{agent}` on {found.routes} "
        "routes.",
        "## Conclusion",
        conclusion(found),
        "## Metrics",
        "Rank correlation over variants with the share of planned metres driven before the first "
        "infraction, and with the share of clean drives; 95 % intervals over resampled sets of "
        "variants. Values are turned so that more is better: a correlation below 0 points the "
        "wrong way. Last column: by how much the first correlation is higher than mean IoU's, on "
        "the same resampled sets. Online metrics are taken on the frames that a variant itself "
        "came to, so they know its failures.",
        metric_table(found.standings),
        "## Within kinds of variants",
        "Spearman's correlation with clean metres. It is lower where variants are alike.",
        kind_table(found),
        "## Equal mean IoU, different driving",
        pairs_text(found),
        f"{footnote}",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def metric_table(standings: Sequence[Standing]) -> str:
    """A row a metric, strongest correlation first."""
    header = ["Metric", "Family", "Spearman, metres", "Kendall, metres", "Spearman, drives"]
    header += ["over mean IoU"]
    rows = []
    for each in standings:
        difference, interval = each.over_mean_iou
        name = each.metric.title + (" (less is better)" if each.metric.lower_is_better else "")
        over = "-" if each.metric.name == MEAN_IOU else with_interval(difference, interval, "+")
        rows.append([name, each.metric.family, *_correlations(each.metres)])
        rows[-1] += [_correlations(each.drives)[0], over]
    return markdown(header, rows)


def _correlations(found: RankCorrelation) -> list[str]:
    return [
        with_interval(found.spearman, found.spearman_interval),
        with_interval(found.kendall, found.kendall_interval),
    ]


def with_interval(value: float, interval: tuple[float, float], sign: str = "") -> str:
    """A figure and its interval.

    >>> with_interval(0.5, (0.25, 0.75))
    '0.50 (0.25 to 0.75)'
    """
    low, high = interval
    return f"{value:{sign}.2f} ({low:{sign}.2f} to {high:{sign}.2f})"


def kind_table(found: Findings) -> str:
    """A row a kind of variants; empty if no kind has enough of them."""
    if not found.by_kind:
        return "No kind has enough variants."
    titles = [metric.title for metric in METRICS if metric.name in BY_KIND]
    rows = [
        [kind, str(count), *(_figure(value) for value in rhos.values())]
        for kind, (count, rhos) in found.by_kind.items()
    ]
    return markdown(["Kind", "Variants", *titles], rows, text_columns=1)


def pairs_text(found: Findings) -> str:
    """The most striking pairs, and how many there are."""
    counted = (
        f"Of {found.equal_pairs} pairs of variants whose mean IoU differs by at most {EQUAL_IOU}, "
        f"{found.different_pairs} differ by {100 * DIFFERENT_SHARE:.0f} points of clean metres or "
        "more."
    )
    if not found.pairs:
        return counted
    header = ["Drives well", "Drives badly", "mean IoU", "clean metres", "route IoU at turns"]
    header += ["divergence"]
    table = markdown(header, [_pair_row(pair) for pair in found.pairs])
    return f"{counted} The most striking (no variant more than twice):\n\n{table}"


def _pair_row(pair: EqualPair) -> list[str]:
    both = (pair.better, pair.worse)
    names = [f"`{short_name(row.variant.spec)}`".replace("|", "\\|") for row in both]
    values = [[row.metrics[name] for row in both] for name in (MEAN_IOU, ROUTE_TURN, DIVERGENCE)]
    iou, turn, divergence = (" / ".join(f"{value:.2f}" for value in pair) for pair in values)
    metres = " / ".join(f"{100 * row.driving.clean_share:.0f} %" for row in both)
    return [*names, iou, metres, turn, divergence]


def conclusion(found: Findings) -> str:
    """What the figures say of the paper's question, in sentences."""
    mean_iou = found.standing(MEAN_IOU)
    if mean_iou is None:
        return "Mean IoU is the same for all variants, so nothing can be said."
    limits = (
        "No metric reaches 1: one that orders all variants rightly, but tells apart those that "
        f"drive alike, reaches {found.tie_ceiling:.2f}."
    )
    if math.isfinite(found.reliability):
        limits += (
            f" And the outcome is known from {found.routes} routes only: judged by its two "
            f"halves, chance alone would keep an ideal metric at about {found.reliability:.2f}."
        )
    return "\n\n".join([_about_mean_iou(found, mean_iou), _about_others(found, mean_iou), limits])


def _about_mean_iou(found: Findings, mean_iou: Standing) -> str:
    rho = mean_iou.metres.spearman
    words = [_grade(end) for end in mean_iou.metres.spearman_interval]
    if words == ["poor", "good"] or len(found.rows) < FEW:
        verdict = "These variants are too few to tell whether mean IoU is a proxy for driving"
    else:
        word = " to ".join(dict.fromkeys(words))
        verdict = f"Mean IoU is a {word} proxy for driving over these variants"
    share = found.different_pairs / found.equal_pairs if found.equal_pairs else 0.0
    blind = (
        "and variants that it cannot tell apart hardly ever drive very differently"
        if share < SMALL
        else "but variants that it cannot tell apart can drive very differently"
    )
    return (
        f"{verdict}: Spearman "
        f"{with_interval(rho, mean_iou.metres.spearman_interval)}. Of two variants that "
        f"drive differently, the one with the higher mean IoU drives farther in "
        f"{100 * found.agreement:.0f} % of cases, {blind}: "
        f"{100 * share:.0f} % of the pairs of equal mean IoU ({found.different_pairs} of "
        f"{found.equal_pairs}) are {100 * DIFFERENT_SHARE:.0f} points of clean metres apart."
    )


def _grade(rho: float) -> str:
    """How good a proxy with such a correlation is."""
    return "good" if rho >= STRONG else "fair" if rho >= FAIR else "poor"


def _about_others(found: Findings, mean_iou: Standing) -> str:
    others = [each for each in found.standings if each is not mean_iou]
    sentences = []
    for family in (OPEN_LOOP, ONLINE):
        standings = [each for each in others if each.metric.family == family]
        if not standings:
            continue
        best = max(standings, key=lambda each: each.metres.spearman)
        better = [each for each in standings if each.over_mean_iou.interval[0] > 0.0]
        worse = [each for each in standings if each.over_mean_iou.interval[1] < 0.0]
        difference, interval = best.over_mean_iou
        sentences.append(
            f"Of {len(standings)} other {family} metrics, {len(better)} foretell driving better "
            f"than mean IoU and {len(worse)} worse, by intervals that leave out 0. The highest is "
            f"{best.metric.title}, with "
            f"{with_interval(best.metres.spearman, best.metres.spearman_interval)}: "
            f"{with_interval(difference, interval, '+')} over mean IoU."
        )
    named = [found.standing(name) for name in (ROUTE_TURN, DIVERGENCE)]
    verdicts = [_verdict(each) for each in named if each is not None]
    if verdicts:
        sentences.append(f"Two were named beforehand: {'; '.join(verdicts)}.")
    sentences.append("(Intervals are not corrected for the number of metrics compared.)")
    return " ".join(sentences)


def _verdict(standing: Standing) -> str:
    """A metric that was singled out beforehand, against mean IoU."""
    low, high = standing.over_mean_iou.interval
    word = "better than" if low > 0.0 else "worse than" if high < 0.0 else "not told apart from"
    family, title = standing.metric.family, standing.metric.title
    rho = with_interval(standing.metres.spearman, standing.metres.spearman_interval)
    return f"{title} ({family}) is {word} mean IoU, {rho}"


def _figure(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"
