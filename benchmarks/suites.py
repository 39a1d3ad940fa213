"""Suites: which episodes a benchmark run drives, and under which conditions."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bev_driving_env.towns.registry import compiled_town, route_book

LOOKS = {"Town01": "train", "Town02": "test"}
"""The paper's protocol: Town01 is seen, Town02 is held out, in place and in looks."""


@dataclass(frozen=True)
class Suite:
    """A set of fixed routes per town.

    Attributes:
        name: Name on the command line.
        routes: Which of a town's fixed routes are driven (suite of its ``RouteBook``).
        summary: One line for ``--help``.
    """

    name: str
    routes: str
    summary: str


SUITES = {
    suite.name: suite
    for suite in (
        Suite("paper", "episode", "five fixed episodes per town, no actors (the paper's protocol)"),
        Suite("routes", "test", "the 50-route test split of each town, no actors"),
        Suite("routes-val", "val", "the 50-route validation split of each town, no actors"),
        Suite("long", "route", "the ten long routes of each town, no actors"),
    )
}


@dataclass(frozen=True)
class Job:
    """One episode to drive.

    Attributes:
        town: Name of the town.
        routes: Suite of the town's ``RouteBook``.
        index: Which route of it.
        bev: BEV source.
        agent: Agent, as on the command line.
        seed: Seed of the episode.
        appearance: Look of the world.
    """

    town: str
    routes: str
    index: int
    bev: str
    agent: str
    seed: int
    appearance: str

    @property
    def key(self) -> str:
        """A file name that no other job has: readable, and unique by a hash of all fields."""
        parts = (self.town, self.routes, f"{self.index:03d}", self.bev, self.agent, str(self.seed))
        name = "__".join("".join(c if c.isalnum() else "-" for c in part) for part in parts)
        digest = hashlib.sha256(json.dumps(self.as_dict()).encode()).hexdigest()
        return f"{name[:120]}__{digest[:8]}"

    @property
    def options(self) -> dict[str, Any]:
        """The reset options that choose the route."""
        if self.routes in ("episode", "route"):
            return {self.routes: self.index}
        return {"split": self.routes, "index": self.index}

    def as_dict(self) -> dict[str, Any]:
        """The fields, for results."""
        return asdict(self)


def jobs_of(
    suite: Suite,
    towns: Sequence[str],
    bevs: Sequence[str],
    agents: Sequence[str],
    seeds: Sequence[int],
) -> Iterator[Job]:
    """All jobs of a run: every source, agent, seed and town, over all routes of the suite.

    Raises:
        ValueError: A town is unknown or has no such routes.
    """
    for town in towns:
        # plans the first route, so that a town without this suite is told of before any driving
        route_book(town).route(suite.routes, 0, compiled_town(town))
    for bev in bevs:
        for agent in agents:
            for seed in seeds:
                for town in towns:
                    for index in range(route_book(town).size(suite.routes)):
                        look = LOOKS.get(town, "train")
                        yield Job(town, suite.routes, index, bev, agent, seed, look)
