"""Where the ego is along its planned route."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import (
    DIRECTION_X,
    DIRECTION_Y,
    DISTANCE,
    HEADING,
    HEADING_ERROR,
    LATERAL,
    ROUTE_DONE,
    ROUTE_POSITION,
    X,
    Y,
)

BACK_M = 5.0
AHEAD_M = 10.0


@leaf_kernel
def nearest_on_route(
    points: NDArray, size: int, spacing_m: float, around_m: float, x: float, y: float
) -> tuple[float, float]:
    """Nearest route position to (x, y) from 5 m behind to 10 m ahead of a known position.

    The window keeps the answer on the right pass where a route crosses or repeats itself.

    Args:
        points: Route points (R, 4) spaced evenly, of which the first ``size`` are valid.
        size: Number of valid points, at least 2.
        spacing_m: Distance between points along the route.
        around_m: The last known route position.
        x: World x.
        y: World y.

    Returns:
        Route position in metres and the distance to it in metres.
    """
    first = max(0, int((around_m - BACK_M) / spacing_m))
    last = min(size - 2, int((around_m + AHEAD_M) / spacing_m))
    best_distance2 = math.inf
    best_position = around_m
    for i in range(min(first, size - 2), last + 1):
        ax, ay = points[i, X], points[i, Y]
        bx, by = points[i + 1, X] - ax, points[i + 1, Y] - ay
        along = ((x - ax) * bx + (y - ay) * by) / (bx * bx + by * by)
        along = min(max(along, 0.0), 1.0)
        dx, dy = x - (ax + along * bx), y - (ay + along * by)
        distance2 = dx * dx + dy * dy
        if distance2 < best_distance2:
            best_distance2 = distance2
            best_position = (i + along) * spacing_m
    return best_position, math.sqrt(best_distance2)


@leaf_kernel
def route_pose(
    points: NDArray, size: int, spacing_m: float, position_m: float
) -> tuple[float, float, float, float]:
    """Point and unit direction (x, y, dx, dy) at a route position, interpolated linearly."""
    where = min(max(position_m / spacing_m, 0.0), size - 1.0)
    i = min(int(where), size - 2)
    part = where - i
    x = points[i, X] + part * (points[i + 1, X] - points[i, X])
    y = points[i, Y] + part * (points[i + 1, Y] - points[i, Y])
    dx = points[i, DIRECTION_X] + part * (points[i + 1, DIRECTION_X] - points[i, DIRECTION_X])
    dy = points[i, DIRECTION_Y] + part * (points[i + 1, DIRECTION_Y] - points[i, DIRECTION_Y])
    norm = math.sqrt(dx * dx + dy * dy)
    return x, y, dx / norm, dy / norm


@leaf_kernel
def update_progress(
    ego: NDArray, points: NDArray, size: int, spacing_m: float, progress: NDArray
) -> None:
    """Update one world's progress row from its ego row, in place.

    The lateral error is positive to the right of the route, the heading error positive when the
    ego points to the right of it.
    """
    position, distance = nearest_on_route(
        points, size, spacing_m, progress[ROUTE_POSITION], ego[X], ego[Y]
    )
    x, y, dx, dy = route_pose(points, size, spacing_m, position)
    progress[ROUTE_POSITION] = position
    progress[ROUTE_DONE] = max(progress[ROUTE_DONE], position)
    progress[LATERAL] = dx * (ego[Y] - y) - dy * (ego[X] - x)
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    progress[HEADING_ERROR] = math.atan2(dx * sin - dy * cos, dx * cos + dy * sin)
    progress[DISTANCE] = distance
