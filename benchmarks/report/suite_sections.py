"""What the report shows of suites that vary the looks or the errors."""

from __future__ import annotations

from collections.abc import Sequence

from ..dose_response import Curve, curves
from ..drive import EpisodeResult
from ..results import score
from . import charts, page
from .page import Content, Markup

FEWEST_DOSES = 3
"""Of a curve, the source as it is among them."""


def dose_figures(results: Sequence[EpisodeResult]) -> list[Markup]:
    """A figure a source and agent: route driven, and clean episodes, against the dose."""
    drivers: dict[tuple[str, str], list[Curve]] = {}
    for curve in curves(results):
        if len(curve.responses) >= FEWEST_DOSES:
            drivers.setdefault((curve.source, curve.agent), []).append(curve)
    made = []
    for (source, agent), drawn in drivers.items():
        share = {c.model: [(r.dose, 100.0 * r.route_share) for r in c.responses] for c in drawn}
        clean = {
            c.model: [(r.dose, 100.0 * r.clean / r.episodes) for r in c.responses] for c in drawn
        }
        where = f"{agent} on {source} behind one error model at a time, all towns together."
        made += [
            page.figure(charts.line_chart(share, "dose", "route driven, %"), where),
            page.figure(charts.line_chart(clean, "dose", "clean episodes, %"), where),
        ]
    return made


def look_table(results: Sequence[EpisodeResult]) -> Markup | None:
    """Route metres and clean episodes by look; None if no town was driven under several."""
    scores = score(results, by_look=True)
    looks = {(entry.town, entry.appearance) for entry in scores}
    towns = list(dict.fromkeys(entry.town for entry in scores))
    if len(looks) == len(towns):
        return None
    by_key = {(e.bev, e.agent, e.appearance, e.town): e for e in scores}
    rows: list[list[Content]] = []
    for drive in dict.fromkeys(key[:3] for key in by_key):
        row: list[Content] = list(drive)
        for town in towns:
            e = by_key.get((*drive, town))
            row += [f"{e.route_m:.0f}", f"{e.clean}/{e.episodes}"] if e else ["", ""]
        rows.append(row)
    header = ["BEV source", "agent", "look"]
    for town in towns:
        header += [f"{town} route (m)", "clean"]
    caption = "The same routes under other looks: sets, and single kinds of weather of a set."
    return page.table(header, rows, caption, text_columns=3)
