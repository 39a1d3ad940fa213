"""Dose-response: how far drives come, against the dose of each error in what they see."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from bev_driving_env.markdown import markdown

from .drive import EpisodeResult
from .maps import PALETTE
from .suites import added_error


class Response(NamedTuple):
    """What came of one dose, over all towns, routes and seeds.

    Attributes:
        dose: The dose; 0 is the source as it is.
        route_share: Driven of all planned metres.
        clean: Episodes completed without an infraction.
        episodes: How many there were.
    """

    dose: float
    route_share: float
    clean: int
    episodes: int


@dataclass(frozen=True)
class Curve:
    """The responses to one error model.

    Attributes:
        source: BEV source that the errors are added to.
        agent: Who drives.
        model: Name of the error model.
        responses: By rising dose; dose 0 first, if the source as it is was driven.
    """

    source: str
    agent: str
    model: str
    responses: tuple[Response, ...]


def curves(results: Sequence[EpisodeResult]) -> list[Curve]:
    """The curves that results hold, in the order in which they were driven.

    Args:
        results: Of any suite; what is behind no error model, or behind several, counts as dose 0.
    """
    groups: dict[tuple[str, str, str], dict[float, list[EpisodeResult]]] = {}
    unharmed: dict[tuple[str, str], list[EpisodeResult]] = {}
    for result in results:
        source, model, dose = added_error(result.job.bev)
        driver = (source, result.job.agent)
        if dose is None:
            unharmed.setdefault(driver, []).append(result)
        else:
            groups.setdefault((*driver, model), {}).setdefault(dose, []).append(result)
    made = []
    for (source, agent, model), by_dose in groups.items():
        base = unharmed.get((source, agent))
        doses = {**({0.0: base} if base else {}), **by_dose}
        responses = tuple(_response(dose, doses[dose]) for dose in sorted(doses))
        made.append(Curve(source, agent, model, responses))
    return made


def _response(dose: float, drives: Sequence[EpisodeResult]) -> Response:
    planned_m = sum(drive.planned_m for drive in drives)
    share = sum(drive.driven_m for drive in drives) / planned_m if planned_m > 0.0 else 0.0
    return Response(dose, share, sum(drive.clean for drive in drives), len(drives))


def dose_table(drawn: Sequence[Curve]) -> str:
    """Driven share of the route and clean episodes as Markdown, a row an error model."""
    doses = sorted({each.dose for curve in drawn for each in curve.responses})
    header = ["BEV source", "Agent", "Error model", *(f"dose {dose:g}" for dose in doses)]
    rows = []
    for curve in drawn:
        cells = {
            each.dose: f"{100.0 * each.route_share:.0f} % ({each.clean}/{each.episodes})"
            for each in curve.responses
        }
        names = [curve.source, curve.agent, curve.model]
        rows.append([*names, *(cells.get(dose, "") for dose in doses)])
    return markdown(header, rows, text_columns=3)


def draw_curves(drawn: Sequence[Curve], note: dict[str, Any]) -> bytes:
    """The curves as PNG, a row of two panels a source and agent.

    Args:
        drawn: The curves; at least one.
        note: Provenance, kept in the text chunk ``provenance``.
    """
    from matplotlib.figure import Figure

    drivers = list(dict.fromkeys((curve.source, curve.agent) for curve in drawn))
    models = list(dict.fromkeys(curve.model for curve in drawn))
    figure = Figure(figsize=(9.0, 0.7 + 3.3 * len(drivers)), layout="constrained")
    panels = figure.subplots(len(drivers), 2, squeeze=False, sharex=True, sharey=True)
    for (source, agent), (left, right) in zip(drivers, panels, strict=True):
        left.set_ylabel(f"{source}, {agent}")
        for curve in drawn:
            if (curve.source, curve.agent) == (source, agent):
                doses = [each.dose for each in curve.responses]
                shares = [each.route_share for each in curve.responses]
                clean = [each.clean / each.episodes for each in curve.responses]
                style = _style(models.index(curve.model))
                left.plot(doses, shares, label=curve.model, **style)
                right.plot(doses, clean, label=curve.model, **style)
    for panel in panels.ravel():
        panel.grid(alpha=0.3)
        panel.set_ylim(-0.03, 1.03)
    for panel, title in zip(
        panels[0], ("route driven, share", "clean episodes, share"), strict=True
    ):
        panel.set_title(title, fontsize="medium")
    for panel in panels[-1]:
        panel.set_xlabel("dose")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside right", fontsize="small")
    buffer = io.BytesIO()
    metadata = {"Software": None, "provenance": json.dumps(note)}
    figure.savefig(buffer, format="png", dpi=110, metadata=metadata)
    return buffer.getvalue()


def _style(number: int) -> dict[str, Any]:
    """Line style of an error model: colours, then the same ones dashed."""
    colour = tuple(value / 255.0 for value in PALETTE[number % len(PALETTE)])
    dashed = number >= len(PALETTE)
    return {"color": colour, "linestyle": "--" if dashed else "-", "marker": "s" if dashed else "o"}
