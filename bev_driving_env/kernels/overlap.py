"""Whether oriented boxes overlap, and whether the ego hits any of a town's solid things."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import HEADING, X, Y

SOLID_X, SOLID_Y, SOLID_HEADING, SOLID_LENGTH, SOLID_WIDTH = range(5)
SOLID_COLUMNS = 5


class SolidGrid(NamedTuple):
    """Square cells that tell which solids are near: cell (r, c) has the number r * columns + c."""

    x0_m: float
    y0_m: float
    cell_m: float
    columns: int
    rows: int


@leaf_kernel
def circles_apart(
    dx: float,
    dy: float,
    a_half_length: float,
    a_half_width: float,
    b_half_length: float,
    b_half_width: float,
) -> bool:
    """Whether the circumscribed circles of two boxes whose centres are (dx, dy) apart are apart."""
    a_radius2 = a_half_length * a_half_length + a_half_width * a_half_width
    b_radius2 = b_half_length * b_half_length + b_half_width * b_half_width
    reach2 = a_radius2 + b_radius2 + 2.0 * math.sqrt(a_radius2 * b_radius2)
    return dx * dx + dy * dy > reach2


@leaf_kernel
def boxes_overlap(
    ax: float,
    ay: float,
    a_cos: float,
    a_sin: float,
    a_half_length: float,
    a_half_width: float,
    bx: float,
    by: float,
    b_cos: float,
    b_sin: float,
    b_half_length: float,
    b_half_width: float,
) -> bool:
    """Whether two oriented rectangles overlap, by separating axes; touching counts.

    Args:
        ax: Centre of the first box, world x in metres.
        ay: Its world y.
        a_cos: Cosine of its heading.
        a_sin: Sine of its heading.
        a_half_length: Half its extent along its heading, metres.
        a_half_width: Half its extent across.
        bx: The same of the second box.
        by: The same of the second box.
        b_cos: The same of the second box.
        b_sin: The same of the second box.
        b_half_length: The same of the second box.
        b_half_width: The same of the second box.
    """
    dx, dy = bx - ax, by - ay
    if circles_apart(dx, dy, a_half_length, a_half_width, b_half_length, b_half_width):
        return False
    cos = abs(a_cos * b_cos + a_sin * b_sin)
    sin = abs(a_cos * b_sin - a_sin * b_cos)
    # on each side's axis: are the centres farther apart than both boxes reach?
    return not (
        abs(dx * a_cos + dy * a_sin) > a_half_length + b_half_length * cos + b_half_width * sin
        or abs(dy * a_cos - dx * a_sin) > a_half_width + b_half_length * sin + b_half_width * cos
        or abs(dx * b_cos + dy * b_sin) > b_half_length + a_half_length * cos + a_half_width * sin
        or abs(dy * b_cos - dx * b_sin) > b_half_width + a_half_length * sin + a_half_width * cos
    )


@leaf_kernel
def hits_any(
    solids: NDArray,
    cell_start: NDArray,
    cell_items: NDArray,
    grid: SolidGrid,
    ego: NDArray,
    half_length: float,
    half_width: float,
) -> bool:
    """Whether the ego's footprint overlaps any solid.

    Only solids in the grid cells around the ego's circumscribed circle are looked at; outside the
    grid there is nothing to hit.

    Args:
        solids: (F, 5) x, y, heading, length and width.
        cell_start: (cells + 1,) int64, where each cell's part of ``cell_items`` begins.
        cell_items: (M,) int64 numbers of solids.
        grid: The cells.
        ego: (4,) state row.
        half_length: Half the ego's length in metres.
        half_width: Half its width.
    """
    x, y = ego[X], ego[Y]
    radius = math.sqrt(half_length * half_length + half_width * half_width)
    # in cells, and compared before they become integers: the ego may be anywhere
    left, right = (x - radius - grid.x0_m) / grid.cell_m, (x + radius - grid.x0_m) / grid.cell_m
    top, bottom = (y - radius - grid.y0_m) / grid.cell_m, (y + radius - grid.y0_m) / grid.cell_m
    if not (right >= 0.0 and bottom >= 0.0 and left < grid.columns and top < grid.rows):
        return False
    first_column, first_row = max(0, math.floor(left)), max(0, math.floor(top))
    last_column = min(grid.columns - 1, math.floor(right))
    last_row = min(grid.rows - 1, math.floor(bottom))
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            cell = row * grid.columns + column
            for k in range(cell_start[cell], cell_start[cell + 1]):
                item = cell_items[k]
                bx, by = solids[item, SOLID_X], solids[item, SOLID_Y]
                b_half_length = solids[item, SOLID_LENGTH] / 2.0
                b_half_width = solids[item, SOLID_WIDTH] / 2.0
                # spares most solids the sine and cosine of their heading
                if circles_apart(
                    bx - x, by - y, half_length, half_width, b_half_length, b_half_width
                ):
                    continue
                heading = solids[item, SOLID_HEADING]
                if boxes_overlap(
                    x,
                    y,
                    cos,
                    sin,
                    half_length,
                    half_width,
                    bx,
                    by,
                    math.cos(heading),
                    math.sin(heading),
                    b_half_length,
                    b_half_width,
                ):
                    return True
    return False
