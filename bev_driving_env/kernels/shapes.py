"""The solid shapes that upright things are made of, each lit as it is drawn."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .view import Vector, View, to_camera

# how a face is textured: a page of ``cameras.textures``; facades come in four styles.
# Of numpy's type: numba compiles a kernel anew for each plain constant it is called with.
PLAIN, EMISSIVE, BRICKS, SLATS, FOLIAGE, TILES, GLASS, POSTER, FACADE = (
    cast("int", number) for number in np.arange(9)
)
TWO_SIDED, ONE_SIDED = (cast("bool", flag) for flag in np.array([False, True]))
FLAT, ROUND = TWO_SIDED, ONE_SIDED
NO_VARIANT, TRIANGLE, RECTANGLE, OCTAGON = (
    cast("int", number) for number in np.array([0, 3, 4, 8])
)
FACADES = 4
PATTERNS = 8 + FACADES
CROWN_M = 0.2
MOST_CORNERS = 8
MOST_FACES = 2048
"""For each camera; in town, a few hundred are seen."""
# columns of Records.table
SIZE, MARK, PATTERN, VARIANT, COLOUR, ORIGIN_X, ORIGIN_Y, ORIGIN_Z, ALONG_X, ALONG_Y = (
    0, 1, 2, 3, 4, 7, 8, 9, 10, 11,
)  # fmt: skip
FACE_COLUMNS = 12


class Lighting(NamedTuple):
    """Sun and sky of a scene, and the colours of things under them.

    Attributes:
        sun_x: Direction towards the sun (unit vector, z up).
        sun_y: See above.
        sun_z: See above.
        sun: Brightness that a face turned to the sun gets, by colour.
        ambient: Brightness that every face gets.
        paints: (slots, 3) colours of things, 0..255.
    """

    sun_x: float
    sun_y: float
    sun_z: float
    sun: Vector
    ambient: Vector
    paints: NDArray[np.float32]


class Records(NamedTuple):
    """The faces of all images, to be filled and shaded; row 0 stands for "no face".

    Shapes only list their faces here. Filling them is one loop in one place
    (``mesh.fill_faces``), which keeps both the shapes and their compilation small.

    Attributes:
        corners: (M, 8, 3) corners in the camera frame.
        table: (M, 12) number of corners; what a shadow adds to the shadow mask, 0 for a face;
            texture; random number of the thing it belongs to; lit colour; origin x, y, z and
            horizontal unit vector of the face.
        used: (1,) rows in use.
    """

    corners: NDArray[np.float64]
    table: NDArray[np.float64]
    used: NDArray[np.int64]


def new_records(cameras: int) -> Records:
    """An empty list of faces for some cameras."""
    most = MOST_FACES * cameras
    return Records(
        np.zeros((most, MOST_CORNERS, 3)),
        np.zeros((most, FACE_COLUMNS)),
        np.ones(1, np.int64),
    )


@leaf_kernel
def set_corner(view: View, records: Records, k: int, x: float, y: float, z: float) -> None:
    """Make a world point a corner of the next face."""
    number = records.used[0]
    right, down, forward = to_camera(view, x, y, z)
    records.corners[number, k, 0] = right
    records.corners[number, k, 1] = down
    records.corners[number, k, 2] = forward


@leaf_kernel
def add_face(
    records: Records,
    lighting: Lighting,
    count: int,
    slot: int,
    pattern: int,
    normal_x: float,
    normal_y: float,
    normal_z: float,
    x: float,
    y: float,
    z: float,
    variant: int,
) -> None:
    """Add the face whose ``count`` corners have been set; the last row is never left."""
    number = records.used[0]
    row = records.table[number]
    row[SIZE], row[MARK], row[PATTERN], row[VARIANT] = count, 0.0, pattern, variant
    facing = normal_x * lighting.sun_x + normal_y * lighting.sun_y + normal_z * lighting.sun_z
    if pattern == FOLIAGE:
        facing = 0.35 + 0.35 * facing  # leaves face all ways
    facing = max(facing, 0.0)
    # a little light from the brighter side of the sky tells faces apart when there is no sun
    fill = 0.92 + 0.10 * normal_x * 0.7 + 0.05 * normal_y + 0.12 * normal_z
    for c in range(3):
        light = lighting.ambient[c] * fill + lighting.sun[c] * facing
        if pattern == EMISSIVE:
            light = 1.0
        row[COLOUR + c] = lighting.paints[slot, c] * light
    row[ORIGIN_X], row[ORIGIN_Y], row[ORIGIN_Z] = x, y, z
    length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
    if length > 1e-6:
        row[ALONG_X], row[ALONG_Y] = -normal_y / length, normal_x / length
    else:
        row[ALONG_X], row[ALONG_Y] = 1.0, 0.0
    if number < records.table.shape[0] - 1:
        records.used[0] = number + 1


@leaf_kernel
def add_shadow(records: Records, count: int, mark: int) -> None:
    """Add a patch of shadow on the ground whose corners have been set."""
    number = records.used[0]
    records.table[number, SIZE], records.table[number, MARK] = count, mark
    if number < records.table.shape[0] - 1:
        records.used[0] = number + 1


@leaf_kernel
def draw_wall(
    view: View,
    records: Records,
    lighting: Lighting,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    low_m: float,
    high_m: float,
    slot: int,
    pattern: int,
    variant: int,
    one_sided: bool,
) -> None:
    """A vertical rectangle over the segment 0-1; its front is to the right of the way 0 to 1."""
    length = math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    nx, ny = -(y1 - y0) / length, (x1 - x0) / length
    side = (view.place[0] - x0) * nx + (view.place[1] - y0) * ny
    if side <= 0.0:
        if one_sided:
            return
        nx, ny = -nx, -ny
    for k in range(4):
        x, y = (x1, y1) if 0 < k < 3 else (x0, y0)
        set_corner(view, records, k, x, y, high_m if k > 1 else low_m)
    add_face(records, lighting, RECTANGLE, slot, pattern, nx, ny, 0.0, x0, y0, low_m, variant)


@leaf_kernel
def draw_box(
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
    slot: int,
    pattern: int,
    top_slot: int,
    variant: int,
) -> None:
    """An upright box: the sides that face the camera, and the top or bottom if it is seen."""
    ax, ay = cos * half_length, sin * half_length
    bx, by = -sin * half_width, cos * half_width
    # corners in turn, so that the outside lies to the right of each side
    xs = (x + ax + bx, x + ax - bx, x - ax - bx, x - ax + bx)
    ys = (y + ay + by, y + ay - by, y - ay - by, y - ay + by)
    for k in range(4):
        j = (k + 1) % 4
        draw_wall(
            view,
            records,
            lighting,
            xs[k],
            ys[k],
            xs[j],
            ys[j],
            low_m,
            high_m,
            slot,
            pattern,
            variant,
            ONE_SIDED,
        )
    above = view.place[2] > high_m
    if above or view.place[2] < low_m:
        level = high_m if above else low_m
        for k in range(4):
            set_corner(view, records, k, xs[k], ys[k], level)
            up = 1.0 if above else -1.0
        add_face(records, lighting, RECTANGLE, top_slot, PLAIN, 0.0, 0.0, up, x, y, level, variant)


@leaf_kernel
def draw_gable(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    cos: float,
    sin: float,
    half_length: float,
    half_width: float,
    eaves_m: float,
    ridge_m: float,
    slot: int,
    roof_slot: int,
    variant: int,
) -> None:
    """The roof of a house: two slopes whose ridge runs along its length, and two gable walls."""
    over = 0.35
    slope = (ridge_m - eaves_m) / half_width
    for side in (-1.0, 1.0):
        nx, ny, nz = -sin * side * slope, cos * side * slope, 1.0
        norm = math.sqrt(slope * slope + 1.0)
        nx, ny, nz = nx / norm, ny / norm, nz / norm
        low = eaves_m - over * slope
        out = side * (half_width + over)
        reach = half_length + over
        seen = (view.place[0] - x) * nx + (view.place[1] - y) * ny
        seen += (view.place[2] - ridge_m) * nz
        for k in range(4):
            along = reach if 0 < k < 3 else -reach
            across, z = (out, low) if k > 1 else (0.0, ridge_m)
            set_corner(
                view,
                records,
                k,
                x + cos * along - sin * across,
                y + sin * along + cos * across,
                z,
            )
        if seen <= 0.0:
            # from below one sees the underside of the eaves, in shade
            nx, ny, nz = -nx, -ny, -nz
        add_face(records, lighting, RECTANGLE, roof_slot, TILES, nx, ny, nz, x, y, low, variant)
    for end in (-1.0, 1.0):
        ex, ey = x + end * cos * half_length, y + end * sin * half_length
        if (view.place[0] - ex) * cos * end + (view.place[1] - ey) * sin * end <= 0.0:
            continue
        for k in range(3):
            across, z = (half_width * (2 * k - 1), eaves_m) if k < 2 else (0.0, ridge_m)
            set_corner(view, records, k, ex - sin * across, ey + cos * across, z)
        add_face(
            records,
            lighting,
            TRIANGLE,
            slot,
            BRICKS,
            cos * end,
            sin * end,
            0.0,
            ex,
            ey,
            0.0,
            variant,
        )


@leaf_kernel
def draw_disc(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    z: float,
    cos: float,
    sin: float,
    half_width: float,
    half_height: float,
    slot: int,
    pattern: int,
    variant: int,
) -> None:
    """An upright octagon that faces the direction (cos, sin): lamps and wheels."""
    if (view.place[0] - x) * cos + (view.place[1] - y) * sin <= 0.0:
        return
    for k in range(OCTAGON):
        turn = (k + 0.5) * 2.0 * math.pi / OCTAGON
        across, up = half_width * math.cos(turn), half_height * math.sin(turn)
        set_corner(view, records, k, x - sin * across, y + cos * across, z + up)
    add_face(records, lighting, OCTAGON, slot, pattern, cos, sin, 0.0, x, y, z, variant)


@leaf_kernel
def draw_sprite(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    z: float,
    half_width: float,
    half_height: float,
    round_shape: bool,
    slot: int,
    pattern: int,
    variant: int,
) -> None:
    """An upright shape that turns to the camera: trunks, crowns, poles, people."""
    dx, dy = view.place[0] - x, view.place[1] - y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-3:
        return
    cos, sin = dx / distance, dy / distance
    # poles thinner than a pixel would come and go
    half_width = max(half_width, 0.45 * distance / view.focal_px)
    if round_shape:
        # a crown stands in front of its trunk
        draw_disc(
            view, records, lighting, x + CROWN_M * cos, y + CROWN_M * sin, z, cos, sin, half_width,
            half_height, slot, pattern, variant,
        )  # fmt: skip
        return
    sx, sy = -sin * half_width, cos * half_width
    draw_wall(
        view,
        records,
        lighting,
        x - sx,
        y - sy,
        x + sx,
        y + sy,
        z - half_height,
        z + half_height,
        slot,
        pattern,
        variant,
        TWO_SIDED,
    )


@leaf_kernel
def draw_strip(
    view: View,
    records: Records,
    lighting: Lighting,
    x0: float,
    y0: float,
    z0: float,
    half0: float,
    x1: float,
    y1: float,
    z1: float,
    half1: float,
    slot: int,
    variant: int,
) -> None:
    """A strip from point 0 up to point 1, of half widths 0 and 1, that turns to the camera."""
    dx, dy = view.place[0] - x1, view.place[1] - y1
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-3:
        return
    cos, sin = dx / distance, dy / distance
    least = 0.45 * distance / view.focal_px
    for k in range(4):
        half = max(half1 if k > 1 else half0, least)
        across = half if 0 < k < 3 else -half
        x, y, z = (x1, y1, z1) if k > 1 else (x0, y0, z0)
        set_corner(view, records, k, x - sin * across, y + cos * across, z)
    add_face(records, lighting, RECTANGLE, slot, PLAIN, cos, sin, 0.0, x0, y0, z0, variant)
