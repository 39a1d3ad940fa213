"""The static raster: one bit per class, and the direction of travel, seen from above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..kernels.fill import fill_band
from ..kernels.layout import (
    DIRECTION_CODES,
    JUNCTION_BIT,
    LANE_BIT,
    NO_LANE,
    ROAD_BIT,
    SIDEWALK_BIT,
    RasterGrid,
)

if TYPE_CHECKING:
    from .compiled import Lane
    from .network import CrossSection

MARGIN_M = 45.0
"""Empty border, so that the default BEV window stays on the raster while the ego is on the road."""
LARGEST_PX = 1 << 30
KEEP_ALL = 255


@dataclass(frozen=True)
class Raster:
    """Pixels and where they lie in the world.

    Attributes:
        grid: Position and resolution.
        pixels: (rows, columns) uint8.
    """

    grid: RasterGrid
    pixels: NDArray[np.uint8]


def rasterize_classes(
    lanes: Sequence[Lane],
    cross_section: CrossSection,
    bounds: tuple[float, float, float, float],
    px_per_m: float,
    line_m: float,
) -> Raster:
    """Rasterise road, boundaries, sidewalk and junctions, one bit each (``kernels.layout``).

    A pixel belongs to a class when its centre lies in it. Shoulders count as road.

    Args:
        lanes: Sampled lanes.
        cross_section: What lies beside them.
        bounds: Lane-centre extent x0, y0, x1, y1.
        px_per_m: Resolution.
        line_m: Width of the boundaries.

    Raises:
        ValueError: The raster would have more than 2^30 pixels.
    """
    raster = blank_raster(bounds, px_per_m)
    paved = cross_section.shoulder_m
    walked = paved + cross_section.sidewalk_m
    if cross_section.sidewalk_m > 0.0:
        for lane in lanes:
            half = lane.half_width + walked
            _fill(raster, lane, -half, half, KEEP_ALL, SIDEWALK_BIT)
    for lane in lanes:
        half = lane.half_width + paved
        value = ROAD_BIT | JUNCTION_BIT if lane.in_junction else ROAD_BIT
        _fill(raster, lane, -half, half, KEEP_ALL ^ SIDEWALK_BIT, value)
    for lane in lanes:
        for side, present in zip((-1.0, 1.0), lane.lines, strict=True):
            if present and not lane.in_junction:
                edge = side * lane.half_width
                left, right = edge - line_m / 2.0, edge + line_m / 2.0
                _fill(raster, lane, left, right, KEEP_ALL, LANE_BIT)
    return raster


def rasterize_directions(
    lanes: Sequence[Lane], bounds: tuple[float, float, float, float], px_per_m: float
) -> Raster:
    """Rasterise the direction of travel outside junctions.

    Returns:
        Pixels are ``NO_LANE``, or 1 + the lane's heading in 255ths of a turn.
    """
    raster = blank_raster(bounds, px_per_m)
    for lane in lanes:
        if not lane.in_junction:
            turns = np.arctan2(lane.points[:, 3], lane.points[:, 2]) / (2.0 * math.pi)
            codes = 1 + np.round(turns * DIRECTION_CODES).astype(np.int64) % DIRECTION_CODES
            for i in range(len(codes) - 1):
                part, half = slice(i, i + 2), lane.half_width
                _fill(raster, lane, -half, half, 0, int(codes[i]), part)
    for lane in lanes:
        if lane.in_junction:
            _fill(raster, lane, -lane.half_width, lane.half_width, 0, NO_LANE)
    return raster


def blank_raster(bounds: tuple[float, float, float, float], px_per_m: float) -> Raster:
    """An empty raster around lane-centre bounds x0, y0, x1, y1, with a margin.

    Raises:
        ValueError: It would have more than 2^30 pixels.
    """
    x0, y0 = math.floor(bounds[0] - MARGIN_M), math.floor(bounds[1] - MARGIN_M)
    width_m, height_m = bounds[2] + MARGIN_M - x0, bounds[3] + MARGIN_M - y0
    shape = math.ceil(height_m * px_per_m), math.ceil(width_m * px_per_m)
    if shape[0] * shape[1] > LARGEST_PX:
        raise ValueError(
            f"a raster of {shape[0]} x {shape[1]} pixels is too large: the network spans "
            f"{width_m:.0f} m x {height_m:.0f} m; use fewer px_per_m than {px_per_m:g}"
        )
    grid = RasterGrid(float(x0), float(y0), float(px_per_m))
    return Raster(grid, np.zeros(shape, np.uint8))


def _fill(
    raster: Raster,
    lane: Lane,
    left_m: NDArray[np.float64],
    right_m: NDArray[np.float64],
    keep: int,
    value: int,
    part: slice = slice(None),
) -> None:
    """Fill the band between two lateral offsets (M,) along a lane, or a part of it."""
    grid, points = raster.grid, lane.points[part]
    fill_band(
        raster.pixels,
        grid.x0_m,
        grid.y0_m,
        grid.px_per_m,
        points,
        left_m[part],
        right_m[part],
        keep,
        value,
    )
