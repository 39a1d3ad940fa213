"""One camera at one moment."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel

NEAR_M = 0.12
LOWEST_M = 0.1

# tuples, not arrays: each array that a call passes on costs an atomic count up and down
Vector = tuple[float, float, float]


class Ego(NamedTuple):
    """The car that carries the cameras: it casts a shadow, but is not in its own pictures."""

    x: float
    y: float
    heading: float
    length_m: float
    width_m: float


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


@leaf_kernel
def to_camera(view: View, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world point in the camera frame: right, down, forward."""
    dx, dy, dz = x - view.place[0], y - view.place[1], z - view.place[2]
    a = view.axes
    return (
        a[0][0] * dx + a[0][1] * dy + a[0][2] * dz,
        a[1][0] * dx + a[1][1] * dy + a[1][2] * dz,
        a[2][0] * dx + a[2][1] * dy + a[2][2] * dz,
    )


@leaf_kernel
def may_see(view: View, x: float, y: float, radius_m: float, reach_m: float) -> bool:
    """Whether an upright cylinder around (x, y) can be in the picture; errs to yes."""
    dx, dy = x - view.place[0], y - view.place[1]
    if dx * dx + dy * dy > (reach_m + radius_m) ** 2:
        return False
    a = view.axes
    forward = a[2][0] * dx + a[2][1] * dy
    right = a[0][0] * dx + a[0][1] * dy
    # the part of the axes that heights up to 20 m can add, seen from the camera's own
    tall = 20.0 + view.place[2]
    slack = radius_m + tall * abs(a[2][2])
    if forward < -slack:
        return False
    half = max(view.center_u, view.width - 1.0 - view.center_u) / view.focal_px
    side = radius_m * math.sqrt(1.0 + half * half) + tall * (abs(a[0][2]) + half * abs(a[2][2]))
    return abs(right) <= half * max(forward, 0.0) + side


@leaf_kernel
def to_world(turn: tuple[float, float, float, float, float, float], vector: NDArray) -> Vector:
    """A vector (3,) of the body frame in the world frame.

    Args:
        turn: Cosine and sine of pitch, roll and heading.
        vector: Forward, left, up.
    """
    cos_p, sin_p, cos_r, sin_r, cos_h, sin_h = turn
    x, y, z = vector[0], vector[1], vector[2]
    y, z = cos_r * y - sin_r * z, sin_r * y + cos_r * z
    x, z = cos_p * x + sin_p * z, -sin_p * x + cos_p * z
    # ego x is forward, y left; the world has y south, so left is (sin, -cos)
    return cos_h * x + sin_h * y, sin_h * x - cos_h * y, z


@leaf_kernel
def camera_view(
    ego: Ego,
    pitch_rad: float,
    roll_rad: float,
    axes: NDArray,
    place: NDArray,
    intrinsics: NDArray,
    height: int,
    width: int,
) -> View:
    """Where a camera is and looks, given the body's pitch and roll about the ego's origin.

    Args:
        ego: The car.
        pitch_rad: Nose down.
        roll_rad: Right side down.
        axes: (3, 3) the camera's right, down, forward in the body frame.
        place: (3,) its position in the body frame.
        intrinsics: (3, 3).
        height: Rows.
        width: Columns.
    """
    cos_p, sin_p = math.cos(pitch_rad), math.sin(pitch_rad)
    cos_r, sin_r = math.cos(roll_rad), math.sin(roll_rad)
    cos_h, sin_h = math.cos(ego.heading), math.sin(ego.heading)
    turn = (cos_p, sin_p, cos_r, sin_r, cos_h, sin_h)
    dx, dy, z = to_world(turn, place)
    return View(
        height,
        width,
        intrinsics[0, 0],
        intrinsics[0, 2],
        intrinsics[1, 2],
        (to_world(turn, axes[0]), to_world(turn, axes[1]), to_world(turn, axes[2])),
        # a camera low at the end of a long car would dip into the ground when braking
        (dx + ego.x, dy + ego.y, max(z, LOWEST_M)),
    )
