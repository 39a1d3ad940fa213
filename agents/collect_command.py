"""``bev-agents collect``: let the expert drive a town's routes and keep what happened."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bev_driving_env.cameras.look import APPEARANCES
from bev_driving_env.command_line import UsageError
from bev_driving_env.logs.drive_log import log_bytes
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.provenance import provenance
from bev_driving_env.settings import EnvSettings
from bev_driving_env.towns.registry import town_name
from bev_driving_env.world.traffic import PRESETS

from .collect import claim_folder, collect, discard, jobs_of, log_header, perturbation_levels


@dataclass(frozen=True)
class CollectOptions:
    """Options of ``bev-agents collect``.

    Attributes:
        town: Town.
        levels: Perturbation level of each collection.
        routes: Numbers of the routes; None for all.
        traffic: Preset.
        lights: Whether the signals work.
        appearance: Set of looks for the cameras.
        time_limit_s: Simulated seconds after which an episode ends; None for the usual.
        seed: Seed.
        workers: Processes.
        out: Folder of the log.
        overwrite: Discard what the folder holds.
    """

    town: str
    levels: tuple[float, ...]
    routes: tuple[int, ...] | None
    traffic: str
    lights: bool
    appearance: str
    time_limit_s: float | None
    seed: int
    workers: int
    out: Path
    overwrite: bool

    def __post_init__(self) -> None:
        town_name(self.town)
        if not self.levels:
            raise ValueError("--collections must be at least 1")
        for level in self.levels:
            if not 0.0 <= level <= 1.0:
                raise ValueError(f"--levels must be from 0 to 1, got {level:g}")
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if self.seed < 0:
            raise ValueError(f"--seed must be at least 0, got {self.seed}")

    @property
    def settings(self) -> EnvSettings:
        """Settings of the environment that is driven in."""
        return EnvSettings(
            traffic=self.traffic,
            traffic_lights=self.lights,
            appearance=self.appearance,
            time_limit_s=self.time_limit_s,
        )


def add_parser(verbs: Any) -> None:
    """Add the verb ``collect``."""
    parser = verbs.add_parser(
        "collect",
        help="drive a town's routes and write a drive log",
        description="The expert drives each route of a town once a collection, while triangular "
        "impulses disturb its steering and throttle, and finds its way back. The log holds states, "
        "not pixels, and of each action both what the expert asked for and what the car was given. "
        "A collection that was interrupted resumes.",
    )
    parser.add_argument("--town", default="Town01", metavar="TOWN", help="default: Town01")
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument(
        "--collections",
        type=int,
        default=5,
        metavar="N",
        help="perturbed evenly from not at all to level 1; default: 5",
    )
    amount.add_argument(
        "--levels",
        nargs="+",
        type=float,
        metavar="LEVEL",
        help="one collection of each perturbation level: 0 none, 0.5 wanders within the lane, 1 "
        "is pushed into the opposing lane or off the road",
    )
    parser.add_argument(
        "--routes", nargs="+", type=int, metavar="N", help="numbers of the routes; default: all"
    )
    parser.add_argument(
        "--traffic", choices=PRESETS, default="none", help="other road users; default: none"
    )
    parser.add_argument("--lights", action="store_true", help="let the signals work")
    parser.add_argument(
        "--appearance", choices=APPEARANCES, default="train", help="looks; default: train"
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        metavar="S",
        help="simulated seconds an episode lasts at most; default: 30 and 0.8 a route metre",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")
    parser.add_argument("--out", type=Path, required=True, help="folder of the log")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores"
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="discard the log that the folder already holds"
    )
    parser.set_defaults(
        command=run,
        interrupted="; finished episodes are kept, the same command resumes (without --overwrite)",
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid; nothing has been written then.
        LogError: The folder holds something else.
    """
    try:
        options = _options(namespace)
        header = _header(options, argv)
        jobs = jobs_of(header, options.routes)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if options.overwrite:
        discard(options.out)
    claim_folder(options.out, header)
    episodes = collect(options.out, header, jobs, options.workers)
    samples = sum(steps for _, steps in episodes)
    outcomes = Counter(episode.outcome for episode, _ in episodes)
    ended = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    size_mb = log_bytes(options.out) / 1e6
    print(f"{len(episodes)} episodes ({ended}), {samples:,} samples, {size_mb:.1f} MB")
    print(f"drive log in {options.out}; look at it with: bev-agents info {options.out}")
    return 0


def _options(namespace: argparse.Namespace) -> CollectOptions:
    levels = namespace.levels or perturbation_levels(max(namespace.collections, 0))
    return CollectOptions(
        town=namespace.town,
        levels=tuple(levels),
        routes=None if namespace.routes is None else tuple(dict.fromkeys(namespace.routes)),
        traffic=namespace.traffic,
        lights=namespace.lights,
        appearance=namespace.appearance,
        time_limit_s=namespace.time_limit,
        seed=namespace.seed,
        workers=namespace.workers,
        out=namespace.out,
        overwrite=namespace.overwrite,
    )


def _header(options: CollectOptions, argv: Sequence[str]) -> LogHeader:
    """Describe the log."""
    note = provenance(argv, [options.seed])
    note["command"] = shlex.join(["bev-agents", *argv])
    note["versions"]["pyarrow"] = importlib.metadata.version("pyarrow")
    return log_header(options.town, options.settings, options.levels, options.seed, note)
