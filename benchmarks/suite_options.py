"""Options that verbs which drive a suite have in common."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents import make_agent
from agents.registry import FORMS
from bev_driving_env.checks import is_int, require_count
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.sources.corrupted import CORRUPTIONS
from bev_driving_env.sources.expressions import with_errors
from bev_driving_env.sources.registry import bev_source_names
from bev_driving_env.towns.registry import town_name

from .suites import SUITES, Suite


@dataclass(frozen=True)
class SuiteOptions:
    """What is driven, and where its results go.

    Attributes:
        suite: Name of the suite.
        bev: BEV sources.
        agent: Agents.
        town: Towns.
        seed: Seeds; each episode is driven once with each.
        out: Output folder.
        workers: Processes.
        overwrite: Discard what the output folder holds.

    Raises:
        ValueError: A value is out of range, or there is no such town.
    """

    suite: str
    bev: tuple[str, ...]
    agent: tuple[str, ...]
    town: tuple[str, ...]
    seed: tuple[int, ...]
    out: Path
    workers: int
    overwrite: bool

    def __post_init__(self) -> None:
        for value in self.town:
            town_name(value)
        require_count("--workers", self.workers)
        for seed in self.seed:
            require_seed(seed)

    @property
    def identity(self) -> dict[str, Any]:
        """The options that make two runs the same, JSON-ready."""
        return {
            "suite": self.suite,
            "bev": list(self.bev),
            "agent": list(self.agent),
            "town": list(self.town),
            "seed": list(self.seed),
        }


def require_seed(value: Any) -> None:
    """Raise a ``ValueError`` that names the value unless it can be a seed."""
    if not (is_int(value) and value >= 0):
        raise ValueError(f"--seed must be at least 0, got {value!r}")


def distinct(values: Sequence[Any]) -> tuple[Any, ...]:
    """The values in order, each once.

    >>> distinct([3, 1, 3])
    (3, 1)
    """
    return tuple(dict.fromkeys(values))


def suite_values(namespace: argparse.Namespace) -> dict[str, Any]:
    """Keywords of :class:`SuiteOptions` from parsed arguments."""
    lists = {name: distinct(getattr(namespace, name)) for name in ("bev", "agent", "town", "seed")}
    single = {name: getattr(namespace, name) for name in ("suite", "out", "workers", "overwrite")}
    return {**lists, **single}


def add_suite_arguments(
    parser: argparse.ArgumentParser, agent: str, bev: Sequence[str] | None = None
) -> None:
    """Add the arguments of :class:`SuiteOptions`.

    Args:
        parser: To add them to.
        agent: Default agent.
        bev: Default BEV sources; None if they must be given.
    """
    add = parser.add_argument
    add("--suite", choices=tuple(SUITES), default="paper", help="default: paper")
    add(
        "--bev",
        nargs="+",
        default=bev,
        required=bev is None,
        metavar="SOURCE",
        help=f"BEV sources: {', '.join(bev_source_names())}, 'module:factory' or the path of a "
        f"checkpoint{'' if bev is None else '; default: ' + ' '.join(bev)}",
    )
    add("--agent", nargs="+", default=[agent], metavar="AGENT", help=f"{FORMS}; default: {agent}")
    add(
        "--town",
        nargs="+",
        default=["Town01", "Town02"],
        metavar="TOWN",
        help="towns, or 'module:name' of those that a module registers; default: both",
    )
    add("--seed", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    add_folder_arguments(parser)


def add_folder_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of what is driven on all cores into a folder."""
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder for the results")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores")
    add("--overwrite", action="store_true", help="discard what the folder already holds")


def checked_specs(bevs: Sequence[str], agents: Sequence[str], town: str, suite: Suite) -> None:
    """See to it that sources and agents can be made, in one line, rather than in every episode.

    It also compiles, before workers start.

    Raises:
        ValueError: One cannot.
    """
    for source in bevs:
        # with the smallest dose of every error model, where there will be errors
        doses = dict.fromkeys(CORRUPTIONS, min(suite.doses)) if suite.doses else {}
        for spec in dict.fromkeys((source, with_errors(source, doses))):
            env = BEVTownEnv(town, bev_source=spec, **suite.conditions.keywords)
    for spec in agents:
        make_agent(spec, env)
