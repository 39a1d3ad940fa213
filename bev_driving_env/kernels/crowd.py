"""Pedestrians' room to move: who is near whom, and where somebody would touch others or a car."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import HEADING, LENGTH, WIDTH, X, Y
from .snap import write_row

LARGEST_M = 0.6
"""Side of the largest footprint."""
RADIUS_SHARE = 0.75
"""A footprint is kept apart as a circle of this share of its side, whichever way it points."""
VEHICLE_GAP_M = 0.3
FASTEST_MPS = 2.0
STANDS_M = 0.01
"""Who moves less in a step keeps his heading."""

COLUMN_PRIME, ROW_PRIME = 73856093, 19349663
BUCKETS = 2048
NEAR = 64
"""At most so many are looked at around one."""


class Crowd(NamedTuple):
    """Who is near whom among P pedestrians: room to work in, made once and used for every step.

    Attributes:
        heads: (BUCKETS,) int32, the last pedestrian of each chain of those whose cells share a
            hash, -1 for none.
        following: (P,) int32, the one before in the chain.
        near: (NEAR,) int32, whom ``find_near`` has found.
        crowded: (P,) bool, who had others around when the chains were made.
    """

    heads: NDArray
    following: NDArray
    near: NDArray
    crowded: NDArray


def empty_crowd(people: int) -> Crowd:
    """Room for a number of pedestrians."""
    return Crowd(
        heads=np.empty(BUCKETS, np.int32),
        following=np.empty(people, np.int32),
        near=np.empty(NEAR, np.int32),
        crowded=np.empty(people, np.bool_),
    )


@leaf_kernel
def contact_reach(dt_s: float) -> float:
    """Distance within which two may touch before a step is over, metres."""
    return 2.0 * (RADIUS_SHARE * LARGEST_M + FASTEST_MPS * dt_s)


@leaf_kernel
def hash_cells(pedestrians: NDArray, reach_m: float, crowd: Crowd) -> None:
    """Chain pedestrians by the hash of the cell they are in, and mark who has others around.

    Cells are twice the reach wide, so that whoever is within reach is in one of four.

    Args:
        pedestrians: (P, 6) rows; empty slots are left out.
        reach_m: Distance within which others count.
        crowd: Output.
    """
    heads, following, crowded = crowd.heads, crowd.following, crowd.crowded
    heads[:] = -1
    per_cell, reach2 = 0.5 / reach_m, reach_m * reach_m
    for i in range(pedestrians.shape[0]):
        crowded[i] = False
        if pedestrians[i, LENGTH] <= 0.0:
            continue
        x, y = pedestrians[i, X], pedestrians[i, Y]
        column, row = math.floor(x * per_cell - 0.5), math.floor(y * per_cell - 0.5)
        for cell in range(4):
            j = heads[_bucket(column + (cell & 1), row + (cell >> 1))]
            while j >= 0:
                dx, dy = pedestrians[j, X] - x, pedestrians[j, Y] - y
                if dx * dx + dy * dy < reach2:
                    crowded[i] = crowded[j] = True
                j = following[j]
        bucket = _bucket(math.floor(x * per_cell), math.floor(y * per_cell))
        following[i] = heads[bucket]
        heads[bucket] = i


@leaf_kernel
def _bucket(column: int, row: int) -> int:
    return (column * COLUMN_PRIME ^ row * ROW_PRIME) & (BUCKETS - 1)


@leaf_kernel
def find_near(pedestrians: NDArray, i: int, reach_m: float, crowd: Crowd) -> int:
    """Write those within reach of a pedestrian into ``crowd.near``; returns how many.

    The chains hold where everybody was when the step began; meanwhile some have moved, which the
    reach has to allow for.
    """
    heads, following, near = crowd.heads, crowd.following, crowd.near
    x, y, per_cell, count = pedestrians[i, X], pedestrians[i, Y], 0.5 / reach_m, 0
    column, row = math.floor(x * per_cell - 0.5), math.floor(y * per_cell - 0.5)
    for cell in range(4):
        j = heads[_bucket(column + (cell & 1), row + (cell >> 1))]
        while j >= 0:
            dx, dy = pedestrians[j, X] - x, pedestrians[j, Y] - y
            if j != i and dx * dx + dy * dy < reach_m * reach_m and count < NEAR:
                near[count] = j
                count += 1
            j = following[j]
    return count


@leaf_kernel
def find_contacts(pedestrians: NDArray, crowd: Crowd, touching: NDArray) -> int:
    """Mark who touches somebody before him in the table; returns how many do.

    Args:
        pedestrians: (P, 6) rows; a row of length 0 is an empty slot.
        crowd: Room to work in.
        touching: (P,) bool, overwritten.
    """
    reach_m = contact_reach(0.0)
    hash_cells(pedestrians, reach_m, crowd)
    total = 0
    for i in range(pedestrians.shape[0]):
        touching[i] = False
        if not crowd.crowded[i]:
            continue
        for k in range(find_near(pedestrians, i, reach_m, crowd)):
            j = crowd.near[k]
            apart = RADIUS_SHARE * (pedestrians[i, LENGTH] + pedestrians[j, LENGTH])
            dx = pedestrians[j, X] - pedestrians[i, X]
            dy = pedestrians[j, Y] - pedestrians[i, Y]
            touching[i] |= j < i and dx * dx + dy * dy < apart * apart
        total += touching[i]
    return total


@leaf_kernel
def may_go(pedestrians: NDArray, i: int, x: float, y: float, near: NDArray, count: int) -> bool:
    """Whether a pedestrian who goes to (x, y) comes no closer to anyone he would touch there."""
    size, old_x, old_y = pedestrians[i, LENGTH], pedestrians[i, X], pedestrians[i, Y]
    for k in range(count):
        j = near[k]
        apart = RADIUS_SHARE * (size + pedestrians[j, LENGTH])
        dx, dy = pedestrians[j, X] - x, pedestrians[j, Y] - y
        distance2 = dx * dx + dy * dy
        dx, dy = pedestrians[j, X] - old_x, pedestrians[j, Y] - old_y
        if distance2 < apart * apart and distance2 < dx * dx + dy * dy:
            return False
    return True


@leaf_kernel
def _box_distance(
    dx: float, dy: float, cos: float, sin: float, half_length: float, half_width: float
) -> float:
    """Distance from a box, negative inside, of a point (dx, dy) from its centre."""
    ahead = abs(dx * cos + dy * sin) - half_length
    aside = abs(dy * cos - dx * sin) - half_width
    outside_x, outside_y = max(ahead, 0.0), max(aside, 0.0)
    outside = math.sqrt(outside_x * outside_x + outside_y * outside_y)
    return outside + min(max(ahead, aside), 0.0)


@leaf_kernel
def touches_vehicle(
    pedestrians: NDArray,
    i: int,
    x: float,
    y: float,
    ego: NDArray,
    ego_half_length: float,
    ego_half_width: float,
    vehicles: NDArray,
) -> bool:
    """Whether a pedestrian who goes to (x, y) comes closer to a vehicle he would touch there."""
    keep_m = RADIUS_SHARE * pedestrians[i, LENGTH] + VEHICLE_GAP_M
    old_x, old_y = pedestrians[i, X], pedestrians[i, Y]
    for v in range(-1, vehicles.shape[0]):
        if v < 0:
            bx, by, heading = ego[X], ego[Y], ego[HEADING]
            half_length, half_width = ego_half_length, ego_half_width
        else:
            bx, by, heading = vehicles[v, X], vehicles[v, Y], vehicles[v, HEADING]
            half_length, half_width = vehicles[v, LENGTH] / 2.0, vehicles[v, WIDTH] / 2.0
        reach = keep_m + half_length + half_width
        dx, dy = x - bx, y - by
        if half_length <= 0.0 or dx * dx + dy * dy > reach * reach:
            continue
        cos, sin = math.cos(heading), math.sin(heading)
        distance = _box_distance(dx, dy, cos, sin, half_length, half_width)
        if distance < keep_m and distance < _box_distance(
            old_x - bx, old_y - by, cos, sin, half_length, half_width
        ):
            return True
    return False


@leaf_kernel
def attempt_shares(attempt: int) -> tuple[float, float]:
    """Shares of a step ahead and aside to try in turn: both, ahead, half as far ahead, aside."""
    ahead = 1.0 if attempt < 2 else 0.5 if attempt == 2 else 0.0
    return ahead, 0.0 if attempt == 1 else 1.0


@leaf_kernel
def move(pedestrians: NDArray, i: int, x: float, y: float, dt_s: float) -> None:
    """Put a pedestrian at (x, y), with the speed and heading of his way there."""
    dx, dy = x - pedestrians[i, X], y - pedestrians[i, Y]
    moved = math.sqrt(dx * dx + dy * dy)
    heading = _direction(dx, dy) if moved > STANDS_M else pedestrians[i, HEADING]
    write_row(pedestrians[i], x, y, heading, moved / dt_s)


@leaf_kernel
def _direction(dx: float, dy: float) -> float:
    """Heading of a vector to 0.001 rad; ``math.atan2`` takes longer than a whole step."""
    x, y = abs(dx), abs(dy)
    slope = min(x, y) / max(x, y)
    square = slope * slope
    angle = slope + slope * square * ((-0.0464964749 * square + 0.15931422) * square - 0.327622764)
    if y > x:
        angle = math.pi / 2.0 - angle
    if dx < 0.0:
        angle = math.pi - angle
    return -angle if dy < 0.0 else angle
