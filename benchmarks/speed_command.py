"""``bev-bench speed``: how fast it is here, side by side with highway-env."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .files import write_json
from .provenance import cpu_name, provenance
from .results import markdown
from .speed import Figure, figures


def add_parser(verbs: Any) -> None:
    """Add the verb ``speed``."""
    parser = verbs.add_parser(
        "speed",
        help="measure steps per second beside highway-env's, in one run",
        description="Measure steps per second, memory and start-up time on this machine, one "
        "thread, each environment in turn. Ratios are medians over rounds. The work per step "
        "differs: intersection-v2 simulates some ten vehicles, BEVTown draws six channels.",
    )
    parser.add_argument("--rounds", type=int, default=7, help="timings of each; default: 7")
    parser.add_argument(
        "--seconds", type=float, default=0.5, help="length of each timing; default: 0.5"
    )
    parser.add_argument("--out", type=Path, help="also write the figures to this JSON file")
    parser.set_defaults(command=run)


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 0, whether or not the targets are met."""
    if namespace.rounds < 1 or not namespace.seconds > 0.0:
        raise ValueError(
            f"--rounds and --seconds must be positive, "
            f"got {namespace.rounds} and {namespace.seconds}"
        )
    measured = figures(namespace.rounds, namespace.seconds)
    print(f"Machine: {cpu_name()}, one thread, {namespace.rounds} rounds, medians.\n")
    print(as_table(measured))
    if namespace.out is not None:
        note = provenance(argv, [])
        write_json(
            namespace.out, {"provenance": note, "figures": [asdict(entry) for entry in measured]}
        )
    return 0


def as_table(measured: Sequence[Figure]) -> str:
    """The figures as a Markdown table."""
    rows = []
    for entry in measured:
        target = entry.target and f"{entry.target}{'' if entry.met else ' (missed)'}"
        rows.append([entry.name, target, f"{entry.value:,.{_digits(entry.value)}f} {entry.unit}"])
    return markdown(["What", "Target", "Measured"], rows)


def _digits(value: float) -> int:
    return 0 if value >= 100 else 1 if value >= 10 else 2
