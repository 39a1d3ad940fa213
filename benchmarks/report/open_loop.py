"""What predictors see on drive logs: the paper's two open-loop tables beside ours."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean
from typing import Any

from bev_driving_env.frames import CHANNELS

from ..published import IOU, NAMES
from .drivers import source_label
from .table import Cell, Column, Table, with_best

SHOWN = ("Roads", "Trajectory", "Lane", "Vehicles", "Pedestrians", "Traffic light")
"""What the paper's tables call the channels, in order."""
MEANS = {"Mean (ch. 0-2)": slice(0, 3), "Mean (ch. 3-5)": slice(3, 6)}
PAPERS_SET = {"Town01": "validation", "Town02": "test"}

Figures = dict[str, dict[str, float]]
"""IoU by source and channel."""


def open_loop_tables(evaluations: Iterable[Mapping[str, Any]]) -> list[Table]:
    """Tables of what ``bev-perception evaluate`` wrote, one for each log and look.

    Args:
        evaluations: Contents of ``evaluation.json`` files.

    Raises:
        KeyError: One is not such a file.
    """
    sets: dict[tuple[str, str, str, str], Figures] = {}
    frames: dict[tuple[str, str, str, str], int] = {}
    for evaluation in evaluations:
        for row in evaluation["iou"]:
            if (row["change"], row["place"], row["band"]) != ("none", "all", "all"):
                continue
            key = (row["town"], row["log"], row["split"], row["appearance"])
            value = math.nan if row["iou"] is None else float(row["iou"])
            sets.setdefault(key, {}).setdefault(row["source"], {})[row["channel"]] = value
            frames[key] = row["frames"]
    return [_table(key, frames[key], figures) for key, figures in sorted(sets.items())]


def _table(key: tuple[str, str, str, str], frames: int, ours: Figures) -> Table:
    """The paper's layout: a row a channel, a column a predictor, its own beside them."""
    town, log, split, looks = key
    published = IOU.get(town, {})
    columns = [Column("Channel"), *(Column(source_label(source), town) for source in ours)]
    group = f"Paper, CARLA's {town} ({PAPERS_SET.get(town)})"
    columns += [Column(NAMES[name], group, elsewhere=True) for name in published]
    own = [
        _with_means([figures.get(name, math.nan) for name in CHANNELS]) for figures in ours.values()
    ]
    papers = [
        _with_means([*values, *[math.nan] * (len(CHANNELS) - len(values))])
        for values in published.values()
    ]
    rows = []
    for k, name in enumerate((*SHOWN, *MEANS)):
        cells = with_best([Cell(values[k]) for values in own])
        cells += with_best([Cell(values[k], "{:.4f}") for values in papers])
        rows.append((Cell(name), *cells))
    caption = (
        f"Open-loop IoU in {town}: {frames} frames of the drive log {log} (split {split}), looks "
        f"{looks}, pixels of all frames added up."
    )
    if published:
        caption += (
            f" Beside it the paper's {PAPERS_SET[town]} set, from another world, CARLA's own "
            "images."
        )
    return Table(f"open loop, {log}, {split}, {looks}", caption, tuple(columns), tuple(rows))


def _with_means(values: Sequence[float]) -> list[float]:
    """Values of the channels and the paper's means; NaN where a channel is missing."""
    return [*values, *(fmean(values[part]) for part in MEANS.values())]
