"""Which footprints of other road users overlap: none ever should."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import HEADING, LENGTH, WIDTH, X, Y
from .overlap import boxes_overlap, circles_apart


@leaf_kernel
def count_contacts(actors: NDArray, others: NDArray, same: bool) -> int:
    """Number of overlapping pairs of one row of ``actors`` and one of ``others``.

    Args:
        actors: (A, 6) rows; those of length 0 are empty slots.
        others: (B, 6) likewise.
        same: Whether both are the same table, whose pairs are then counted once.
    """
    count = 0
    for i in range(actors.shape[0]):
        a_half, a_side = 0.5 * actors[i, LENGTH], 0.5 * actors[i, WIDTH]
        if a_half <= 0.0:
            continue
        a_cos, a_sin = math.cos(actors[i, HEADING]), math.sin(actors[i, HEADING])
        for j in range(i if same else others.shape[0]):
            b_half, b_side = 0.5 * others[j, LENGTH], 0.5 * others[j, WIDTH]
            dx, dy = others[j, X] - actors[i, X], others[j, Y] - actors[i, Y]
            if b_half <= 0.0 or circles_apart(dx, dy, a_half, a_side, b_half, b_side):
                continue
            count += boxes_overlap(
                actors[i, X], actors[i, Y], a_cos, a_sin, a_half, a_side, others[j, X],
                others[j, Y], math.cos(others[j, HEADING]), math.sin(others[j, HEADING]), b_half,
                b_side,
            )  # fmt: skip
    return count
