"""The study's figure: mean IoU against driving, and how well each metric foretells it."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..maps import PALETTE
from .findings import Findings
from .metrics import MEAN_IOU, OPEN_LOOP
from .variants import KINDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE_IN, DPI = (13.0, 7.0), 120


def draw(found: Findings, note: Mapping[str, Any]) -> bytes:
    """The figure as PNG, with its provenance."""
    from matplotlib.figure import Figure  # takes half a second

    figure = Figure(figsize=SIZE_IN, layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_variants(left, found)
    _draw_metrics(right, found)
    buffer = io.BytesIO()
    about = {"provenance": json.dumps(dict(note))}
    figure.savefig(buffer, format="png", dpi=DPI, metadata=about)
    return buffer.getvalue()


def _draw_variants(axes: Axes, found: Findings) -> None:
    for number, kind in enumerate(KINDS):
        rows = [row for row in found.rows if row.variant.kind == kind]
        if rows:
            axes.scatter(
                [row.metrics[MEAN_IOU] for row in rows],
                [100.0 * row.driving.clean_share for row in rows],
                color=[_colour(number)],
                edgecolor="white",
                linewidth=0.5,
                label=kind,
            )
    axes.set_xlabel("mean IoU of road, route, lane")
    axes.set_ylabel("planned metres driven before the first infraction, %")
    axes.set_title(f"{len(found.rows)} variants on {found.routes} routes")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _draw_metrics(axes: Axes, found: Findings) -> None:
    """A bar a metric, the strongest on top; whiskers are 95 % intervals."""
    for place, each in enumerate(reversed(found.standings)):
        rho, (low, high) = each.metres.spearman, each.metres.spearman_interval
        if rho < 0.0:  # the size is drawn; a metric that points the wrong way is hatched
            low, high = -high, -low
        axes.barh(
            place,
            abs(rho),
            xerr=[[max(abs(rho) - low, 0.0)], [max(high - abs(rho), 0.0)]],
            color=_colour(0 if each.metric.family == OPEN_LOOP else 1),
            hatch="//" if rho < 0.0 else None,
            ecolor="black",
            capsize=2,
            alpha=1.0 if each.metric.name == MEAN_IOU else 0.6,
        )
    names = [f"{each.metric.title}, {each.metric.family}" for each in reversed(found.standings)]
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("|Spearman's rho| with clean metres, 95 % interval")
    axes.grid(axis="x", alpha=0.3)


def _colour(number: int) -> tuple[float, float, float]:
    red, green, blue = PALETTE[number]
    return red / 255.0, green / 255.0, blue / 255.0
