"""``bev-bench traffic``: how a town's traffic flows, without an ego."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean
from typing import Any

from tqdm import tqdm

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_json
from bev_driving_env.markdown import markdown
from bev_driving_env.provenance import provenance
from bev_driving_env.towns.registry import town_name
from bev_driving_env.world.traffic import PRESETS

from .traffic_flow import TrafficFlow, measure_flow


@dataclass(frozen=True)
class TrafficOptions:
    """Options of ``bev-bench traffic``.

    Attributes:
        town: Towns.
        traffic: Preset.
        minutes: Simulated minutes.
        seed: Seeds.
        lights: Whether the signals work.
        out: JSON file for the figures, or None.
    """

    town: tuple[str, ...]
    traffic: str
    minutes: float
    seed: tuple[int, ...]
    lights: bool
    out: Path | None

    def __post_init__(self) -> None:
        for value in self.town:
            try:
                town_name(value)
            except ValueError as error:
                raise UsageError(str(error)) from error
        if not 0.01 <= self.minutes <= 600.0:
            raise UsageError(f"--minutes must be from 0.01 to 600, got {self.minutes}")
        if min(self.seed) < 0:
            raise UsageError(f"--seed must be at least 0, got {min(self.seed)}")


def add_parser(verbs: Any) -> None:
    """Add the verb ``traffic``."""
    parser = verbs.add_parser(
        "traffic",
        help="measure how a town's traffic flows",
        description="Let the traffic of each town run without an ego, and report vehicles an hour "
        "through each junction, mean speed, the longest standstill, and overlapping footprints.",
    )
    parser.add_argument(
        "--town", nargs="+", default=["Town01", "Town02"], metavar="TOWN", help="default: both"
    )
    parser.add_argument(
        "--traffic",
        choices=[name for name in PRESETS if name != "none"],
        default="dense",
        help="default: dense",
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="simulated; default: 10")
    parser.add_argument("--seed", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    parser.add_argument("--no-lights", action="store_true", help="leave the signals off")
    parser.add_argument("--out", type=Path, help="also write the figures to this JSON file")
    parser.set_defaults(command=run, interrupted="")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 1 if footprints overlapped, else 0."""
    options = TrafficOptions(
        town=tuple(dict.fromkeys(namespace.town)),
        traffic=namespace.traffic,
        minutes=namespace.minutes,
        seed=tuple(dict.fromkeys(namespace.seed)),
        lights=not namespace.no_lights,
        out=namespace.out,
    )
    jobs = [(town, seed) for town in options.town for seed in options.seed]
    flows = [
        measure_flow(
            town, options.traffic, lights=options.lights, seed=seed, minutes=options.minutes
        )
        for town, seed in tqdm(jobs, unit="run", desc="watching")
    ]
    print(summary_table(flows))
    for town in options.town:
        rows = [flow for flow in flows if flow.town == town]
        shares = (
            f"{name} {mean(row.per_hour[name] for row in rows):.0f}" for name in rows[0].per_hour
        )
        print(f"\n{town}, vehicles an hour through each junction: {', '.join(shares)}")
    if options.out is not None:
        note = provenance(argv, options.seed)
        write_json(options.out, {"provenance": note, "flows": [asdict(flow) for flow in flows]})
    return 1 if any(flow.contacts for flow in flows) else 0


def summary_table(flows: Sequence[TrafficFlow]) -> str:
    """One row a town, over its seeds, as a Markdown table."""
    header = ["Town", "Signals", "Seeds", "Vehicles", "People", "Minutes", "Overlaps"]
    header += [
        "Longest stand (s)",
        "Mean speed (m/s)",
        "Through a junction (1/h)",
        "Crossings (1/min)",
    ]
    rows = []
    for town in dict.fromkeys(flow.town for flow in flows):
        group = [flow for flow in flows if flow.town == town]
        through = mean(mean(flow.per_hour.values() or [0.0]) for flow in group)
        rows.append(
            [
                town,
                "on" if group[0].lights else "off",
                f"{len(group)}",
                f"{group[0].vehicles}",
                f"{group[0].pedestrians}",
                f"{group[0].minutes:g}",
                f"{sum(flow.contacts for flow in group)}",
                f"{max(flow.longest_stand_s for flow in group):.0f}",
                f"{mean(flow.mean_speed_mps for flow in group):.2f}",
                f"{through:.0f}",
                f"{mean(flow.crossings_per_minute for flow in group):.0f}",
            ]
        )
    return markdown(header, rows)
