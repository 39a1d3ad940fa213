"""One camera at one moment."""

from __future__ import annotations

import math
from typing import NamedTuple

from .jit import kernel

NEAR_M = 0.12

# tuples, not arrays: each array that a call passes on costs an atomic count up and down
Vector = tuple[float, float, float]


class View(NamedTuple):
    """Where a camera is and looks, in the world frame (z up).

    Attributes:
        height: Rows of the image.
        width: Columns.
        focal_px: Focal length.
        center_u: Column of the principal point.
        center_v: Row of the principal point.
        axes: Three rows: right, down, forward.
        place: Position of the camera.
    """

    height: int
    width: int
    focal_px: float
    center_u: float
    center_v: float
    axes: tuple[Vector, Vector, Vector]
    place: Vector


@kernel
def to_camera(view: View, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world point in the camera frame: right, down, forward."""
    dx, dy, dz = x - view.place[0], y - view.place[1], z - view.place[2]
    a = view.axes
    return (
        a[0][0] * dx + a[0][1] * dy + a[0][2] * dz,
        a[1][0] * dx + a[1][1] * dy + a[1][2] * dz,
        a[2][0] * dx + a[2][1] * dy + a[2][2] * dz,
    )


@kernel
def may_see(view: View, x: float, y: float, radius_m: float, reach_m: float) -> bool:
    """Whether an upright cylinder around (x, y) can be in the picture; errs to yes."""
    dx, dy = x - view.place[0], y - view.place[1]
    if dx * dx + dy * dy > (reach_m + radius_m) ** 2:
        return False
    a = view.axes
    forward = a[2][0] * dx + a[2][1] * dy
    right = a[0][0] * dx + a[0][1] * dy
    # the part of the axes that heights up to 20 m can add
    slack = radius_m + 20.0 * abs(a[2][2])
    if forward < -slack:
        return False
    half = max(view.center_u, view.width - 1.0 - view.center_u) / view.focal_px
    side = radius_m * math.sqrt(1.0 + half * half) + 20.0 * (abs(a[0][2]) + half * abs(a[2][2]))
    return abs(right) <= half * max(forward, 0.0) + side
