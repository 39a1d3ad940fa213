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
SPLIT_SEEDS = {"val": 1, "test": 2}
SPLIT_SIZE = 50
SPLIT_SHORTEST_M, SPLIT_LONGEST_M = 80.0, 400.0


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
    """
    rng = np.random.default_rng(SPLIT_SEEDS[split])
    pool = [random_route(town, rng, SPLIT_SHORTEST_M, SPLIT_LONGEST_M) for _ in range(1000)]
    every = movements(town)
    covers = [every & set(zip(route.lanes[:-1], route.lanes[1:], strict=True)) for route in pool]
    missing, chosen = set(every), []
    while missing:
        best = max(range(len(pool)), key=lambda k: len(covers[k] & missing))
        missing -= covers[best]
        chosen.append(best)
    chosen += [k for k in range(len(pool)) if k not in chosen][: SPLIT_SIZE - len(chosen)]
    return tuple(_spec(pool[k]) for k in sorted(chosen))


def _spec(route: Route) -> RouteSpec:
    start, end = (tuple(np.round(route.points[i, :2], 2).tolist()) for i in (0, -1))
    return RouteSpec(start, route.turns, end)


def main() -> None:
    """Draw the splits of the built-in towns again and write them into their route files."""
    from .registry import ROUTES_FOLDER, compiled_town, register_builtin_towns

    register_builtin_towns()
    for path in sorted(ROUTES_FOLDER.glob("*.json")):
        town = compiled_town(path.stem)
        book = RouteBook.read(town.name, path)
        splits = {split: draw_split(town, split) for split in SPLIT_SEEDS}
        RouteBook(town.name, {**book.suites, **splits}).write(path)
        print(f"{path}: {', '.join(splits)} drawn")


if __name__ == "__main__":
    main()
