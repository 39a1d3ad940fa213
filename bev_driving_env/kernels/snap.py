"""Rows of other road users lie on a grid, so that logs can store them in few bits, exactly."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import HEADING, SPEED, X, Y

PER_UNIT = 1024.0
"""Steps of the grid per metre and per metre a second; a power of two, so that floats hit it."""
PER_RAD = 4096.0


@leaf_kernel
def snap(value: float, per_unit: float) -> float:
    """The nearest multiple of ``1 / per_unit``."""
    return math.floor(value * per_unit + 0.5) / per_unit


@leaf_kernel
def write_row(row: NDArray, x: float, y: float, heading: float, speed: float) -> None:
    """Write pose and speed of an actor's row, on the grid."""
    row[X], row[Y] = snap(x, PER_UNIT), snap(y, PER_UNIT)
    row[HEADING], row[SPEED] = snap(heading, PER_RAD), snap(speed, PER_UNIT)


@leaf_kernel
def snap_rows(rows: NDArray) -> None:
    """Move all rows (A, 6) on to the grid."""
    for i in range(rows.shape[0]):
        write_row(rows[i], rows[i, X], rows[i, Y], rows[i, HEADING], rows[i, SPEED])
