"""``RouteBook``: a town's fixed routes, and how the splits were drawn."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..checks import is_int
from ..files import write_text
from .compiled import CompiledTown
from .route import Route, random_route, route_by_turns

SUITES = ("route", "episode", "val", "test")
"""Long routes, evaluation episodes, and the two splits."""
POOL = 1000
"""Random routes that a suite is chosen from."""


@dataclass(frozen=True)
class Draw:
    """How a suite is drawn.

    Attributes:
        seed: Seed of the stream of random routes.
        size: Number of routes.
        shortest_m: Least length.
        longest_m: Greatest length.
    """

    seed: int
    size: int
    shortest_m: float
    longest_m: float


SPLITS = {"val": Draw(1, 50, 80.0, 400.0), "test": Draw(2, 50, 80.0, 400.0)}
OTHERS = {"route": Draw(3, 10, 400.0, 1200.0), "episode": Draw(4, 5, 80.0, 160.0)}
"""Suites of the built-in towns that come from elsewhere; other towns may have them drawn."""


@dataclass(frozen=True)
class RouteSpec:
    """A route as it is written down: start, decisions, end (world metres)."""

    start: tuple[float, float]
    turns: str
    end: tuple[float, float]


@dataclass(frozen=True)
class RouteBook:
    """The fixed routes of a town by suite.

    Attributes:
        town: Name of the town.
        suites: Route specifications by suite name (``SUITES``).
    """

    town: str
    suites: Mapping[str, tuple[RouteSpec, ...]] = field(repr=False)
    _planned: dict[RouteSpec, Route] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def read(cls, town: str, path: Path) -> RouteBook:
        """Read a JSON file: suite -> list of {"start", "turns", "end"}.

        Raises:
            ValueError: The file is not such a file; the message names it.
        """
        try:
            table = json.loads(path.read_text(encoding="utf-8"))
            suites = {
                suite: tuple(
                    RouteSpec(tuple(row["start"]), row["turns"], tuple(row["end"])) for row in rows
                )
                for suite, rows in table.items()
            }
        except (OSError, KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} is not a route file of town {town!r}: {error!r}") from error
        return cls(town, suites)

    def write(self, path: Path) -> None:
        """Write the JSON file, one route a line."""
        blocks = []
        for suite, specs in self.suites.items():
            rows = [
                json.dumps({"start": spec.start, "turns": spec.turns, "end": spec.end})
                for spec in specs
            ]
            blocks.append(f' "{suite}": [\n  ' + ",\n  ".join(rows) + "\n ]")
        write_text(path, "{\n" + ",\n".join(blocks) + "\n}\n")

    def size(self, suite: str) -> int:
        """Number of routes in a suite, 0 if the town has no such suite."""
        return len(self.suites.get(suite, ()))

    def route(self, suite: str, index: int, town: CompiledTown) -> Route:
        """One route of a suite, planned on first use.

        Args:
            suite: One of ``SUITES``.
            index: Number of the route, from 0.
            town: The town of that name; a book serves one compiled town.

        Raises:
            ValueError: The suite or the index does not exist; the message says what does.
        """
        specs = self.suites.get(suite, ())
        if not specs:
            have = ", ".join(self.suites) or "none"
            raise ValueError(f"town {self.town!r} has no {suite!r} routes; it has: {have}")
        if not is_int(index) or not 0 <= index < len(specs):
            problem = "is out of range" if is_int(index) else "is not an int"
            raise ValueError(
                f"{suite} {index!r} {problem}: town {self.town!r} has {suite} 0 to {len(specs) - 1}"
            )
        spec = specs[index]
        if spec not in self._planned:
            self._planned[spec] = route_by_turns(town, spec.start, spec.turns, spec.end)
        return self._planned[spec]


def movements(town: CompiledTown) -> set[tuple[int, int]]:
    """All junction movements as (lane before, first lane after the decision)."""
    return {
        (lane, following)
        for lane, options in enumerate(town.successors)
        if len(options) > 1
        for following in options
    }


def draw_split(town: CompiledTown, split: str) -> tuple[RouteSpec, ...]:
    """Draw a split: 50 random routes of 80 to 400 m that cover every movement of every junction.

    Routes are taken from a seeded stream of random ones, first those that add the most movements
    not yet covered, then as they come. The same seed gives the same routes.

    Raises:
        ValueError: Not enough of the stream can be written down, or none passes some movement.
    """
    return _draw(town, SPLITS[split], everywhere=True)


def draw_suites(
    town: CompiledTown, kept: Mapping[str, tuple[RouteSpec, ...]]
) -> dict[str, tuple[RouteSpec, ...]]:
    """Draw both splits, and the other suites where there are none yet.

    Args:
        town: The town.
        kept: Suites that there are.

    Raises:
        ValueError: As in :func:`draw_split`.
    """
    others = {name: _draw(town, draw) for name, draw in OTHERS.items() if name not in kept}
    return {**others, **kept, **{split: draw_split(town, split) for split in SPLITS}}


def _draw(town: CompiledTown, draw: Draw, *, everywhere: bool = False) -> tuple[RouteSpec, ...]:
    """Choose routes from a pool: those that add most movements first, then as they come.

    With ``everywhere`` every movement is covered, by more routes than asked for if need be.
    """
    rng = np.random.default_rng(draw.seed)
    pool = [random_route(town, rng, draw.shortest_m, draw.longest_m) for _ in range(POOL)]
    missing = movements(town)
    covers = [missing & set(zip(route.lanes[:-1], route.lanes[1:], strict=True)) for route in pool]
    chosen: dict[int, RouteSpec] = {}
    while missing and (everywhere or len(chosen) < draw.size):
        best = max(range(POOL), key=lambda k: len(covers[k] & missing))
        if not covers[best] & missing:
            break
        spec = _written(town, pool[best])
        if spec is not None:
            chosen[best] = spec
            missing -= covers[best]
        covers[best] = set()
    if everywhere and missing:
        before, after = (town.lanes[number].index for number in min(missing))
        raise ValueError(
            f"town {town.name!r}: no random route of {draw.shortest_m:g} to {draw.longest_m:g} m "
            f"goes from lane {before} on to lane {after}; {DECISIONS}"
        )
    for k, route in enumerate(pool):
        if len(chosen) >= draw.size:
            break
        if k not in chosen and (spec := _written(town, route)) is not None:
            chosen[k] = spec
    if len(chosen) < draw.size:
        raise ValueError(
            f"town {town.name!r}: only {len(chosen)} of {POOL:,} random routes of "
            f"{draw.shortest_m:g} to {draw.longest_m:g} m can be told by their turns; {DECISIONS}"
        )
    return tuple(chosen[k] for k in sorted(chosen))


DECISIONS = (
    "a junction needs a name of its own without spaces, at most one way left, right and straight "
    "on from each lane, and a way out of each that comes back"
)


def _written(town: CompiledTown, route: Route) -> RouteSpec | None:
    """A route as it is written down; None if another one is found from that.

    One that laps a town without coming by a junction is, for example.
    """
    start, end = (tuple(np.round(route.points[i, :2], 2).tolist()) for i in (0, -1))
    try:
        again = route_by_turns(town, start, route.turns, end)
    except ValueError:
        return None
    return RouteSpec(start, route.turns, end) if again.lanes == route.lanes else None


def main() -> None:
    """Draw the splits of the built-in towns again and write them into their route files."""
    from .registry import ROUTES_FOLDER, draw_routes, register_builtin_towns

    register_builtin_towns()
    for path in sorted(ROUTES_FOLDER.glob("*.json")):
        draw_routes(path.stem, path)
        print(f"{path}: {', '.join(SPLITS)} drawn")


if __name__ == "__main__":
    main()
