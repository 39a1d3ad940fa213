"""Which route an episode drives: what ``reset(options=...)`` means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .towns.compiled import CompiledTown
from .towns.registry import route_book
from .towns.route import Route, locate, random_route, shortest_route

RANDOM_SHORTEST_M, RANDOM_LONGEST_M = 100.0, 400.0
SPLITS = ("val", "test")
FORMS = (
    '{"episode": k}, {"route": k}, {"split": "val" or "test", "index": k}, '
    '{"start": (x, y), "goal": (x, y)} or nothing'
)


def choose_route(
    town: CompiledTown, options: Mapping[str, Any] | None, rng: np.random.Generator
) -> tuple[Route, str]:
    """Find the route that reset options ask for.

    Args:
        town: The town.
        options: One of the forms in ``FORMS``; a start or goal may also be (x, y, heading).
        rng: Draws the route when the options ask for none.

    Returns:
        The route and the episode's id, such as ``"Town01/episode/2"``.

    Raises:
        ValueError: The options have an unknown key or form, or ask for a route that is not there.
    """
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"reset options must be a dict, got {options!r}; use {FORMS}")
    keys = frozenset(options or ())
    if not keys:
        route = random_route(town, rng, RANDOM_SHORTEST_M, RANDOM_LONGEST_M)
        return route, f"{town.name}/random"
    assert options is not None
    if keys in ({"episode"}, {"route"}):
        (suite,) = keys
        return _fixed(town, suite, options[suite])
    if keys == {"split", "index"}:
        if options["split"] not in SPLITS:
            raise ValueError(f"unknown split {options['split']!r}; splits are: {', '.join(SPLITS)}")
        return _fixed(town, options["split"], options["index"])
    if keys == {"start", "goal"}:
        route = shortest_route(town, _place(town, options, "start"), _place(town, options, "goal"))
        return route, f"{town.name}/planned"
    raise ValueError(f"reset options {dict(options)!r} are not valid; use {FORMS}")


def _fixed(town: CompiledTown, suite: str, index: Any) -> tuple[Route, str]:
    return route_book(town.name).route(suite, index, town), f"{town.name}/{suite}/{index}"


def _place(town: CompiledTown, options: Mapping[str, Any], key: str) -> tuple[int, float]:
    """Snap a point given in the options to the nearest lane."""
    expected = f"{key} must be (x, y) or (x, y, heading) in metres, got {options[key]!r}"
    try:
        point = np.asarray(options[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(expected) from error
    if point.shape not in ((2,), (3,)) or not np.isfinite(point).all():
        raise ValueError(expected)
    x, y = float(point[0]), float(point[1])
    lane, station = locate(town, x, y, float(point[2]) if len(point) == 3 else None)
    lane_x, lane_y, _ = town.lanes[lane].pose_at(station)
    if math.hypot(lane_x - x, lane_y - y) > 10.0:
        raise ValueError(f"{key} {options[key]!r} is more than 10 m from any lane of {town.name}")
    return lane, station
