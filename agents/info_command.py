"""``bev-agents info``: what a drive log holds."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.logs.drive_log import SPLITS, DriveLog, log_bytes

BINS = 11
BAR = 40
"""Characters of the longest bar of a histogram."""


def add_parser(verbs: Any) -> None:
    """Add the verb ``info``."""
    parser = verbs.add_parser(
        "info",
        help="print what a drive log holds",
        description="Print counts, hours, infractions, splits, the size of a sample, and "
        "histograms of the expert's actions.",
    )
    parser.add_argument("folder", type=Path, help="folder of the log")
    parser.set_defaults(command=run, interrupted="")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        LogError: The folder holds no drive log, or a damaged one.
    """
    print(describe(DriveLog(namespace.folder)))
    return 0


def describe(log: DriveLog) -> str:
    """What a log holds, as text of several lines."""
    header, samples = log.header, len(log)
    hours = samples / header.control_hz / 3600.0
    size = log_bytes(log.folder)
    traffic = header.settings["traffic"]
    signals = "with" if header.settings["traffic_lights"] else "without"
    lines = [
        f"{log.folder}: {header.town}, {len(log.episodes)} episodes, {samples:,} samples, "
        f"{hours:.2f} h at {header.control_hz} Hz",
        f"size: {size / 1e6:.2f} MB, {size / max(samples, 1):.0f} bytes a sample",
        f"traffic: {traffic['vehicles']} vehicles, {traffic['pedestrians']} pedestrians, "
        f"{signals} signals; looks: {header.settings['appearance']}; seed {header.seed}",
        f"made by: {header.provenance.get('command', 'unknown')}",
        f"outcomes: {_counted(Counter(episode.outcome for episode in log.episodes))}",
        "splits: "
        + ", ".join(f"{name} {len(log.indices(name)):,}" for name in SPLITS if name != "all"),
        "",
        *_collections(log),
    ]
    actions = log.actions()
    for column, name in enumerate(("acceleration", "steering")):
        lines += ["", f"clean {name}:", *histogram(actions[:, column])]
    return "\n".join(lines)


def _collections(log: DriveLog) -> list[str]:
    """One line a collection."""
    lines = []
    steps = np.diff(log.starts).tolist()
    for collection in sorted({episode.collection for episode in log.episodes}):
        chosen = [
            (episode, count)
            for episode, count in zip(log.episodes, steps, strict=True)
            if episode.collection == collection
        ]
        events = Counter(event["name"] for episode, _ in chosen for event in episode.infractions)
        lines.append(
            f"collection {collection}: level {chosen[0][0].level:g}, {len(chosen)} episodes, "
            f"{sum(count for _, count in chosen):,} samples; infractions: {_counted(events)}"
        )
    return lines


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.most_common()) or "none"


def histogram(values: NDArray[np.float32]) -> list[str]:
    """Bars of a histogram over [-1, 1] as lines of text; rare values keep a mark.

    >>> print(histogram(np.array([-1.0, 0.0, 0.0, 0.0], np.float32))[5])
     -0.09 to  0.09 ########################################  75.00 %
    """
    counts, edges = np.histogram(values, bins=BINS, range=(-1.0, 1.0))
    lines = []
    for count, low, high in zip(counts.tolist(), edges[:-1], edges[1:], strict=True):
        length = round(BAR * count / max(counts.max(), 1))
        bar = "#" * length or ("." if count else "")
        share = 100.0 * count / max(len(values), 1)
        lines.append(f" {low:5.2f} to {high:5.2f} {bar:{BAR}s} {share:6.2f} %")
    return lines
