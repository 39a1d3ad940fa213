"""Where bodies that move along two rails would touch: their boxes, swept and compared."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import kernel
from .overlap import boxes_overlap
from .rails import Rails, rail_pose


@kernel
def swept_boxes(rails: Rails, rail: int, start_m: float, end_m: float, step_m: float) -> NDArray:
    """Poses along a rail from one station to another, both included.

    Args:
        rails: The rails; ``conflicts`` and ``crossings`` are not looked at.
        rail: Which one.
        start_m: Station of the first pose; may lie before the rail, which goes on straight.
        end_m: Station of the last pose; may lie beyond the rail.
        step_m: Greatest distance between poses.

    Returns:
        (S, 5) station, x, y, and cosine and sine of the heading.
    """
    count = math.ceil((end_m - start_m) / step_m) + 1
    poses = np.empty((count, 5))
    for i in range(count):
        station = start_m + (end_m - start_m) * i / (count - 1)
        x, y, heading = rail_pose(rails, rail, station)
        poses[i, 0], poses[i, 1], poses[i, 2] = station, x, y
        poses[i, 3], poses[i, 4] = math.cos(heading), math.sin(heading)
    return poses


@kernel
def last_contacts(
    rails: Rails,
    pairs: NDArray,
    before_m: float,
    beyond_m: float,
    half_length_m: float,
    half_width_m: float,
    step_m: float,
) -> NDArray:
    """For pairs of rails, where on the other a body last touches the way of a body on the one.

    Bodies are boxes centred on a rail and heading along it. The places compared are the same for
    both orders of a pair, so bodies touch in both or in neither.

    Args:
        rails: The rails; ``conflicts`` and ``crossings`` are not looked at.
        pairs: (K, 2) int64, one rail and another.
        before_m: How far before the start of both rails centres are looked at.
        beyond_m: How far beyond their ends.
        half_length_m: Half the length of a body.
        half_width_m: Half its width.
        step_m: Greatest distance between the places that are compared.

    Returns:
        (K,) greatest station on the other at which its box overlaps a box anywhere on the one;
        minus infinity where none does.
    """
    last = np.full(len(pairs), -np.inf)
    for k in range(len(pairs)):
        mine, other = pairs[k]
        way = swept_boxes(rails, mine, -before_m, rails.length[mine] + beyond_m, step_m)
        others = swept_boxes(rails, other, -before_m, rails.length[other] + beyond_m, step_m)
        for j in range(len(others) - 1, -1, -1):
            touches = False
            for i in range(len(way)):
                if boxes_overlap(
                    way[i, 1],
                    way[i, 2],
                    way[i, 3],
                    way[i, 4],
                    half_length_m,
                    half_width_m,
                    others[j, 1],
                    others[j, 2],
                    others[j, 3],
                    others[j, 4],
                    half_length_m,
                    half_width_m,
                ):
                    touches = True
                    break
            if touches:
                last[k] = others[j, 0]
                break
    return last
