"""Placing pedestrians on a town's sidewalks at the start of an episode."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..kernels.crowd import empty_crowd, find_contacts
from ..kernels.layout import ACTOR_COLUMNS, HEADING, LENGTH, WIDTH, X, Y
from ..kernels.snap import snap_rows
from ..kernels.walks import (
    CROSSING,
    DIRECTION,
    FREE_FROM_M,
    FREE_TO_M,
    KERB_M,
    PACE_MPS,
    PED_MOTION_COLUMNS,
    PED_TRACK_COLUMNS,
    PLACE,
    WALK,
    WALK_COS,
    WALK_SIN,
    WALK_STATION,
    WALK_X,
    WALK_Y,
    Walks,
)
from ..towns.sidewalks import Sidewalks

ROOM_M = 3.0
"""Metres of walk for each pedestrian in a town that is full."""
APART_M = 1.0
CHILD_M, ADULT_M = 0.35, (0.45, 0.6)
CHILD_MPS, ADULT_MPS, OLD_MPS = (0.9, 1.8), (1.1, 1.6), (0.7, 1.0)
OLD_SHARE = 0.15
ATTEMPTS = 100

Placed = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]


def capacity(sidewalks: Sidewalks) -> int:
    """How many pedestrians there is room for: one for every 3 m of walk."""
    return int(_slots(sidewalks.walks).sum())


def place_pedestrians(
    sidewalks: Sidewalks, count: int, rng: np.random.Generator, *, child_share: float = 0.2
) -> Placed:
    """Put pedestrians at random places on the walks, nobody touching another.

    Args:
        sidewalks: Where they walk.
        count: How many.
        rng: Source of randomness; nothing else decides.
        child_share: Share of children among them.

    Returns:
        Rows (P, 6), track (P, 5) and motion (P, 11), see ``kernels.walks``.

    Raises:
        ValueError: There is no room for so many, or one of the numbers makes no sense.
    """
    most = capacity(sidewalks)
    if not 0 <= count <= most:
        raise ValueError(
            f"{count} pedestrians were asked for, but the sidewalks have room for 0 to {most}; "
            "ask for fewer or choose a town with more sidewalk"
        )
    if not 0.0 <= child_share <= 1.0:
        raise ValueError(f"child_share must be from 0 to 1, got {child_share!r}")
    rows = np.zeros((count, ACTOR_COLUMNS))
    track = np.zeros((count, PED_TRACK_COLUMNS), np.int64)
    motion = np.zeros((count, PED_MOTION_COLUMNS))
    if count == 0:
        return rows, track, motion
    child, old = rng.random(count) < child_share, rng.random(count) < OLD_SHARE
    size_m = np.where(child, CHILD_M, rng.uniform(*ADULT_M, count))
    rows[:, LENGTH] = rows[:, WIDTH] = size_m
    slow, fast = np.where(child[:, None], CHILD_MPS, np.where(old[:, None], OLD_MPS, ADULT_MPS)).T
    motion[:, PACE_MPS] = slow + rng.random(count) * (fast - slow)
    track[:, DIRECTION] = rng.choice(np.array([-1, 1]), count)
    track[:, CROSSING] = -1
    aside = 0.45 * rng.random(count)
    motion[:, PLACE] = np.where(track[:, DIRECTION] > 0, 1.0 - aside, aside)
    _place(sidewalks.walks, rng, rows, track, motion)
    snap_rows(rows)
    return rows, track, motion


def _slots(walks: Walks) -> NDArray[np.int64]:
    """How many pedestrians each walk has room for."""
    return np.floor(walks.length / ROOM_M).astype(np.int64)


def _place(
    walks: Walks,
    rng: np.random.Generator,
    rows: NDArray[np.float64],
    track: NDArray[np.int64],
    motion: NDArray[np.float64],
) -> None:
    """Choose a stretch of walk for everybody, and a place there that nobody touches."""
    slots = _slots(walks)
    chosen = rng.choice(int(slots.sum()), len(rows), replace=False)
    ends = np.cumsum(slots)
    walk = np.searchsorted(ends, chosen, side="right")
    stretch_m = walks.length[walk] / slots[walk]
    begin_m = (chosen - (ends - slots)[walk]) * stretch_m
    track[:, WALK] = walk
    again, crowd = np.ones(len(rows), np.bool_), empty_crowd(len(rows))
    for _ in range(ATTEMPTS):
        jitter = rng.random(len(rows))
        station = begin_m + APART_M / 2.0 + jitter * (stretch_m - APART_M)
        motion[again, WALK_STATION] = station[again]
        _stand(walks, rows, track, motion)
        if find_contacts(rows, crowd, again) == 0:
            return
    raise ValueError(
        f"no room was found for {len(rows)} pedestrians, {int(again.sum())} of them would touch "
        "others; ask for fewer"
    )


def _stand(
    walks: Walks,
    rows: NDArray[np.float64],
    track: NDArray[np.int64],
    motion: NDArray[np.float64],
) -> None:
    """Fill in distances from the kerb and world poses, as ``kernels.walks.walk_point`` has them."""
    walk = track[:, WALK]
    where = motion[:, WALK_STATION] / walks.step_m[walk]
    step = np.minimum(where.astype(np.int64), np.diff(walks.first)[walk] - 2)
    part = where - step
    here = walks.samples[walks.first[walk] + step]
    ahead = walks.samples[walks.first[walk] + step + 1]
    low, high = here[:, FREE_FROM_M], here[:, FREE_TO_M]
    motion[:, KERB_M] = low + motion[:, PLACE] * (high - low)
    right = motion[:, KERB_M] - walks.half_width_m
    x, next_x = (side[:, WALK_X] - right * side[:, WALK_SIN] for side in (here, ahead))
    y, next_y = (side[:, WALK_Y] + right * side[:, WALK_COS] for side in (here, ahead))
    rows[:, X], rows[:, Y] = x + part * (next_x - x), y + part * (next_y - y)
    heading = np.arctan2(here[:, WALK_SIN], here[:, WALK_COS])
    heading += np.where(track[:, DIRECTION] > 0, 0.0, math.pi)
    rows[:, HEADING] = np.remainder(heading + math.pi, 2.0 * math.pi) - math.pi
