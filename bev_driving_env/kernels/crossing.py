"""Pedestrians at crossings: going to the kerb, waiting there, and crossing the road."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .crowd import (
    LARGEST_M,
    Crowd,
    attempt_shares,
    contact_reach,
    find_near,
    may_go,
    move,
    touches_vehicle,
)
from .jit import leaf_kernel
from .layout import LENGTH, SIGNAL_OFF, SIGNAL_RED, SPEED, X, Y
from .walks import (
    ALONG_M,
    ASIDE_M,
    ASIDE_WANTED_M,
    BLOCKED_S,
    CROSSING,
    DIRECTION,
    DRIFT_MPS,
    HESITATE_AT_M,
    HESITATE_S,
    KERB_M,
    MODE,
    ON_CROSSING,
    PACE_MPS,
    WAITED_FOR_S,
    WAITING,
    WALK,
    WALK_STATION,
    WALKING,
    Crossings,
    Walks,
    draw,
    keep_right,
    nearest_on_walk,
    note_blocked,
    walk_gap,
    walk_point,
    wrap_station,
)

HESITATES = 0.15
KERB_GAP_M = 0.5
KEEP_RIGHT_M = 0.5
SIDESTEP_M = 0.9
SET_OUT_M = 1.2
PATIENCE_S = 40.0
TURN_BACK_S = 6
PAST_MIDDLE_M = 0.6


@leaf_kernel
def mark_occupied(crossings: Crossings, track: NDArray, motion: NDArray, occupied: NDArray) -> None:
    """Mark the halves of each crossing that vehicles must keep clear, and clear the others.

    A pedestrian on the road, or less than 0.5 m before it and about to step on to it, occupies the
    half he goes to, and the half where he started until he is 0.6 m past the middle.

    Args:
        crossings: The crossings.
        track: (P, 5) int64 pedestrian track.
        motion: (P, 11) pedestrian motion.
        occupied: (C, 2) uint8, overwritten: half 0 is the one at a crossing's first end.
    """
    occupied[:] = 0
    for i in range(track.shape[0]):
        if track[i, MODE] != ON_CROSSING:
            continue
        c, half = track[i, CROSSING], (1 + track[i, DIRECTION]) // 2
        length = crossings.length[c]
        done = _done(length, track, motion, i)
        if done <= -KERB_GAP_M - 1e-9 or done >= length:
            continue
        occupied[c, half] = 1
        if done <= length / 2.0 + PAST_MIDDLE_M:
            occupied[c, 1 - half] = 1


@leaf_kernel
def _done(length_m: float, track: NDArray, motion: NDArray, i: int) -> float:
    """Metres that a pedestrian on a crossing is past the kerb he started from."""
    return motion[i, ALONG_M] if track[i, DIRECTION] > 0 else length_m - motion[i, ALONG_M]


@leaf_kernel
def _may_cross(crossings: Crossings, c: int, signals: NDArray, threatened: NDArray) -> bool:
    """Whether nothing keeps a pedestrian from stepping on to the road."""
    if threatened[c]:
        return False
    k = crossings.signal[c]
    if k < 0 or k >= signals.shape[0]:
        return True
    return signals[k] == SIGNAL_OFF or signals[k] == SIGNAL_RED


@leaf_kernel
def _end_at(walks: Walks, crossings: Crossings, c: int, walk: int, station_m: float) -> int:
    """Which end of a crossing is at a station of a walk."""
    if crossings.walk[c, 0] != crossings.walk[c, 1]:
        return 0 if crossings.walk[c, 0] == walk else 1
    first = abs(walk_gap(walks, walk, station_m, crossings.station[c, 0]))
    return 0 if first < abs(walk_gap(walks, walk, station_m, crossings.station[c, 1])) else 1


@leaf_kernel
def wait_at_kerbs(
    walks: Walks,
    crossings: Crossings,
    dt_s: float,
    seed: int,
    signals: NDArray,
    threatened: NDArray,
    crowd: Crowd,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
) -> None:
    """One step of those who go to the kerb, or stand there until they may cross.

    The arguments are those of ``step_pedestrians``; the crowd's chains are up to date.
    """
    reach_m = contact_reach(dt_s)
    for i in range(pedestrians.shape[0]):
        if pedestrians[i, LENGTH] <= 0.0 or track[i, MODE] != WAITING:
            continue
        c = track[i, CROSSING]
        may_cross = _may_cross(crossings, c, signals, threatened)
        waited = motion[i, WAITED_FOR_S]
        motion[i, WAITED_FOR_S] = waited + dt_s
        tries = int(2.0 * (waited + dt_s)) > int(2.0 * waited)
        if pedestrians[i, SPEED] == 0.0 and not may_cross and not tries:
            continue  # arrived, or there is no room ahead: looks again twice a second
        pedestrians[i, SPEED] = 0.0
        walk, station = track[i, WALK], motion[i, WALK_STATION]
        end = _end_at(walks, crossings, c, walk, station)
        # to the right of the line as he will walk it is always ahead along the walk
        along = walk_gap(walks, walk, station, crossings.station[c, end] + KEEP_RIGHT_M)
        aside = KERB_GAP_M - motion[i, KERB_M]
        distance = math.sqrt(along * along + aside * aside)
        if may_cross and distance < SET_OUT_M:
            _set_out(crossings, c, end, seed, pedestrians, track, motion, i)
        elif waited + dt_s >= PATIENCE_S:
            track[i, MODE], motion[i, BLOCKED_S] = WALKING, 0.0
            keep_right(seed, track, motion, i)
        elif distance > 0.02:
            share = min(1.0, motion[i, PACE_MPS] * dt_s / distance)
            station = wrap_station(walks, walk, station + share * along)
            kerb_m = motion[i, KERB_M] + share * aside
            x, y = walk_point(walks, walk, station, kerb_m)
            count = find_near(pedestrians, i, reach_m, crowd)
            if may_go(pedestrians, i, x, y, crowd.near, count):
                motion[i, WALK_STATION], motion[i, KERB_M] = station, kerb_m
                move(pedestrians, i, x, y, dt_s)


@leaf_kernel
def _set_out(
    crossings: Crossings,
    c: int,
    end: int,
    seed: int,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
    i: int,
) -> None:
    """Begin to cross from an end, and draw whether, where and how long to hesitate."""
    length = crossings.length[c]
    dx, dy = pedestrians[i, X] - crossings.ends[c, 0], pedestrians[i, Y] - crossings.ends[c, 1]
    cos = (crossings.ends[c, 2] - crossings.ends[c, 0]) / length
    sin = (crossings.ends[c, 3] - crossings.ends[c, 1]) / length
    track[i, MODE], track[i, DIRECTION] = ON_CROSSING, 1 - 2 * end
    motion[i, ALONG_M] = dx * cos + dy * sin
    motion[i, ASIDE_M] = dy * cos - dx * sin
    motion[i, ASIDE_WANTED_M] = KEEP_RIGHT_M * track[i, DIRECTION]
    motion[i, BLOCKED_S], motion[i, HESITATE_S] = 0.0, 0.0
    if draw(seed, track, i) < HESITATES:
        if draw(seed, track, i) < 0.7:
            motion[i, HESITATE_AT_M] = 0.7 + 0.7 * draw(seed, track, i)
        else:
            motion[i, HESITATE_AT_M] = length / 2.0 + 0.6 * draw(seed, track, i) - 0.3
        motion[i, HESITATE_S] = 1.0 + 2.0 * draw(seed, track, i)


@leaf_kernel
def _arrive(
    walks: Walks,
    crossings: Crossings,
    c: int,
    end: int,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
    i: int,
) -> None:
    """From now on, count a pedestrian on the walk at an end of a crossing, where he is."""
    walk = crossings.walk[c, end]
    track[i, WALK], motion[i, BLOCKED_S] = walk, 0.0
    motion[i, WALK_STATION], motion[i, KERB_M] = nearest_on_walk(
        walks, walk, crossings.station[c, end], pedestrians[i, X], pedestrians[i, Y]
    )


@leaf_kernel
def cross_roads(
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
    """One step of those who cross a road.

    The arguments are those of ``step_pedestrians``; the crowd's chains are up to date.
    """
    ends = crossings.ends
    drift_m, reach_m = DRIFT_MPS * dt_s, contact_reach(dt_s)
    for i in range(pedestrians.shape[0]):
        if pedestrians[i, LENGTH] <= 0.0 or track[i, MODE] != ON_CROSSING:
            continue
        c, direction = track[i, CROSSING], track[i, DIRECTION]
        length = crossings.length[c]
        pedestrians[i, SPEED] = 0.0
        done = _done(length, track, motion, i)
        if done >= length + KERB_GAP_M:
            _arrive(walks, crossings, c, (1 + direction) // 2, pedestrians, track, motion, i)
            track[i, MODE] = WALKING
            track[i, DIRECTION] = 1 if draw(seed, track, i) < 0.5 else -1
            keep_right(seed, track, motion, i)
            continue
        if done <= 0.0 and not _may_cross(crossings, c, signals, threatened):
            _arrive(walks, crossings, c, (1 - direction) // 2, pedestrians, track, motion, i)
            track[i, MODE] = WAITING
            continue
        if motion[i, HESITATE_S] > 0.0 and done >= motion[i, HESITATE_AT_M]:
            motion[i, HESITATE_S] -= dt_s
            continue
        step = motion[i, PACE_MPS] * dt_s * direction
        aside = min(max(motion[i, ASIDE_WANTED_M] - motion[i, ASIDE_M], -drift_m), drift_m)
        ax, ay = ends[c, 0], ends[c, 1]
        cos, sin = (ends[c, 2] - ax) / length, (ends[c, 3] - ay) / length
        count = find_near(pedestrians, i, reach_m, crowd)
        blocked = True
        for attempt in range(4):
            ahead_share, aside_share = attempt_shares(attempt)
            along_m = motion[i, ALONG_M] + ahead_share * step
            aside_m = motion[i, ASIDE_M] + aside_share * aside
            x, y = ax + along_m * cos - aside_m * sin, ay + along_m * sin + aside_m * cos
            # vehicles keep to the road
            on_road = along_m > -LARGEST_M and along_m < length + LARGEST_M
            if may_go(pedestrians, i, x, y, crowd.near, count) and not (
                on_road
                and touches_vehicle(
                    pedestrians, i, x, y, ego, ego_half_length, ego_half_width, vehicles
                )
            ):
                motion[i, ALONG_M], motion[i, ASIDE_M] = along_m, aside_m
                move(pedestrians, i, x, y, dt_s)
                blocked = attempt == 3
                break
        seconds = note_blocked(motion, i, dt_s, blocked)
        if seconds >= TURN_BACK_S:
            track[i, DIRECTION] = -direction
            motion[i, BLOCKED_S], motion[i, ASIDE_WANTED_M] = 0.0, -KEEP_RIGHT_M * direction
        elif seconds > 0:
            motion[i, ASIDE_WANTED_M] = SIDESTEP_M * (2.0 * draw(seed, track, i) - 1.0)
