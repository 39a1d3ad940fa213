"""Filling convex polygons, the one drawing primitive of rasters and BEV channels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import kernel, leaf_kernel


@leaf_kernel
def fill_convex(
    plane: NDArray, columns: NDArray, rows: NDArray, spans: NDArray, keep: int, value: int
) -> None:
    """Write every pixel of a plane (H, W) uint8 whose centre lies in a convex polygon.

    Pixel centres are at integer coordinates, edges count as inside. Parts outside the plane are
    skipped. Of a polygon that is not convex, the hull of each pixel row is filled.

    Args:
        plane: (H, W), written in place.
        columns: (K,) corner columns.
        rows: (K,) corner rows.
        spans: (H, 2) float64 scratch.
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
    first_row = max(0, math.ceil(top))
    row_count = min(height - 1, math.floor(bottom)) + 1 - first_row
    if row_count <= 0:
        return
    for i in range(row_count):
        spans[i, 0], spans[i, 1] = math.inf, -math.inf
    previous = count - 1
    for k in range(count):
        low, high = previous, k
        if rows[low] > rows[high]:
            low, high = high, low
        # a horizontal edge needs no scan: its neighbours end where it does
        if rows[high] > rows[low]:
            slope = (columns[high] - columns[low]) / (rows[high] - rows[low])
            begin = max(math.ceil(rows[low]), first_row)
            end = min(math.floor(rows[high]), first_row + row_count - 1)
            for row in range(begin, end + 1):
                column = columns[low] + (row - rows[low]) * slope
                i = row - first_row
                spans[i, 0] = min(spans[i, 0], column)
                spans[i, 1] = max(spans[i, 1], column)
        previous = k
    for i in range(row_count):
        if spans[i, 0] <= spans[i, 1]:
            begin, end = max(0, math.ceil(spans[i, 0])), min(width - 1, math.floor(spans[i, 1]))
            for column in range(begin, end + 1):
                plane[first_row + i, column] = (plane[first_row + i, column] & keep8) | value8


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
    columns, rows, spans = np.empty(4), np.empty(4), np.empty((plane.shape[0], 2))
    for i in range(points.shape[0] - 1):
        for corner in range(4):
            k = i if corner < 2 else i + 1
            offset = left_m[k] if corner in (0, 3) else right_m[k]
            x = points[k, 0] - points[k, 3] * offset
            y = points[k, 1] + points[k, 2] * offset
            columns[corner] = (x - grid_x0) * px_per_m - 0.5
            rows[corner] = (y - grid_y0) * px_per_m - 0.5
        fill_convex(plane, columns, rows, spans, keep, value)
