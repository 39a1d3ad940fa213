"""``bev-bench speed``: how fast it is here, side by side with highway-env."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_json
from bev_driving_env.markdown import markdown
from bev_driving_env.provenance import cpu_name, provenance

from .speed import figures
from .speed_cameras import metadrive_line
from .speed_figure import Figure


@dataclass(frozen=True)
class SpeedOptions:
    """Options of ``bev-bench speed``.

    Attributes:
        rounds: How often each environment is timed.
        seconds: Roughly how long each timing takes; drive logs follow, see ``log_length``.
        seed: Seed of traffic and of drive logs; without traffic, a fixed episode is driven.
        out: JSON file for the figures, or None.
    """

    rounds: int
    seconds: float
    seed: int
    out: Path | None

    def __post_init__(self) -> None:
        if self.rounds < 1:
            raise UsageError(f"--rounds must be at least 1, got {self.rounds}")
        if not 0.0 < self.seconds < 3600.0:
            raise UsageError(f"--seconds must be above 0 and below 3600, got {self.seconds}")
        if self.seed < 0:
            raise UsageError(f"--seed must be at least 0, got {self.seed}")


def add_parser(verbs: Any) -> None:
    """Add the verb ``speed``."""
    parser = verbs.add_parser(
        "speed",
        help="measure steps per second beside highway-env's, in one run",
        description="Measure steps per second, memory and start-up time on this machine, one "
        "thread, each environment in turn. Ratios are medians over rounds. The work per step "
        "differs: intersection-v2 simulates some ten vehicles, BEVTown draws six channels. The "
        "cameras are compared with OpenCV warping the bare ground to images of the same size. "
        "Drive logs are of dense traffic. The policy is the shipped 'bc'; what is trained is one "
        "like it, while a second thread renders.",
    )
    parser.add_argument("--rounds", type=int, default=7, help="timings of each; default: 7")
    parser.add_argument(
        "--seconds",
        type=float,
        default=0.5,
        help="length of each timing; less also makes the drive logs shorter; default: 0.5",
    )
    parser.add_argument("--out", type=Path, help="also write the figures to this JSON file")
    parser.add_argument("--seed", type=int, default=0, help="of traffic and drive logs; default: 0")
    parser.set_defaults(command=run, interrupted="")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 0, whether or not the targets are met."""
    options = SpeedOptions(namespace.rounds, namespace.seconds, namespace.seed, namespace.out)
    measured = figures(options.rounds, options.seconds, options.seed)
    print(f"Machine: {cpu_name()}, one thread, {options.rounds} rounds, medians.\n")
    print(as_table(measured))
    print(f"\n{metadrive_line()}")
    if options.out is not None:
        note = provenance(argv, [options.seed])
        write_json(
            options.out, {"provenance": note, "figures": [asdict(entry) for entry in measured]}
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
