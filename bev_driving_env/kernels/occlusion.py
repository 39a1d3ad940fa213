"""What need not be drawn: things too far away, and things behind nearer buildings."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .view import NEAR_M, View, to_camera

SAFETY_PX = 1.5


class Skyline(NamedTuple):
    """For each image column, what the buildings drawn so far hide.

    Attributes:
        row: (W,) everything farther is hidden from this row downwards.
        nearness: (W,) inverse depth of the wall that hides it.
    """

    row: NDArray[np.float64]
    nearness: NDArray[np.float64]


@leaf_kernel
def within_reach(table: NDArray, x: float, y: float, reach_m: float, found: NDArray) -> int:
    """Rows of a table that start with x, y and lie within reach.

    Args:
        table: (B, columns).
        x: Where one looks from.
        y: See above.
        reach_m: Farther things are left out.
        found: (B,) int64 output, row numbers.

    Returns:
        How many rows are within reach.
    """
    count = 0
    for k in range(table.shape[0]):
        if (table[k, 0] - x) ** 2 + (table[k, 1] - y) ** 2 < reach_m * reach_m:
            found[count] = k
            count += 1
    return count


@leaf_kernel
def nearest_first(
    table: NDArray,
    sizes: NDArray,
    x: float,
    y: float,
    reach_m: float,
    keys: NDArray,
    order: NDArray,
) -> int:
    """Rows of a table that start with x, y, within reach, the nearest first.

    Args:
        table: (B, columns).
        sizes: (B,) half the length of each thing, which brings it nearer.
        x: Where one looks from.
        y: See above.
        reach_m: Farther things are left out.
        keys: (B,) float64 scratch.
        order: (B,) int64 output.

    Returns:
        How many rows are within reach.
    """
    count = 0
    for k in range(table.shape[0]):
        distance = math.sqrt((table[k, 0] - x) ** 2 + (table[k, 1] - y) ** 2) - sizes[k]
        if distance < reach_m:
            keys[count] = distance
            order[count] = k
            count += 1
    # Shell's sort: numba's argsort takes seconds to compile
    gap = count // 2
    while gap > 0:
        for i in range(gap, count):
            key, row = keys[i], order[i]
            j = i
            while j >= gap and keys[j - gap] > key:
                keys[j], order[j] = keys[j - gap], order[j - gap]
                j -= gap
            keys[j], order[j] = key, row
        gap //= 2
    return count


@leaf_kernel
def is_hidden(
    view: View, skyline: Skyline, x: float, y: float, radius_m: float, high_m: float
) -> bool:
    """Whether an upright cylinder that stands on the ground is wholly behind buildings."""
    right, down, depth = to_camera(view, x, y, high_m)
    nearest = depth - radius_m
    if nearest < 1.0:
        return False
    # the cylinder's top, as near and as wide as any part of it can be
    middle = view.center_u + view.focal_px * right / depth
    half = view.focal_px * radius_m * 1.5 / nearest
    half += abs(middle - view.center_u) * radius_m / nearest
    top = view.center_v + view.focal_px * down / (nearest if down < 0.0 else depth + radius_m)
    top -= view.focal_px * radius_m * abs(view.axes[1][2] + 1.0) / nearest + SAFETY_PX
    # a rolled camera sees it lean
    half += abs(view.axes[0][2]) * view.focal_px * (high_m + view.place[2]) / nearest + SAFETY_PX
    first, last = int(middle - half), int(middle + half) + 1
    if last < 0 or first >= view.width:
        return True
    first, last = max(first, 0), min(last, view.width - 1)
    nearness = 1.0 / nearest
    for u in range(first, last + 1):
        if skyline.row[u] > top or skyline.nearness[u] < nearness:
            return False
    return True


@leaf_kernel
def raise_skyline(
    view: View, skyline: Skyline, x0: float, y0: float, x1: float, y1: float, high_m: float
) -> None:
    """Note that a wall on the ground over the segment 0-1 hides what is behind it."""
    a_right, a_down, a_depth = to_camera(view, x0, y0, high_m)
    b_right, b_down, b_depth = to_camera(view, x1, y1, high_m)
    c_right, _, c_depth = to_camera(view, x0, y0, 0.0)
    d_right, _, d_depth = to_camera(view, x1, y1, 0.0)
    if min(a_depth, b_depth, c_depth, d_depth) < NEAR_M:
        return
    au, av = a_right / a_depth, a_down / a_depth
    bu, bv = b_right / b_depth, b_down / b_depth
    cu, du = c_right / c_depth, d_right / d_depth
    if au > bu:
        au, av, bu, bv, cu, du = bu, bv, au, av, du, cu
        a_depth, b_depth, c_depth, d_depth = b_depth, a_depth, d_depth, c_depth
    left = view.center_u + view.focal_px * max(au, cu) + SAFETY_PX
    right = view.center_u + view.focal_px * min(bu, du) - SAFETY_PX
    first, last = max(math.ceil(left), 0), min(math.floor(right), view.width - 1)
    if last < first:
        return
    slope = (bv - av) / (bu - au)
    near0, near1 = 1.0 / max(a_depth, c_depth), 1.0 / max(b_depth, d_depth)
    fall = (near1 - near0) / (bu - au)
    for u in range(first, last + 1):
        where = (u - view.center_u) / view.focal_px - au
        row = view.center_v + view.focal_px * (av + slope * where) + SAFETY_PX
        if row < skyline.row[u]:
            skyline.row[u] = row
            skyline.nearness[u] = min(near0 + fall * where, max(near0, near1))
