"""Filling convex polygons, the one drawing primitive of rasters and BEV channels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import kernel


@kernel
def fill_convex(plane: NDArray, columns: NDArray, rows: NDArray, keep: int, value: int) -> None:
    """Write every pixel of a plane (H, W) uint8 whose centre lies in a convex polygon.

    Pixel centres are at integer coordinates, edges count as inside. Parts outside the plane are
    skipped. Of a polygon that is not convex, the hull of each pixel row is filled.

    Args:
        plane: (H, W), written in place.
        columns: (K,) corner columns.
        rows: (K,) corner rows.
        keep: Bits of the old pixel that stay; 0 overwrites it.
        value: Bits to add.
    """
    keep8, value8 = np.uint8(keep), np.uint8(value)
    height, width = plane.shape
    count = columns.shape[0]
    top, bottom = rows[0], rows[0]
    left, right = columns[0], columns[0]
    for k in range(1, count):
        top = min(top, rows[k])
        bottom = max(bottom, rows[k])
        left = min(left, columns[k])
        right = max(right, columns[k])
    if bottom < 0.0 or right < 0.0 or top > height - 1.0 or left > width - 1.0:
        return
    for row in range(max(0, math.ceil(top)), min(height - 1, math.floor(bottom)) + 1):
        first, last = math.inf, -math.inf
        previous = count - 1
        for k in range(count):
            low, high = rows[previous], rows[k]
            if (low <= row and row <= high) or (high <= row and row <= low):
                if low == high:
                    start = min(columns[previous], columns[k])
                    end = max(columns[previous], columns[k])
                else:
                    start = columns[previous] + (row - low) / (high - low) * (
                        columns[k] - columns[previous]
                    )
                    end = start
                first = min(first, start)
                last = max(last, end)
            previous = k
        if first > last:
            continue
        for column in range(max(0, math.ceil(first)), min(width - 1, math.floor(last)) + 1):
            plane[row, column] = (plane[row, column] & keep8) | value8


@kernel
def fill_band(
    plane: NDArray,
    grid_x0: float,
    grid_y0: float,
    px_per_m: float,
    points: NDArray,
    left_m: NDArray,
    right_m: NDArray,
    keep: int,
    value: int,
) -> None:
    """Fill the band between two lateral offsets along a sampled curve, segment by segment.

    Args:
        plane: (H, W), written in place; pixel (r, c) has its centre half a pixel inside.
        grid_x0: World x of the plane's left border.
        grid_y0: World y of the plane's top border.
        px_per_m: Resolution.
        points: Curve (M, 4): x, y and unit direction.
        left_m: (M,) lateral offset of the left border, positive to the right of the curve.
        right_m: (M,) lateral offset of the right border.
        keep: Bits of the old pixels that stay.
        value: Bits to add.
    """
    columns, rows = np.empty(4), np.empty(4)
    for i in range(points.shape[0] - 1):
        for corner in range(4):
            k = i if corner < 2 else i + 1
            offset = left_m[k] if corner in (0, 3) else right_m[k]
            x = points[k, 0] - points[k, 3] * offset
            y = points[k, 1] + points[k, 2] * offset
            columns[corner] = (x - grid_x0) * px_per_m - 0.5
            rows[corner] = (y - grid_y0) * px_per_m - 0.5
        fill_convex(plane, columns, rows, keep, value)
