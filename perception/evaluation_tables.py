"""Evaluations as tables: the paper's layout in Markdown, every figure in CSV and JSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from statistics import fmean
from typing import Any

from bev_driving_env.frames import CHANNELS
from bev_driving_env.markdown import markdown

from . import SUFFIXES
from .evaluation import BANDS, Evaluation
from .evaluation_frames import CHANGES
from .places import PLACES

NOTHING = "-"
MEANS = {"Mean 0-2": CHANNELS[:3], "Mean 3-5": CHANNELS[3:]}
"""The paper's means over channels."""
COLUMNS = (
    *("log", "town", "split", "appearance", "source", "change"),
    *("place", "band", "channel", "frames", "iou", "mean_frame_iou"),
)
NOTE = (
    "IoU is dataset-level (pixels of all frames added up) unless it says per frame; a frame whose "
    "union is empty counts in no mean. Critical: in a junction or corner of the route or at most "
    "20 m before one; straight: all other frames; turn: in or at most 20 m before a junction where "
    f"the route goes left or right. {NOTHING}: not predicted, or nothing to measure."
)


def short_name(source: str) -> str:
    """Name of a source for people: of a checkpoint, what tells it from others.

    >>> short_name("runs/first_try/predictor.safetensors"), short_name("weights/mine.pt2")
    ('first_try', 'mine')
    >>> short_name("cvt_kde")
    'cvt_kde'
    """
    path = PurePath(source)
    if path.suffix not in SUFFIXES:
        return source
    return path.parent.name if path.stem == "predictor" and path.parent.name else path.stem


def row_names(evaluations: Sequence[Evaluation]) -> list[str]:
    """Names of sources in tables, with what was changed in their frames."""
    sources = {each.source for each in evaluations}
    short = {source: short_name(source) for source in sources}
    if len(set(short.values())) < len(sources):
        short = {source: source for source in sources}
    changes = [CHANGES[each.view.change] for each in evaluations]
    return [
        f"{short[each.source]}, {change}" if change else short[each.source]
        for each, change in zip(evaluations, changes, strict=True)
    ]


def tables(evaluations: Sequence[Evaluation]) -> str:
    """Evaluations of one log as Markdown, a row a source; places are those of unchanged frames."""
    first = evaluations[0]
    named = list(zip(row_names(evaluations), evaluations, strict=True))
    unchanged = [(name, each) for name, each in named if each.view.change == "none"]
    frames = ", ".join(f"{int(first.chosen(place).sum())} {place}" for place in PLACES[1:])
    quality = [(name, each.turns()) for name, each in named]
    parts = {
        f"IoU of {len(first)} frames ({frames})": _channel_table(
            "", [(name, "", each.iou()) for name, each in named]
        ),
        "Per frame, mean": _channel_table(
            "", [(name, "", each.mean_frame_iou()) for name, each in named]
        ),
        "By place": _channel_table(
            "Place",
            [(name, place, each.iou(place)) for name, each in unchanged for place in PLACES[1:]],
        ),
        "By distance": _channel_table(
            "Distance",
            [
                (name, where, each.iou(band=band))
                for name, each in unchanged
                for band, where in enumerate(BANDS)
            ],
        ),
        "Route channel in turn frames": markdown(
            ["Predictor", "Frames", "IoU", "5 %", "Median", "Under 0.5", "Under 0.7"],
            [
                [name, str(turns.frames), *map(_cell, turns[1:4]), *map(_percent, turns[4:])]
                if turns
                else [name, *[NOTHING] * 6]
                for name, turns in quality
            ],
            text_columns=1,
        ),
    }
    return "\n\n".join(f"{title}:\n\n{table}" for title, table in parts.items())


def _channel_table(place: str, rows: Sequence[tuple[str, str, Mapping[str, float]]]) -> str:
    """Rows are source, place and IoU by channel; without a name the places have no column."""
    header = ["Predictor", *([place] if place else []), *CHANNELS, *MEANS]
    cells = [
        [
            name,
            *([where] if place else []),
            *(_cell(iou.get(channel, math.nan)) for channel in CHANNELS),
            *(_cell(_mean(iou, channels)) for channels in MEANS.values()),
        ]
        for name, where, iou in rows
    ]
    return markdown(header, cells, text_columns=2 if place else 1)


def _mean(iou: Mapping[str, float], channels: Sequence[str]) -> float:
    """NaN if a channel has no figure: means over other channels do not compare."""
    return fmean(iou.get(channel, math.nan) for channel in channels)


def _cell(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else NOTHING


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %" if math.isfinite(share) else NOTHING


def rows(evaluation: Evaluation, about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every IoU of an evaluation: by place, and by distance over all places.

    Args:
        evaluation: The evaluation.
        about: Values of the first columns: log, town and split.
    """
    common = {
        **about,
        "appearance": evaluation.view.appearance,
        "source": evaluation.source,
        "change": evaluation.view.change,
    }
    made = []
    for place in PLACES:
        frames = int(evaluation.chosen(place).sum())
        for band, name in [(None, "all"), *(enumerate(BANDS) if place == "all" else ())]:
            per_frame = evaluation.mean_frame_iou(place) if band is None else {}
            for channel, iou in evaluation.iou(place, band).items():
                row = {"place": place, "band": name, "channel": channel, "frames": frames}
                figures = {"iou": iou, "mean_frame_iou": per_frame.get(channel, math.nan)}
                made.append({**common, **row, **{k: _known(v) for k, v in figures.items()}})
    return made


def as_csv(table: Sequence[Mapping[str, Any]]) -> str:
    """Rows as CSV; what is not known is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def turn_figures(evaluation: Evaluation) -> dict[str, Any] | None:
    """What is known of the route channel in turn frames, JSON-ready."""
    turns = evaluation.turns()
    return None if turns is None else {k: _known(v) for k, v in turns._asdict().items()}


def frame_figures(evaluation: Evaluation) -> list[dict[str, Any]]:
    """What each frame was, and the IoU of its route if the source predicts it, JSON-ready."""
    places = evaluation.places
    made: list[dict[str, Any]] = [
        {"sample": key.sample, "look_seed": key.look_seed, "critical": critical, "turn": turn}
        for key, critical, turn in zip(
            evaluation.keys, places.critical.tolist(), places.turn.tolist(), strict=True
        )
    ]
    if "route" in evaluation.channels:
        for row, iou in zip(made, evaluation.route_iou().tolist(), strict=True):
            row["route_iou"] = _known(iou)
    return made


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
