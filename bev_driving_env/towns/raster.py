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
LINE_M = 0.4
"""Width of lane boundaries: 2 px at 5 px/m."""
LARGEST_PX = 1 << 30


@dataclass(frozen=True)
class StaticRaster:
    """What does not move, as pixels.

    Attributes:
        grid: Where the pixels lie in the world.
        bits: (rows, columns) uint8, the sum of ``ROAD_BIT``, ``LANE_BIT``, ``SIDEWALK_BIT``,
            ``JUNCTION_BIT``.
        directions: (rows, columns) uint8: 0 where no lane outside junctions lies, else
            1 + its heading in 255ths of a turn.
    """

    grid: RasterGrid
    bits: NDArray[np.uint8]
    directions: NDArray[np.uint8]


def rasterize(
    lanes: Sequence[Lane],
    cross_section: CrossSection,
    bounds: tuple[float, float, float, float],
    px_per_m: float,
) -> StaticRaster:
    """Rasterise lanes: a pixel belongs to a class when its centre lies in it.

    Args:
        lanes: Sampled lanes.
        cross_section: Shoulders count as road.
        bounds: Lane-centre extent x0, y0, x1, y1.
        px_per_m: Resolution.

    Raises:
        ValueError: The raster would have more than 2^30 pixels.
    """
    x0, y0, x1, y1 = bounds
    x0, y0 = math.floor(x0 - MARGIN_M), math.floor(y0 - MARGIN_M)
    shape = (
        math.ceil((y1 + MARGIN_M - y0) * px_per_m),
        math.ceil((x1 + MARGIN_M - x0) * px_per_m),
    )
    if shape[0] * shape[1] > LARGEST_PX:
        raise ValueError(
            f"a raster of {shape[0]} x {shape[1]} pixels is too large: the network spans "
            f"{x1 - x0:.0f} m x {y1 - y0:.0f} m; use fewer px_per_m than {px_per_m}"
        )
    grid = RasterGrid(float(x0), float(y0), float(px_per_m))
    road, line, sidewalk, junction, directions = (np.zeros(shape, np.uint8) for _ in range(5))

    def band(plane: NDArray[np.uint8], lane: Lane, left_m: float, right_m: float) -> None:
        _fill(plane, grid, lane, left_m - lane.half_width, right_m + lane.half_width, 1)

    paved = cross_section.shoulder_m
    walked = paved + cross_section.sidewalk_m
    for lane in lanes:
        band(sidewalk, lane, -walked, walked)
        band(road, lane, -paved, paved)
        if lane.in_junction:
            band(junction, lane, -paved, paved)
        else:
            _fill_directions(directions, grid, lane)
    half_line = max(LINE_M / 2.0, 0.75 / px_per_m)
    for lane in lanes:
        for side, present in zip((-1.0, 1.0), lane.lines, strict=True):
            if present:
                edge = side * lane.half_width
                _fill(line, grid, lane, edge - half_line, edge + half_line, 1)
    directions[junction != 0] = NO_LANE
    bits = road * np.uint8(ROAD_BIT)
    bits |= line * np.uint8(LANE_BIT)
    bits |= (sidewalk & (1 - road)) * np.uint8(SIDEWALK_BIT)
    bits |= junction * np.uint8(JUNCTION_BIT)
    return StaticRaster(grid, bits, directions)


def _fill(
    plane: NDArray[np.uint8],
    grid: RasterGrid,
    lane: Lane,
    left_m: NDArray[np.float64],
    right_m: NDArray[np.float64],
    value: int,
    part: slice = slice(None),
) -> None:
    fill_band(
        plane,
        grid.x0_m,
        grid.y0_m,
        grid.px_per_m,
        np.ascontiguousarray(lane.points[part]),
        left_m[part],
        right_m[part],
        value,
    )


def _fill_directions(plane: NDArray[np.uint8], grid: RasterGrid, lane: Lane) -> None:
    """Write a lane's direction code, segment by segment."""
    turns = np.arctan2(lane.points[:, 3], lane.points[:, 2]) / (2.0 * math.pi)
    codes = 1 + np.round(turns * DIRECTION_CODES).astype(np.int64) % DIRECTION_CODES
    for i in range(len(codes) - 1):
        half = lane.half_width
        _fill(plane, grid, lane, -half, half, int(codes[i]), slice(i, i + 2))
