"""Suites: which episodes a benchmark run drives, and under which conditions."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from bev_driving_env.sources.corrupted import CORRUPTIONS
from bev_driving_env.sources.expressions import (
    corruption,
    is_corruption,
    is_mixture,
    with_errors,
)
from bev_driving_env.towns.registry import compiled_town, route_book

LOOKS = {"Town01": "train", "Town02": "test"}
"""The paper's protocol: Town01 is seen, Town02 is held out, in place and in looks."""
APPEARANCES = (
    *("train", "test", "hard"),
    *("test:clear", "test:overcast", "test:wet", "test:light_fog", "test:dusk"),
    *("hard:night", "hard:dense_fog", "hard:low_sun"),
)
"""Looks of suite ``appearance``: the sets, then one kind of weather and light at a time."""
DOSES = (0.1, 0.2, 0.4, 0.7, 1.0)
"""Doses of suite ``corruptions``; latency counts in tenths."""


@dataclass(frozen=True)
class Conditions:
    """Keywords of the environment that a suite drives with.

    Attributes:
        traffic: Other road users, a preset.
        traffic_lights: Working signals.
        terminate_on: Infractions that end an episode; None for all.
        rules: Infraction thresholds that are not the environment's own, as (field, value) pairs.
        time_limit_s: Simulated seconds until truncation; None for the environment's own.
    """

    traffic: str = "none"
    traffic_lights: bool = False
    terminate_on: tuple[str, ...] | None = None
    rules: tuple[tuple[str, float], ...] = ()
    time_limit_s: float | None = None

    @property
    def keywords(self) -> dict[str, Any]:
        """Keyword arguments of the environment."""
        return {**vars(self), "rules": dict(self.rules)}

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Conditions:
        """Inverse of ``dataclasses.asdict``, also after a round trip through JSON."""
        names = row["terminate_on"]
        rules = tuple((name, value) for name, value in row["rules"])
        return cls(
            **{
                **row,
                "terminate_on": None if names is None else tuple(names),
                "rules": rules,
            }
        )


@dataclass(frozen=True)
class Suite:
    """A set of fixed routes per town.

    Attributes:
        name: Name on the command line.
        routes: Which of a town's fixed routes are driven (suite of its ``RouteBook``).
        summary: One line for ``--help``.
        conditions: Keywords of the environment.
        leaderboard: Whether its table is the CARLA Leaderboard's, and not the paper's.
        appearances: Looks that every route is driven under; none for the paper's protocol.
        doses: Doses at which each error model is added to each BEV source, one at a time, besides
            the source as it is; none for the source as it is alone.
    """

    name: str
    routes: str
    summary: str
    conditions: Conditions = field(default_factory=Conditions)
    leaderboard: bool = False
    appearances: tuple[str, ...] = ()
    doses: tuple[float, ...] = ()

    def variants(self, bev: str) -> list[str]:
        """The BEV sources that are driven where one is asked for.

        Raises:
            ValueError: Errors are to be added to what they cannot be added to.
        """
        corrupted = [
            with_errors(bev, {model: dose})
            for model in (CORRUPTIONS if self.doses else ())
            for dose in self.doses
        ]
        return [bev, *corrupted]

    def with_traffic(self, traffic: str | None) -> Suite:
        """The same suite with other traffic; itself for None.

        Raises:
            ValueError: The suite drives without traffic.
        """
        if traffic is None:
            return self
        if self.conditions.traffic == "none":
            able = [suite.name for suite in SUITES.values() if suite.conditions.traffic != "none"]
            raise ValueError(
                f"--traffic {traffic}: suite {self.name!r} has no traffic; "
                f"leave the option out, or choose a suite that has: {', '.join(able)}"
            )
        return replace(self, conditions=replace(self.conditions, traffic=traffic))


SUITES = {
    suite.name: suite
    for suite in (
        Suite("paper", "episode", "five fixed episodes per town, no actors (the paper's protocol)"),
        Suite("routes", "test", "the 50-route test split of each town, no actors"),
        Suite("routes-val", "val", "the 50-route validation split of each town, no actors"),
        Suite("long", "route", "the ten long routes of each town, no actors"),
        Suite(
            "town",
            "route",
            "the ten long routes of each town with traffic and signals (driving score)",
            Conditions(
                traffic="light",
                traffic_lights=True,
                terminate_on=("route_deviation", "blocked"),
                # the Leaderboard's first thresholds
                rules=(("deviation_m", 30.0), ("blocked_s", 180.0)),
            ),
            leaderboard=True,
        ),
        Suite(
            "appearance",
            "episode",
            "the paper's episodes under every set of looks and in single kinds of weather",
            appearances=APPEARANCES,
        ),
        Suite(
            "corruptions",
            "episode",
            f"the paper's episodes with each error model at {len(DOSES)} doses (dose-response)",
            doses=DOSES,
        ),
    )
}


def added_error(bev: str) -> tuple[str, str, float | None]:
    """Source, error model and dose of a BEV source behind one error model.

    Of any other, itself, "" and None: also of one with several errors, or with errors on some
    channels only, which no suite drives.

    >>> added_error("cvt_kde~shift=0.5")
    ('cvt_kde', 'shift', 0.5)
    >>> added_error("cvt_kde")
    ('cvt_kde', '', None)
    """
    if is_corruption(bev) and not is_mixture(bev):
        source, doses, channels = corruption(bev)
        if len(doses) == 1 and channels is None:
            ((model, dose),) = doses.items()
            return source, model, dose
    return bev, "", None


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
        conditions: Further keywords of the environment.
    """

    town: str
    routes: str
    index: int
    bev: str
    agent: str
    seed: int
    appearance: str
    conditions: Conditions = field(default_factory=Conditions)

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

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Job:
        """Inverse of ``as_dict``, also after a round trip through JSON."""
        return cls(**{**row, "conditions": Conditions.from_dict(row["conditions"])})


def jobs_of(
    suite: Suite,
    towns: Sequence[str],
    bevs: Sequence[str],
    agents: Sequence[str],
    seeds: Sequence[int],
) -> Iterator[Job]:
    """All jobs of a run: every source, agent, seed, look and town, over all routes of the suite.

    Raises:
        ValueError: A town is unknown or has no such routes, or a source cannot be made worse.
    """
    for town in towns:
        # plans the first route, so that a town without this suite is told of before any driving
        route_book(town).route(suite.routes, 0, compiled_town(town))
    places = [(town, k) for town in towns for k in range(route_book(town).size(suite.routes))]
    variants = [variant for bev in bevs for variant in suite.variants(bev)]
    for bev, agent, seed in itertools.product(variants, agents, seeds):
        for look in suite.appearances or (None,):
            for town, index in places:
                yield Job(
                    town=town,
                    routes=suite.routes,
                    index=index,
                    bev=bev,
                    agent=agent,
                    seed=seed,
                    appearance=look or LOOKS.get(town, "train"),
                    conditions=suite.conditions,
                )
