"""Infraction detectors that need no other actor: each answers for one world, now."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import kernel
from .layout import (
    DIRECTION_CODES,
    HEADING,
    NO_LANE,
    ROAD_BIT,
    SPEED,
    RasterGrid,
    X,
    Y,
)

FOOTPRINT_ROWS = 10
FOOTPRINT_COLUMNS = 10
AGAINST_COS = -0.5
"""A lane is opposing when it points more than 120 degrees away from the ego's heading."""


@kernel
def raster_value(raster: NDArray, grid: RasterGrid, x: float, y: float) -> int:
    """Value of the raster pixel that covers a world point; 0 outside the raster."""
    row = math.floor((y - grid.y0_m) * grid.px_per_m)
    column = math.floor((x - grid.x0_m) * grid.px_per_m)
    if row < 0 or column < 0 or row >= raster.shape[0] or column >= raster.shape[1]:
        return 0
    return raster[row, column]


@kernel
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


@kernel
def is_against_traffic(directions: NDArray, grid: RasterGrid, ego: NDArray) -> bool:
    """Whether the ego's centre is in a lane, outside junctions, that runs against its heading."""
    code = raster_value(directions, grid, ego[X], ego[Y])
    if code == NO_LANE:
        return False
    lane_heading = (code - 1) * 2.0 * math.pi / DIRECTION_CODES
    return math.cos(ego[HEADING] - lane_heading) < AGAINST_COS


@kernel
def is_deviating(distance_m: float, deviation_m: float) -> bool:
    """Whether the ego is farther from the planned lane centre than allowed."""
    return distance_m > deviation_m


@kernel
def is_standing(ego: NDArray, blocked_speed_mps: float) -> bool:
    """Whether the ego is slow enough to count as blocked if it stays so."""
    return ego[SPEED] < blocked_speed_mps
