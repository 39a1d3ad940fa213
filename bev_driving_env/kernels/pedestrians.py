"""Pedestrians: one step of all of a world, and how they walk along the sidewalks."""

from __future__ import annotations

from numpy.typing import NDArray

from .crossing import cross_roads, wait_at_kerbs
from .crowd import Crowd, attempt_shares, contact_reach, find_near, hash_cells, may_go, move
from .jit import leaf_kernel
from .layout import LENGTH, X, Y
from .walks import (
    BEND,
    BLOCKED_S,
    CROSSING,
    DIRECTION,
    DRIFT_MPS,
    FREE_FROM_M,
    FREE_TO_M,
    KERB_M,
    MODE,
    PACE_MPS,
    PLACE,
    WAITED_FOR_S,
    WAITING,
    WALK,
    WALK_STATION,
    WALKING,
    Crossings,
    Walks,
    beside,
    draw,
    keep_right,
    note_blocked,
    walk_row,
    wrap_station,
)

OUTSIDE_M = 0.15
"""So far outside the free band a walker still goes ahead while he drifts into it."""
CROSS_AT_MOUTH, CROSS_MIDBLOCK = 0.3, 0.04
TURN_AROUND_S = 4


@leaf_kernel
def step_pedestrians(
    walks: Walks,
    crossings: Crossings,
    dt_s: float,
    seed: int,
    signals: NDArray,
    threatened: NDArray,
    ego: NDArray,
    ego_half_length: float,
    ego_half_width: float,
    vehicles: NDArray,
    crowd: Crowd,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
) -> None:
    """Move all pedestrians of one world by one step, one after the other.

    Nobody's move makes his footprint touch another's, nor, on the road, a vehicle's box or the
    0.3 m around it. Who is touched already may move away.

    Args:
        walks: The town's walks.
        crossings: Its crossings.
        dt_s: Length of the step.
        seed: The episode's seed.
        signals: (S,) uint8 states; crossings whose signal is missing here count as without.
        threatened: (C,) uint8, whether a vehicle may come too fast for somebody to step on to it.
        ego: (4,) state row.
        ego_half_length: Half the ego's length in metres.
        ego_half_width: Half its width.
        vehicles: (V, 6) rows; a row of length 0 is an empty slot.
        crowd: Room to work in, made by ``empty_crowd`` for P pedestrians.
        pedestrians: (P, 6) rows, changed in place; a row of length 0 is an empty slot.
        track: (P, 5) int64, changed in place.
        motion: (P, 11), changed in place.
    """
    hash_cells(pedestrians, contact_reach(dt_s), crowd)
    # in this order, so that nobody who goes over to another mode moves twice
    cross_roads(
        walks, crossings, dt_s, seed, signals, threatened, ego, ego_half_length, ego_half_width,
        vehicles, crowd, pedestrians, track, motion,
    )  # fmt: skip
    wait_at_kerbs(
        walks, crossings, dt_s, seed, signals, threatened, crowd, pedestrians, track, motion
    )
    _walk(walks, crossings, dt_s, seed, crowd, pedestrians, track, motion)


@leaf_kernel
def _walk(
    walks: Walks,
    crossings: Crossings,
    dt_s: float,
    seed: int,
    crowd: Crowd,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
) -> None:
    """One step of those who walk along the sidewalk."""
    samples, half_width_m = walks.samples, walks.half_width_m
    drift_m, reach_m = DRIFT_MPS * dt_s, contact_reach(dt_s)
    for i in range(pedestrians.shape[0]):
        if pedestrians[i, LENGTH] <= 0.0 or track[i, MODE] != WALKING:
            continue
        count = find_near(pedestrians, i, reach_m, crowd) if crowd.crowded[i] else 0
        walk, old_station, old_kerb_m = track[i, WALK], motion[i, WALK_STATION], motion[i, KERB_M]
        old_row, _ = walk_row(walks, walk, old_station)
        # in a bend the way beside the middle is longer or shorter
        stretch = 1.0 - samples[old_row, BEND] * (old_kerb_m - half_width_m)
        ahead_m = motion[i, PACE_MPS] * dt_s * track[i, DIRECTION] / max(stretch, 0.7)
        station = wrap_station(walks, walk, old_station + ahead_m)
        row, part = walk_row(walks, walk, station)
        low, high = samples[row, FREE_FROM_M], samples[row, FREE_TO_M]
        wanted_m = low + motion[i, PLACE] * (high - low) - old_kerb_m
        aside_m = min(max(wanted_m, -drift_m), drift_m)
        inside = max(low - old_kerb_m, old_kerb_m - high) <= OUTSIDE_M

        goes, ahead = False, False
        for attempt in range(0 if inside else 3, 4):
            ahead_share, aside_share = attempt_shares(attempt)
            if attempt >= 2:
                station = wrap_station(walks, walk, old_station + ahead_share * ahead_m)
                row, part = walk_row(walks, walk, station)
            kerb_m = old_kerb_m + aside_share * aside_m
            x, y = beside(samples, row, part, kerb_m - half_width_m)
            if may_go(pedestrians, i, x, y, crowd.near, count):
                motion[i, WALK_STATION], motion[i, KERB_M] = station, kerb_m
                move(pedestrians, i, x, y, dt_s)
                goes, ahead = True, attempt < 3
                break
        if not goes:
            row = old_row
            move(pedestrians, i, pedestrians[i, X], pedestrians[i, Y], dt_s)

        # whoever steps aside around an obstacle is not blocked by anyone
        blocked = not goes or (inside and not ahead)
        if blocked or motion[i, BLOCKED_S] > 0.0:
            seconds = note_blocked(motion, i, dt_s, blocked)
            if seconds >= TURN_AROUND_S:
                track[i, DIRECTION] = -track[i, DIRECTION]
                motion[i, BLOCKED_S] = 0.0
                keep_right(seed, track, motion, i)
            elif seconds > 0:
                motion[i, PLACE] = draw(seed, track, i)
        # in this order, because few samples have a crossing
        if crossings.stop_at[row] >= 0 and row != old_row:
            _consider_crossing(crossings, crossings.stop_at[row] // 2, seed, track, motion, i)


@leaf_kernel
def _consider_crossing(
    crossings: Crossings, c: int, seed: int, track: NDArray, motion: NDArray, i: int
) -> None:
    """Choose at a crossing whether to go over; not twice in a row at the same one."""
    if c == track[i, CROSSING]:
        return
    likely = CROSS_AT_MOUTH if crossings.mouth[c] else CROSS_MIDBLOCK
    if draw(seed, track, i) < likely:
        track[i, MODE], track[i, CROSSING] = WAITING, c
        motion[i, WAITED_FOR_S], motion[i, BLOCKED_S] = 0.0, 0.0
    else:
        keep_right(seed, track, motion, i)
