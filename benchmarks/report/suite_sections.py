"""What the report shows of suites that vary the looks or the errors."""

from __future__ import annotations

from collections.abc import Sequence

from ..dose_response import Curve, curves
from ..drive import EpisodeResult
from ..results import score
from . import charts
from .document import Figure
from .table import Cell, Column, Table

FEWEST_DOSES = 3
"""Of a curve, the source as it is among them."""


def dose_figures(results: Sequence[EpisodeResult]) -> list[Figure]:
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
            Figure(charts.line_chart(share, "dose", "route driven, %"), where),
            Figure(charts.line_chart(clean, "dose", "clean episodes, %"), where),
        ]
    return made


def look_table(results: Sequence[EpisodeResult]) -> Table | None:
    """Route metres and clean episodes by look; None if no town was driven under several."""
    scores = score(results, by_look=True)
    looks = {(entry.town, entry.appearance) for entry in scores}
    towns = list(dict.fromkeys(entry.town for entry in scores))
    if len(looks) == len(towns):
        return None
    by_key = {(e.bev, e.agent, e.appearance, e.town): e for e in scores}
    rows = []
    for drive in dict.fromkeys(key[:3] for key in by_key):
        row = [Cell(name) for name in drive]
        for town in towns:
            e = by_key.get((*drive, town))
            row.append(Cell(e.route_m if e else None, "{:.0f}"))
            row.append(Cell(f"{e.clean}/{e.episodes}" if e else None))
        rows.append(tuple(row))
    columns = [Column("BEV source"), Column("agent"), Column("look")]
    for town in towns:
        columns += [Column("route (m)", town), Column("clean", town)]
    return Table(
        "looks",
        "The same routes under other looks: sets, and single kinds of weather of a set.",
        tuple(columns),
        tuple(rows),
        text_columns=3,
    )
