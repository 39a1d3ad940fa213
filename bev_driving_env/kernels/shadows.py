"""Shadows on the ground: what stands between it and the sun, seen by a camera."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .shapes import OCTAGON, RECTANGLE, Lighting, Records, add_shadow, set_corner
from .view import View, may_see

CAST, UNDER = np.array([1, 2])
LONGEST_M = 60.0
CONTACT_M = 0.02


@leaf_kernel
def shadow_shift(lighting: Lighting, height_m: float) -> tuple[float, float]:
    """Where the shadow of a point at some height falls, relative to the foot of it."""
    reach = height_m / max(lighting.sun_z, 0.05)
    dx, dy = -lighting.sun_x * reach, -lighting.sun_y * reach
    length = math.sqrt(dx * dx + dy * dy)
    if length > LONGEST_M:
        dx, dy = dx * LONGEST_M / length, dy * LONGEST_M / length
    return dx, dy


@leaf_kernel
def base_and_top(
    x: float,
    y: float,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    low_x: float,
    low_y: float,
    high_x: float,
    high_y: float,
    hull: NDArray,
) -> int:
    """The outline (hull) of the shadows of a box's base and top; returns its corners' number."""
    # of the eight corners, the six on the outside: start where the shift turns from in to out
    count = 0
    shift_x, shift_y = high_x - low_x, high_y - low_y
    xs = (ax + bx, ax - bx, -ax - bx, -ax + bx)
    ys = (ay + by, ay - by, -ay - by, -ay + by)
    for k in range(4):
        j, i = (k + 1) % 4, (k + 3) % 4
        # is the side before, and after, this corner turned to where the shadow falls?
        before = (ys[k] - ys[i]) * -shift_x + (xs[k] - xs[i]) * shift_y > 0.0
        after = (ys[j] - ys[k]) * -shift_x + (xs[j] - xs[k]) * shift_y > 0.0
        if not before or not after:
            hull[count, 0], hull[count, 1] = x + xs[k] + low_x, y + ys[k] + low_y
            count += 1
            if not before and after:
                hull[count, 0], hull[count, 1] = x + xs[k] + high_x, y + ys[k] + high_y
                count += 1
        else:
            hull[count, 0], hull[count, 1] = x + xs[k] + high_x, y + ys[k] + high_y
            count += 1
        if before and not after:
            # out of the shadow side: its top comes before its base
            last_x, last_y = hull[count - 1, 0], hull[count - 1, 1]
            hull[count - 1, 0], hull[count - 1, 1] = x + xs[k] + high_x, y + ys[k] + high_y
            hull[count, 0], hull[count, 1] = last_x, last_y
            count += 1
    return count


@leaf_kernel
def cast_box(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    cos: float,
    sin: float,
    half_length: float,
    half_width: float,
    low_m: float,
    high_m: float,
    hull: NDArray,
) -> None:
    """The shadow of an upright box: the hexagon around its base and its top's shadow.

    Args:
        view: The camera.
        records: Gets the shadow.
        lighting: Where the sun is.
        x: Centre of the box.
        y: Centre of the box.
        cos: Direction of its length.
        sin: Direction of its length.
        half_length: Half its length.
        half_width: Half its width.
        low_m: Height of its underside.
        high_m: Height of its top.
        hull: (8, 2) scratch.
    """
    low_x, low_y = shadow_shift(lighting, low_m)
    high_x, high_y = shadow_shift(lighting, high_m)
    radius = math.sqrt(half_length * half_length + half_width * half_width)
    middle_x, middle_y = x + (low_x + high_x) / 2.0, y + (low_y + high_y) / 2.0
    reach = radius + math.sqrt((high_x - low_x) ** 2 + (high_y - low_y) ** 2) / 2.0
    if not may_see(view, middle_x, middle_y, reach, 70.0):
        return
    count = base_and_top(
        x, y, cos * half_length, sin * half_length, -sin * half_width, cos * half_width,
        low_x, low_y, high_x, high_y, hull,
    )  # fmt: skip
    for k in range(count):
        set_corner(view, records, k, hull[k, 0], hull[k, 1], 0.0)
    add_shadow(records, count, CAST)


@leaf_kernel
def cast_crown(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    z: float,
    half_width: float,
    half_height: float,
) -> None:
    """The shadow of a tree's crown: an ellipse, drawn out along the sun's direction."""
    dx, dy = shadow_shift(lighting, z)
    level = math.sqrt(lighting.sun_x**2 + lighting.sun_y**2)
    if not may_see(view, x + dx, y + dy, 3.0 * half_width, 70.0) or level < 1e-6:
        return
    along_x, along_y = -lighting.sun_x / level, -lighting.sun_y / level
    steep = lighting.sun_z
    stretch = min(math.sqrt((half_height * level) ** 2 + (half_width * steep) ** 2) / steep, 25.0)
    for k in range(8):
        turn = (k + 0.5) * math.pi / 4.0
        a, b = math.cos(turn) * stretch, math.sin(turn) * half_width
        set_corner(
            view,
            records,
            k,
            x + dx + a * along_x - b * along_y,
            y + dy + a * along_y + b * along_x,
            0.0,
        )
    add_shadow(records, OCTAGON, CAST)


@leaf_kernel
def cast_vehicle(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    heading: float,
    length_m: float,
    width_m: float,
    height_m: float,
    sunny: bool,
    hull: NDArray,
) -> None:
    """A vehicle's shadow, and the dark beneath it that is there without sun too."""
    if not may_see(view, x, y, length_m, 60.0):
        return
    cos, sin = math.cos(heading), math.sin(heading)
    half, side = length_m / 2.0, width_m / 2.0
    ax, ay, bx, by = cos * half, sin * half, -sin * side, cos * side
    for k in range(4):
        ahead, aside = 1.0 if k < 2 else -1.0, 1.0 if k % 3 == 0 else -1.0
        set_corner(view, records, k, x + ahead * ax + aside * bx, y + ahead * ay + aside * by, 0.0)
    add_shadow(records, RECTANGLE, UNDER)
    if sunny:
        top = 0.8 * height_m
        cast_box(
            view, records, lighting, x, y, cos, sin, half, side, np.float64(CONTACT_M), top, hull
        )
