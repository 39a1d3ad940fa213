"""Names of towns, and the Gymnasium ids that come with them."""

from __future__ import annotations

import functools
import importlib
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium as gym

from .grid import GridTown
from .town01 import TOWN01
from .town02 import TOWN02

if TYPE_CHECKING:
    from highway_env.road.road import RoadNetwork

    from .compiled import CompiledTown
    from .routebook import RouteBook

ROUTES_FOLDER = Path(__file__).parent / "routes"


@dataclass(frozen=True)
class _Registration:
    build: GridTown | Callable[[], RoadNetwork]
    routes: Path | None


_towns: dict[str, _Registration] = {}


def register_town(
    name: str,
    build: GridTown | Callable[[], RoadNetwork],
    *,
    routes: str | Path | None = None,
    overwrite: bool = False,
) -> str:
    """Register a town, and with it the environment id ``BEV<name>-v0``.

    Args:
        name: Letters, digits and underscores, not yet taken.
        build: The town as a table, or a function that returns the road network: any highway-env
            ``RoadNetwork`` without dead ends, or a ``TownNetwork`` with signals and sidewalks.
            Built once, when the town is first used.
        routes: JSON file with the town's fixed routes, as :func:`draw_routes` writes it. Without
            one, only random routes and ``options={"start": ..., "goal": ...}`` are available.
        overwrite: Replace a town of that name; environments made before keep the old one.

    Returns:
        The environment id.

    Raises:
        TypeError: ``build`` is no table and cannot be called.
        ValueError: The name is taken or not an identifier.

    >>> import bev_driving_env
    >>> bev_driving_env.register_town("Town01", lambda: None)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    ValueError: town 'Town01' is already registered; registered towns: Town01, Town02...
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w+", name):
        raise ValueError(f"town name must consist of letters, digits and _, got {name!r}")
    if not isinstance(build, GridTown) and not callable(build):
        raise TypeError(
            f"build must be a GridTown or a function that returns a RoadNetwork, got {build!r}"
        )
    if name in _towns:
        if not overwrite:
            raise ValueError(
                f"town {name!r} is already registered; registered towns: {', '.join(_towns)}"
            )
        _compiled.cache_clear()
        _book.cache_clear()
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


def town_name(spec: str) -> str:
    """Name of the town that a spec means.

    Args:
        spec: Name of a registered town, or ``"module:name"``: the module is imported, and
            registers the town. So command lines, results and worker processes can name any town.

    Raises:
        ValueError: No town of that name, or the module cannot be imported or does not register
            it; the message lists those there are.

    >>> town_name("bev_driving_env:Town02")
    'Town02'
    """
    known = isinstance(spec, str)
    module, _, name = spec.rpartition(":") if known else ("", "", "")
    if module and name not in _towns:
        try:
            importlib.import_module(module)
        except Exception as error:  # a foreign module may raise anything while it is imported
            raise ValueError(
                f"town {spec!r} cannot be loaded: {type(error).__name__}: {error}"
            ) from error
    if name not in _towns:
        raise ValueError(
            f"unknown town {spec!r}; registered towns: {', '.join(_towns)}; "
            "'module:name' imports the module that registers another"
        )
    return name


def town_files(spec: str) -> tuple[Path, ...]:
    """Files whose content decides what ``"module:name"`` means: the module, and fixed routes.

    Raises:
        ValueError: As in :func:`town_name`.
    """
    name = town_name(spec)
    module = sys.modules.get(spec.rpartition(":")[0])
    source = getattr(module, "__file__", None)
    if source is None:
        return ()
    routes = _towns[name].routes
    return (Path(source),) if routes is None else (Path(source), routes)


def road_network(town: str) -> RoadNetwork:
    """Build a town's highway-env road network, new and free to be changed.

    Raises:
        TypeError: The town's build function returned something else.
        ValueError: No town of that name; the message lists those there are.
    """
    from highway_env.road.road import RoadNetwork

    from .build import build_grid_town

    build = _towns[town_name(town)].build
    network = build_grid_town(build) if isinstance(build, GridTown) else build()
    if not isinstance(network, RoadNetwork):
        raise TypeError(
            f"the build function of town {town!r} must return a highway-env RoadNetwork, "
            f"got {type(network).__name__}"
        )
    return network


def compiled_town(town: str) -> CompiledTown:
    """The compiled form of a registered town, made once per process.

    Args:
        town: Its name, or ``"module:name"`` (:func:`town_name`).

    Raises:
        ValueError: No town of that name, or its network has a dead end.
    """
    return _compiled(town_name(town))


def route_book(town: str) -> RouteBook:
    """The fixed routes of a registered town; empty if it has none.

    Args:
        town: Its name, or ``"module:name"`` (:func:`town_name`).

    Raises:
        ValueError: No town of that name, or its file is not one of routes.
    """
    return _book(town_name(town))


@functools.cache
def _compiled(name: str) -> CompiledTown:
    from .compiled import compile_network

    return compile_network(name, road_network(name))


@functools.cache
def _book(name: str) -> RouteBook:
    from .routebook import RouteBook

    path = _towns[name].routes
    return RouteBook(name, {}) if path is None else RouteBook.read(name, path)


def draw_routes(town: str, path: str | Path) -> RouteBook:
    """Draw fixed routes for a town and write them into a file, for ``register_town(routes=...)``.

    The splits ``val`` and ``test`` are drawn as for the built-in towns: 50 routes each of 80 to
    400 m, which pass every movement of every junction. Five evaluation episodes of 80 to 160 m
    and ten long routes of 400 to 1,200 m are drawn where the file has none yet. All seeds are
    fixed: the same town gets the same routes.

    Args:
        town: Name of a registered town, or ``"module:name"``.
        path: JSON file; what it holds besides the splits is kept.

    Returns:
        The routes.

    Raises:
        ValueError: No such town, it is too small for such routes, they miss a movement, or the
            file holds something else; nothing is written then.
    """
    from .routebook import RouteBook, draw_suites

    name, path = town_name(town), Path(path)
    kept = RouteBook.read(name, path).suites if path.exists() else {}
    book = RouteBook(name, draw_suites(compiled_town(name), kept))
    book.write(path)
    _book.cache_clear()
    return book


def register_builtin_towns() -> None:
    """Register Town01 and Town02 unless they are there already."""
    for name, table in (("Town01", TOWN01), ("Town02", TOWN02)):
        if name not in _towns:
            register_town(name, table, routes=ROUTES_FOLDER / f"{name}.json")
