"""Infraction detectors: each answers for one world, now."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import (
    DIRECTION_CODES,
    HEADING,
    LENGTH,
    NO_LANE,
    ROAD_BIT,
    SIGNAL_RED,
    SPEED,
    WIDTH,
    RasterGrid,
    X,
    Y,
)
from .overlap import boxes_overlap, circles_apart

NONE = -1
STOP_LINE_REACH = 1.25
"""A lane is this much wider than its stop line; all of it counts as its line."""
FOOTPRINT_ROWS = 10
FOOTPRINT_COLUMNS = 10
AGAINST_COS = -0.5
"""A lane is opposing when it points more than 120 degrees away from the ego's heading."""


@leaf_kernel
def raster_value(raster: NDArray, grid: RasterGrid, x: float, y: float) -> int:
    """Value of the raster pixel that covers a world point; 0 outside the raster."""
    row = math.floor((y - grid.y0_m) * grid.px_per_m)
    column = math.floor((x - grid.x0_m) * grid.px_per_m)
    if row < 0 or column < 0 or row >= raster.shape[0] or column >= raster.shape[1]:
        return 0
    return raster[row, column]


@leaf_kernel
def is_off_road(
    classes: NDArray, grid: RasterGrid, ego: NDArray, half_length_m: float, half_width_m: float
) -> bool:
    """Whether the ego's centre, or at least a quarter of its footprint, is off the pavement."""
    if raster_value(classes, grid, ego[X], ego[Y]) & ROAD_BIT == 0:
        return True
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    outside = 0
    for i in range(FOOTPRINT_ROWS):
        ahead = ((i + 0.5) / FOOTPRINT_ROWS * 2.0 - 1.0) * half_length_m
        for j in range(FOOTPRINT_COLUMNS):
            right = ((j + 0.5) / FOOTPRINT_COLUMNS * 2.0 - 1.0) * half_width_m
            x = ego[X] + ahead * cos - right * sin
            y = ego[Y] + ahead * sin + right * cos
            if raster_value(classes, grid, x, y) & ROAD_BIT == 0:
                outside += 1
    return 4 * outside >= FOOTPRINT_ROWS * FOOTPRINT_COLUMNS


@leaf_kernel
def is_against_traffic(directions: NDArray, grid: RasterGrid, ego: NDArray) -> bool:
    """Whether the ego's centre is in a lane, outside junctions, that runs against its heading."""
    code = raster_value(directions, grid, ego[X], ego[Y])
    if code == NO_LANE:
        return False
    lane_heading = (code - 1) * 2.0 * math.pi / DIRECTION_CODES
    return math.cos(ego[HEADING] - lane_heading) < AGAINST_COS


@leaf_kernel
def is_deviating(distance_m: float, deviation_m: float) -> bool:
    """Whether the ego is farther from the planned lane centre than allowed."""
    return distance_m > deviation_m


@leaf_kernel
def is_standing(ego: NDArray, blocked_speed_mps: float) -> bool:
    """Whether the ego is slow enough to count as blocked if it stays so."""
    return ego[SPEED] < blocked_speed_mps


@leaf_kernel
def actor_hit(ego: NDArray, half_length_m: float, half_width_m: float, actors: NDArray) -> int:
    """Number of the first actor (A, 6) whose footprint the ego's touches, or -1."""
    x, y = ego[X], ego[Y]
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    for k in range(actors.shape[0]):
        if actors[k, LENGTH] <= 0.0:
            continue
        half, side = 0.5 * actors[k, LENGTH], 0.5 * actors[k, WIDTH]
        dx, dy = actors[k, X] - x, actors[k, Y] - y
        if circles_apart(dx, dy, half_length_m, half_width_m, half, side):
            continue
        heading = actors[k, HEADING]
        if boxes_overlap(
            x, y, cos, sin, half_length_m, half_width_m, actors[k, X], actors[k, Y],
            math.cos(heading), math.sin(heading), half, side,
        ):  # fmt: skip
            return k
    return NONE


@leaf_kernel
def red_line_crossed(
    stop_lines: NDArray,
    signals: NDArray,
    before_x: float,
    before_y: float,
    after_x: float,
    after_y: float,
) -> int:
    """Number of the red signal whose stop line a point crossed in driving direction, or -1.

    Args:
        stop_lines: (S, 4) end points x1, y1, x2, y2, left to right as seen by the traffic.
        signals: (S,) what they show.
        before_x: World x of the middle of the front bumper a physics step ago.
        before_y: World y of it.
        after_x: World x of it now.
        after_y: World y of it now.
    """
    for k in range(stop_lines.shape[0]):
        if signals[k] != SIGNAL_RED:
            continue
        x, y = stop_lines[k, 0], stop_lines[k, 1]
        right_x, right_y = stop_lines[k, 2] - x, stop_lines[k, 3] - y
        # positive before the line, whose traffic drives along (right_y, -right_x)
        before = (before_x - x) * -right_y + (before_y - y) * right_x
        after = (after_x - x) * -right_y + (after_y - y) * right_x
        if before <= 0.0 or after > 0.0:
            continue
        part = before / (before - after)
        at_x, at_y = before_x + part * (after_x - before_x), before_y + part * (after_y - before_y)
        length2 = right_x * right_x + right_y * right_y
        along = ((at_x - x) * right_x + (at_y - y) * right_y) / length2
        if abs(along - 0.5) <= 0.5 * STOP_LINE_REACH:
            return k
    return NONE
