"""The sparse plan: the few points of a route that a navigation system hands to the driver."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .route import Route, lane_offsets

PLAN_SPACING_M = 50.0
"""Plan points are at most this far apart along the route."""
SAME_POINT_M = 1e-6
"""Points closer than this are one: a route that ends where a junction begins needs no two."""


def sparse_plan(route: Route) -> NDArray[np.float64]:
    """The sparse plan of a route.

    There is a point at the entry and at the exit of every junction where the route has a choice,
    one at its end, and as few evenly spaced ones in between as keep points at most 50 m apart,
    counted from the start of the route. The start itself is not a plan point.

    Args:
        route: The route.

    Returns:
        Points (P, 3) in driving order: x, y on the planned lane centre, and station, the distance
        along the route from its start; all in metres.
    """
    stations: list[float] = []
    reached = 0.0
    for anchor in _anchors(route):
        pieces = max(1, math.ceil((anchor - reached) / PLAN_SPACING_M - SAME_POINT_M))
        stations.extend(np.linspace(reached, anchor, pieces + 1)[1:].tolist())
        reached = anchor
    along = np.linspace(0.0, route.length_m, len(route.points))
    x, y = (np.interp(stations, along, route.points[:, k]) for k in (0, 1))
    return np.column_stack([x, y, stations])


def _anchors(route: Route) -> list[float]:
    """Stations in order that must be plan points: entry and exit of every movement, the end.

    A movement is a chain of junction lanes behind a lane that leads on to several. It ends early
    where it parts again, because that is the next decision.
    """
    lanes, successors = route.town.lanes, route.town.successors
    chain = [lanes[number] for number in route.lanes]
    ends = [
        offset + lane.length_m - route.start_m
        for offset, lane in zip(lane_offsets(chain), chain, strict=True)
    ]
    anchors: list[float] = []
    for entry, before in enumerate(route.lanes[:-1]):
        if len(successors[before]) == 1:
            continue
        leave = entry
        while (
            leave + 1 < len(chain)
            and chain[leave + 1].in_junction
            and (leave == entry or len(successors[route.lanes[leave]]) == 1)
        ):
            leave += 1
        for station in (ends[entry], ends[leave]):
            reached = anchors[-1] if anchors else 0.0
            if reached + SAME_POINT_M < station < route.length_m - SAME_POINT_M:
                anchors.append(station)
    return [*anchors, route.length_m]
