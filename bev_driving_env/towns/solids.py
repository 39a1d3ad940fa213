"""Solid things beside the road, indexed by where they stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernels.overlap import SOLID_COLUMNS, SOLID_LENGTH, SOLID_WIDTH, SolidGrid


@dataclass(frozen=True, eq=False)
class Solids:
    """Boxes that nothing moves, and for each grid cell those that may reach into it.

    Attributes:
        boxes: (F, 5) float64: x, y (metres), heading (radians), length and width (metres).
        grid: The cells; every box lies inside the grid.
        cell_start: (cells + 1,) int64: cell k lists the items from ``cell_start[k]`` to before
            ``cell_start[k + 1]``.
        cell_items: (M,) int64 numbers of boxes.
    """

    boxes: NDArray[np.float64]
    grid: SolidGrid
    cell_start: NDArray[np.int64]
    cell_items: NDArray[np.int64]


def index_solids(boxes: ArrayLike, cell_m: float = 8.0) -> Solids:
    """Sort boxes into the cells of a grid that just covers them.

    A box is listed in every cell that the bounding square of its circumscribed circle touches, so
    that whatever overlaps the box meets it in one of its own cells.

    Args:
        boxes: (F, 5) x, y, heading, length and width; F may be 0.
        cell_m: Side of a cell in metres.

    Returns:
        The indexed boxes.

    Raises:
        ValueError: The boxes are not of that shape or not finite, or cells have no size.
    """
    table = np.array(boxes, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != SOLID_COLUMNS or not np.isfinite(table).all():
        raise ValueError(f"solids must be finite and of shape (F, 5), got shape {table.shape}")
    if not cell_m > 0.0:
        raise ValueError(f"solids need cells larger than 0 m, got {cell_m!r}")
    if len(table) == 0:
        grid = SolidGrid(0.0, 0.0, float(cell_m), 1, 1)
        return Solids(table, grid, np.zeros(2, np.int64), np.zeros(0, np.int64))
    radius = np.hypot(table[:, SOLID_LENGTH], table[:, SOLID_WIDTH])[:, None] / 2.0
    origin = (table[:, :2] - radius).min(axis=0)
    # as in the kernel, so that both round alike
    first = np.floor((table[:, :2] - radius - origin) / cell_m).astype(np.int64)
    last = np.floor((table[:, :2] + radius - origin) / cell_m).astype(np.int64)
    columns, rows = (int(count) for count in last.max(axis=0) + 1)
    cells, items = [], []
    for item, ((left, top), (right, bottom)) in enumerate(zip(first, last, strict=True)):
        row, column = np.mgrid[top : bottom + 1, left : right + 1]
        cells.append((row * columns + column).ravel())
        items.append(np.full(row.size, item))
    cell = np.concatenate(cells)
    order = np.argsort(cell, kind="stable")
    counts = np.bincount(cell, minlength=rows * columns)
    return Solids(
        boxes=table,
        grid=SolidGrid(float(origin[0]), float(origin[1]), float(cell_m), columns, rows),
        cell_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        cell_items=np.concatenate(items)[order].astype(np.int64),
    )
