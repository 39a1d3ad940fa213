"""Reads what ``bev-perception evaluate`` wrote: a table row for each predictor."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from bev_driving_env.frames import CHANNELS

FIGURES = (*CHANNELS, "route, critical", "route, turns", "turns under 0.5")
"""Headings of ``Row.figures``."""
NOTHING = "-"


@dataclass(frozen=True)
class Row:
    """What one predictor was measured to see on one log.

    Attributes:
        source: The predictor.
        log: Name of the log's folder.
        split: Part of the log.
        appearance: What the looks were drawn from.
        change: What was changed in the frames, or ``"none"``.
        leaks: Whether the evaluation was one with changes.
        figures: Text of each of ``FIGURES``.
    """

    source: str
    log: str
    split: str
    appearance: str
    change: str
    leaks: bool
    figures: tuple[str, ...]


def read_rows(files: Iterable[Path]) -> list[Row]:
    """Rows of evaluations; what a later file says of a predictor takes the place of the earlier."""
    found: dict[tuple[Any, ...], Row] = {}
    for file in files:
        evaluation = json.loads(file.read_text(encoding="utf-8"))
        leaks = any(each["change"] != "none" for each in evaluation["results"])
        for each in evaluation["results"]:
            row = _row(each, evaluation["iou"], leaks)
            found[(row.source, row.log, row.split, row.appearance, row.change, leaks)] = row
    return list(found.values())


def _row(result: Mapping[str, Any], iou: Iterable[Mapping[str, Any]], leaks: bool) -> Row:
    same = ("log", "split", "source", "change", "appearance")
    mine = [row for row in iou if all(row[key] == result[key] for key in same)]
    known = {(row["place"], row["band"], row["channel"]): row["iou"] for row in mine}
    turns = result["turns"] or {"iou": None, "under_50": None}
    figures = (
        *(iou_text(known.get(("all", "all", channel))) for channel in CHANNELS),
        iou_text(known.get(("critical", "all", "route"))),
        iou_text(turns["iou"]),
        NOTHING if turns["under_50"] is None else f"{100.0 * turns['under_50']:.1f} %",
    )
    return Row(
        source=result["source"],
        log=PurePath(result["log"]).name,
        split=result["split"],
        appearance=result["appearance"],
        change=result["change"],
        leaks=leaks,
        figures=figures,
    )


def iou_text(value: float | None) -> str:
    """An IoU in a table; None where nothing was predicted or there was nothing to measure."""
    return NOTHING if value is None else f"{value:.3f}"
