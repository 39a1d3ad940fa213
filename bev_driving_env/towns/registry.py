"""Names of towns, and the Gymnasium ids that come with them."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium as gym

if TYPE_CHECKING:
    from highway_env.road.road import RoadNetwork

    from .compiled import CompiledTown
    from .routebook import RouteBook

ROUTES_FOLDER = Path(__file__).parent / "routes"


@dataclass(frozen=True)
class _Registration:
    build: Callable[[], RoadNetwork]
    routes: Path | None


_towns: dict[str, _Registration] = {}


def register_town(
    name: str,
    build: Callable[[], RoadNetwork],
    *,
    routes: str | Path | None = None,
    overwrite: bool = False,
) -> str:
    """Register a town, and with it the environment id ``BEV<name>-v0``.

    Args:
        name: Letters, digits and underscores, not yet taken.
        build: Returns the road network: any highway-env ``RoadNetwork`` without dead ends, or a
            ``TownNetwork`` with signals and sidewalks. Called once, when the town is first used.
        routes: JSON file with the town's fixed routes, laid out like those of Town01. Without
            one, only random routes and ``options={"start": ..., "goal": ...}`` are available.
        overwrite: Replace a town of that name; environments made before keep the old one.

    Returns:
        The environment id.

    Raises:
        TypeError: ``build`` cannot be called.
        ValueError: The name is taken or not an identifier.

    >>> import bev_driving_env
    >>> bev_driving_env.register_town("Town01", lambda: None)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    ValueError: town 'Town01' is already registered; registered towns: Town01, Town02...
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w+", name):
        raise ValueError(f"town name must consist of letters, digits and _, got {name!r}")
    if not callable(build):
        raise TypeError(f"build must be a function that returns a RoadNetwork, got {build!r}")
    if name in _towns:
        if not overwrite:
            raise ValueError(
                f"town {name!r} is already registered; registered towns: {', '.join(_towns)}"
            )
        compiled_town.cache_clear()
        route_book.cache_clear()
    _towns[name] = _Registration(build, None if routes is None else Path(routes))
    env_id = f"BEV{name}-v0"
    if env_id not in gym.registry:
        gym.register(
            id=env_id,
            entry_point="bev_driving_env.env:BEVTownEnv",
            vector_entry_point="bev_driving_env.vector_env:BEVTownVectorEnv",
            kwargs={"town": name},
        )
    return env_id


def town_names() -> tuple[str, ...]:
    """Names of all registered towns."""
    return tuple(_towns)


def road_network(town: str) -> RoadNetwork:
    """Build a town's highway-env road network, new and free to be changed.

    Raises:
        TypeError: The town's build function returned something else.
        ValueError: No town of that name; the message lists those there are.
    """
    from highway_env.road.road import RoadNetwork

    network = _registration(town).build()
    if not isinstance(network, RoadNetwork):
        raise TypeError(
            f"the build function of town {town!r} must return a highway-env RoadNetwork, "
            f"got {type(network).__name__}"
        )
    return network


@functools.cache
def compiled_town(town: str) -> CompiledTown:
    """The compiled form of a registered town, made once per process.

    Raises:
        ValueError: No town of that name, or its network has a dead end.
    """
    from .compiled import compile_network

    return compile_network(town, road_network(town))


@functools.cache
def route_book(town: str) -> RouteBook:
    """The fixed routes of a registered town; empty if it has none."""
    from .routebook import RouteBook

    path = _registration(town).routes
    return RouteBook(town, {}) if path is None else RouteBook.read(town, path)


def _registration(town: str) -> _Registration:
    if not isinstance(town, str) or town not in _towns:
        raise ValueError(f"unknown town {town!r}; registered towns: {', '.join(_towns)}")
    return _towns[town]


def _build_town01() -> RoadNetwork:
    from .build import build_grid_town
    from .town01 import TOWN01

    return build_grid_town(TOWN01)


def _build_town02() -> RoadNetwork:
    from .build import build_grid_town
    from .town02 import TOWN02

    return build_grid_town(TOWN02)


def register_builtin_towns() -> None:
    """Register Town01 and Town02 unless they are there already."""
    for name, build in (("Town01", _build_town01), ("Town02", _build_town02)):
        if name not in _towns:
            register_town(name, build, routes=ROUTES_FOLDER / f"{name}.json")
