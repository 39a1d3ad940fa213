"""Pedestrians: walking along the sidewalks, waiting at the kerb, crossing the road."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import kernel
from .layout import HEADING, LENGTH, SIGNAL_OFF, SIGNAL_RED, SPEED, WIDTH, X, Y
from .noise import mix, uniform
from .walks import (
    ALONG_M,
    ASIDE_M,
    ASIDE_WANTED_M,
    BEND,
    BLOCKED_S,
    COUNTER,
    CROSSING,
    DIRECTION,
    FREE_FROM_M,
    FREE_TO_M,
    HESITATE_AT_M,
    HESITATE_S,
    KERB_M,
    MODE,
    ON_CROSSING,
    PACE_MPS,
    PLACE,
    WAITED_FOR_S,
    WAITING,
    WALK,
    WALK_COS,
    WALK_SIN,
    WALK_STATION,
    WALK_X,
    WALK_Y,
    WALKING,
    Crossings,
    Walks,
    nearest_on_walk,
    walk_gap,
    walk_point,
    wrap_station,
)

LARGEST_M = 0.6
"""Side of the largest footprint."""
RADIUS_SHARE = 0.75
"""A footprint is kept apart as a circle of this share of its side, whichever way it points."""
VEHICLE_GAP_M = 0.3
DRIFT_MPS = 0.4
OUTSIDE_M = 0.15
"""So far outside the free band a walker still goes ahead while he drifts into it."""
CROSS_AT_MOUTH, CROSS_MIDBLOCK, HESITATES = 0.3, 0.04, 0.15
KERB_GAP_M = 0.5
KEEP_RIGHT_M = 0.5
SIDESTEP_M = 0.9
SET_OUT_M = 1.2
PATIENCE_S = 40.0
TURN_AROUND_S = 4
TURN_BACK_S = 6
BLOCKED_DECAY = 0.25
PAST_MIDDLE_M = 0.6
STANDS_M = 0.01
FASTEST_MPS = 2.0
NEAR = 64

COLUMN_PRIME, ROW_PRIME = 73856093, 19349663
BUCKETS = 1024


@kernel
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
        c = track[i, CROSSING]
        length = crossings.length[c]
        forward = track[i, DIRECTION] > 0
        done = motion[i, ALONG_M] if forward else length - motion[i, ALONG_M]
        if done <= -KERB_GAP_M - 1e-9 or done >= length:
            continue
        occupied[c, 1 if forward else 0] = 1
        if done <= length / 2.0 + PAST_MIDDLE_M:
            occupied[c, 0 if forward else 1] = 1


@kernel
def hash_cells(
    pedestrians: NDArray, reach_m: float, heads: NDArray, following: NDArray, crowded: NDArray
) -> None:
    """Chain pedestrians by the hash of the cell they are in, and mark who has others around.

    Cells are twice the reach wide, so that whoever is within reach is in one of four.

    Args:
        pedestrians: (P, 6) rows; empty slots are left out.
        reach_m: Distance within which others count.
        heads: (BUCKETS,) int32, overwritten: the last pedestrian of each chain, -1 for none.
        following: (P,) int32, overwritten: the one before in the chain.
        crowded: (P,) bool, overwritten.
    """
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


@kernel
def _bucket(column: int, row: int) -> int:
    return (column * COLUMN_PRIME ^ row * ROW_PRIME) & (BUCKETS - 1)


@kernel
def _reach(dt_s: float) -> float:
    """Distance within which two may touch before the step is over."""
    return 2.0 * (RADIUS_SHARE * LARGEST_M + FASTEST_MPS * dt_s)


@kernel
def find_contacts(pedestrians: NDArray, touching: NDArray) -> int:
    """Mark the pedestrians (P, 6) that touch one before them in (P,) bool; returns how many."""
    size = pedestrians.shape[0]
    heads, following = np.empty(BUCKETS, np.int32), np.empty(size, np.int32)
    near = np.empty(NEAR, np.int32)
    hash_cells(pedestrians, _reach(0.0), heads, following, touching)
    total = 0
    for i in range(size):
        if touching[i]:
            touching[i] = False
            for k in range(_find_near(pedestrians, i, _reach(0.0), heads, following, near)):
                j = near[k]
                apart = RADIUS_SHARE * (pedestrians[i, LENGTH] + pedestrians[j, LENGTH])
                dx = pedestrians[j, X] - pedestrians[i, X]
                dy = pedestrians[j, Y] - pedestrians[i, Y]
                touching[i] |= j < i and dx * dx + dy * dy < apart * apart
        total += touching[i]
    return total


@kernel
def _find_near(
    pedestrians: NDArray,
    i: int,
    reach_m: float,
    heads: NDArray,
    following: NDArray,
    near: NDArray,
) -> int:
    """Write those within reach of a pedestrian into ``near``; returns how many.

    The chains hold where everybody was when the step began; meanwhile some have moved, which the
    reach has to allow for.
    """
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


@kernel
def _may_go(pedestrians: NDArray, i: int, x: float, y: float, near: NDArray, count: int) -> bool:
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


@kernel
def _box_distance(
    dx: float, dy: float, cos: float, sin: float, half_length: float, half_width: float
) -> float:
    """Distance from a box, negative inside, of a point (dx, dy) from its centre."""
    ahead = abs(dx * cos + dy * sin) - half_length
    aside = abs(dy * cos - dx * sin) - half_width
    outside_x, outside_y = max(ahead, 0.0), max(aside, 0.0)
    outside = math.sqrt(outside_x * outside_x + outside_y * outside_y)
    return outside + min(max(ahead, aside), 0.0)


@kernel
def _touches_vehicle(
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


@kernel
def _draw(seed: int, track: NDArray, i: int) -> float:
    """The pedestrian's next random number in [0, 1)."""
    track[i, COUNTER] += 1
    return uniform(mix(seed, i), track[i, COUNTER])


@kernel
def _keep_right(seed: int, track: NDArray, motion: NDArray, i: int) -> None:
    """Choose a place on the right-hand side of the free band."""
    place = 0.45 * _draw(seed, track, i)
    motion[i, PLACE] = 1.0 - place if track[i, DIRECTION] > 0 else place


@kernel
def _may_cross(crossings: Crossings, c: int, signals: NDArray, threatened: NDArray) -> bool:
    """Whether nothing keeps a pedestrian from stepping on to the road."""
    if threatened[c]:
        return False
    k = crossings.signal[c]
    if k < 0 or k >= signals.shape[0]:
        return True
    return signals[k] == SIGNAL_OFF or signals[k] == SIGNAL_RED


@kernel
def _end_at(walks: Walks, crossings: Crossings, c: int, walk: int, station_m: float) -> int:
    """Which end of a crossing is at a station of a walk."""
    if crossings.walk[c, 0] != crossings.walk[c, 1]:
        return 0 if crossings.walk[c, 0] == walk else 1
    first = abs(walk_gap(walks, walk, station_m, crossings.station[c, 0]))
    return 0 if first < abs(walk_gap(walks, walk, station_m, crossings.station[c, 1])) else 1


@kernel
def _note_blocked(motion: NDArray, i: int, dt_s: float, blocked: bool) -> int:
    """Keep the time something has been in the way; returns each whole second once, else 0."""
    before = motion[i, BLOCKED_S]
    if not blocked:
        motion[i, BLOCKED_S] = max(0.0, before - BLOCKED_DECAY * dt_s)
        return 0
    motion[i, BLOCKED_S] = before + dt_s
    return int(before + dt_s) if int(before + dt_s) > int(before) else 0


@kernel
def _heading(dx: float, dy: float) -> float:
    """Direction of a vector to 0.001 rad; ``math.atan2`` takes longer than a whole step."""
    x, y = abs(dx), abs(dy)
    slope = min(x, y) / max(x, y)
    square = slope * slope
    angle = slope + slope * square * ((-0.0464964749 * square + 0.15931422) * square - 0.327622764)
    if y > x:
        angle = math.pi / 2.0 - angle
    if dx < 0.0:
        angle = math.pi - angle
    return -angle if dy < 0.0 else angle


@kernel
def _move(pedestrians: NDArray, i: int, x: float, y: float, dt_s: float) -> None:
    """Put a pedestrian at (x, y), with the speed and heading of his way there."""
    dx, dy = x - pedestrians[i, X], y - pedestrians[i, Y]
    moved = math.sqrt(dx * dx + dy * dy)
    pedestrians[i, SPEED] = moved / dt_s
    pedestrians[i, X], pedestrians[i, Y] = x, y
    if moved > STANDS_M:
        pedestrians[i, HEADING] = _heading(dx, dy)


@kernel
def _walk(
    walks: Walks,
    crossings: Crossings,
    dt_s: float,
    seed: int,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
    heads: NDArray,
    following: NDArray,
    crowded: NDArray,
    near: NDArray,
) -> None:
    """One step of those who walk along the sidewalk.

    They are nearly all, and handing arrays to a function takes longer than what it would do for
    one of them: hence ``walk_point``, ``_find_near``, ``_may_go`` and ``_move`` are
    spelled out here.
    """
    samples, first, step_m, length_m = walks.samples, walks.first, walks.step_m, walks.length
    half_width_m, stop_at = walks.half_width_m, crossings.stop_at
    drift_m, reach_m = DRIFT_MPS * dt_s, _reach(dt_s)
    per_cell = 0.5 / reach_m
    for i in range(pedestrians.shape[0]):
        size = pedestrians[i, LENGTH]
        if size <= 0.0 or track[i, MODE] != WALKING:
            continue
        old_x, old_y = pedestrians[i, X], pedestrians[i, Y]
        count = 0
        if crowded[i]:
            column = math.floor(old_x * per_cell - 0.5)
            row = math.floor(old_y * per_cell - 0.5)
            for cell in range(4):
                j = heads[_bucket(column + (cell & 1), row + (cell >> 1))]
                while j >= 0:
                    dx, dy = pedestrians[j, X] - old_x, pedestrians[j, Y] - old_y
                    if j != i and dx * dx + dy * dy < reach_m * reach_m and count < NEAR:
                        near[count] = j
                        count += 1
                    j = following[j]

        walk = track[i, WALK]
        length, step, begin = length_m[walk], step_m[walk], first[walk]
        last = first[walk + 1] - begin - 2
        old_station, old_kerb_m = motion[i, WALK_STATION], motion[i, KERB_M]
        old_sample = begin + min(int(old_station / step), last)
        # in a bend the way beside the middle is longer or shorter
        stretch = 1.0 - samples[old_sample, BEND] * (old_kerb_m - half_width_m)
        ahead_m = motion[i, PACE_MPS] * dt_s * track[i, DIRECTION] / max(stretch, 0.7)
        sample, station, kerb_m, x, y = old_sample, old_station, old_kerb_m, old_x, old_y
        goes, inside = False, True
        # ahead and aside, ahead, half as far ahead, aside
        for attempt in range(4):
            if attempt < 3 and not inside:
                continue
            share = 1.0 if attempt < 2 else 0.5 if attempt == 2 else 0.0
            station = old_station + share * ahead_m
            if station < 0.0:
                station += length
            if station >= length:
                station -= length
            where = station / step
            sample = min(int(where), last)
            part = where - sample
            sample += begin
            if attempt == 0:
                low, high = samples[sample, FREE_FROM_M], samples[sample, FREE_TO_M]
                inside = max(low - old_kerb_m, old_kerb_m - high) <= OUTSIDE_M
                wanted_m = low + motion[i, PLACE] * (high - low) - old_kerb_m
                aside_m = min(max(wanted_m, -drift_m), drift_m)
                if not inside:
                    continue
            kerb_m = old_kerb_m if attempt == 1 else old_kerb_m + aside_m
            right = kerb_m - half_width_m
            x = samples[sample, WALK_X] - right * samples[sample, WALK_SIN]
            y = samples[sample, WALK_Y] + right * samples[sample, WALK_COS]
            x += part * (samples[sample + 1, WALK_X] - right * samples[sample + 1, WALK_SIN] - x)
            y += part * (samples[sample + 1, WALK_Y] + right * samples[sample + 1, WALK_COS] - y)
            goes = True
            for k in range(count):
                j = near[k]
                apart = RADIUS_SHARE * (size + pedestrians[j, LENGTH])
                dx, dy = pedestrians[j, X] - x, pedestrians[j, Y] - y
                distance2 = dx * dx + dy * dy
                dx, dy = pedestrians[j, X] - old_x, pedestrians[j, Y] - old_y
                if distance2 < apart * apart and distance2 < dx * dx + dy * dy:
                    goes = False
                    break
            if goes:
                motion[i, WALK_STATION], motion[i, KERB_M] = station, kerb_m
                break
        if not goes:
            x, y, sample = old_x, old_y, old_sample

        dx, dy = x - old_x, y - old_y
        moved = math.sqrt(dx * dx + dy * dy)
        pedestrians[i, SPEED] = moved / dt_s
        pedestrians[i, X], pedestrians[i, Y] = x, y
        if moved > STANDS_M:
            pedestrians[i, HEADING] = _heading(dx, dy)

        # whoever steps aside around an obstacle is not blocked by anyone
        blocked = not goes or (attempt == 3 and inside)
        if blocked or motion[i, BLOCKED_S] > 0.0:
            seconds = _note_blocked(motion, i, dt_s, blocked)
            if seconds >= TURN_AROUND_S:
                track[i, DIRECTION] = -track[i, DIRECTION]
                motion[i, BLOCKED_S] = 0.0
                _keep_right(seed, track, motion, i)
            elif seconds > 0:
                motion[i, PLACE] = _draw(seed, track, i)
        if sample != old_sample and stop_at[sample] >= 0:
            _consider_crossing(crossings, stop_at[sample] // 2, seed, track, motion, i)


@kernel
def _consider_crossing(
    crossings: Crossings, c: int, seed: int, track: NDArray, motion: NDArray, i: int
) -> None:
    """Choose at a crossing whether to go over; not twice in a row at the same one."""
    if c == track[i, CROSSING]:
        return
    likely = CROSS_AT_MOUTH if crossings.mouth[c] else CROSS_MIDBLOCK
    if _draw(seed, track, i) < likely:
        track[i, MODE], track[i, CROSSING] = WAITING, c
        motion[i, WAITED_FOR_S], motion[i, BLOCKED_S] = 0.0, 0.0
    else:
        _keep_right(seed, track, motion, i)


@kernel
def _wait(
    walks: Walks,
    crossings: Crossings,
    dt_s: float,
    seed: int,
    signals: NDArray,
    threatened: NDArray,
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
    heads: NDArray,
    following: NDArray,
    near: NDArray,
) -> None:
    """One step of those who go to the kerb, or stand there until they may cross."""
    signal, reach_m = crossings.signal, _reach(dt_s)
    for i in range(pedestrians.shape[0]):
        if pedestrians[i, LENGTH] <= 0.0 or track[i, MODE] != WAITING:
            continue
        c = track[i, CROSSING]
        k = signal[c]
        may_cross = threatened[c] == 0
        if 0 <= k < signals.shape[0]:
            may_cross &= signals[k] == SIGNAL_OFF or signals[k] == SIGNAL_RED
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
            _keep_right(seed, track, motion, i)
        elif distance > 0.02:
            share = min(1.0, motion[i, PACE_MPS] * dt_s / distance)
            station = wrap_station(walks, walk, station + share * along)
            kerb_m = motion[i, KERB_M] + share * aside
            x, y = walk_point(walks, walk, station, kerb_m)
            count = _find_near(pedestrians, i, reach_m, heads, following, near)
            if _may_go(pedestrians, i, x, y, near, count):
                motion[i, WALK_STATION], motion[i, KERB_M] = station, kerb_m
                _move(pedestrians, i, x, y, dt_s)


@kernel
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
    if _draw(seed, track, i) < HESITATES:
        if _draw(seed, track, i) < 0.7:
            motion[i, HESITATE_AT_M] = 0.7 + 0.7 * _draw(seed, track, i)
        else:
            motion[i, HESITATE_AT_M] = length / 2.0 + 0.6 * _draw(seed, track, i) - 0.3
        motion[i, HESITATE_S] = 1.0 + 2.0 * _draw(seed, track, i)


@kernel
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


@kernel
def _cross(
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
    pedestrians: NDArray,
    track: NDArray,
    motion: NDArray,
    heads: NDArray,
    following: NDArray,
    near: NDArray,
) -> None:
    """One step of those who cross a road."""
    ends, lengths = crossings.ends, crossings.length
    drift_m, reach_m = DRIFT_MPS * dt_s, _reach(dt_s)
    for i in range(pedestrians.shape[0]):
        if pedestrians[i, LENGTH] <= 0.0 or track[i, MODE] != ON_CROSSING:
            continue
        c, direction = track[i, CROSSING], track[i, DIRECTION]
        length = lengths[c]
        pedestrians[i, SPEED] = 0.0
        done = motion[i, ALONG_M] if direction > 0 else length - motion[i, ALONG_M]
        if done >= length + KERB_GAP_M:
            _arrive(walks, crossings, c, (1 + direction) // 2, pedestrians, track, motion, i)
            track[i, MODE] = WALKING
            track[i, DIRECTION] = 1 if _draw(seed, track, i) < 0.5 else -1
            _keep_right(seed, track, motion, i)
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
        count = _find_near(pedestrians, i, reach_m, heads, following, near)
        blocked = True
        # ahead and aside, ahead, half as far ahead, aside
        for attempt in range(4):
            share = 1.0 if attempt < 2 else 0.5 if attempt == 2 else 0.0
            along_m = motion[i, ALONG_M] + share * step
            aside_m = motion[i, ASIDE_M] + (0.0 if attempt == 1 else aside)
            x, y = ax + along_m * cos - aside_m * sin, ay + along_m * sin + aside_m * cos
            # vehicles keep to the road
            on_road = along_m > -LARGEST_M and along_m < length + LARGEST_M
            if _may_go(pedestrians, i, x, y, near, count) and not (
                on_road
                and _touches_vehicle(
                    pedestrians, i, x, y, ego, ego_half_length, ego_half_width, vehicles
                )
            ):
                motion[i, ALONG_M], motion[i, ASIDE_M] = along_m, aside_m
                _move(pedestrians, i, x, y, dt_s)
                blocked = attempt == 3
                break
        seconds = _note_blocked(motion, i, dt_s, blocked)
        if seconds >= TURN_BACK_S:
            track[i, DIRECTION] = -direction
            motion[i, BLOCKED_S], motion[i, ASIDE_WANTED_M] = 0.0, -KEEP_RIGHT_M * direction
        elif seconds > 0:
            motion[i, ASIDE_WANTED_M] = SIDESTEP_M * (2.0 * _draw(seed, track, i) - 1.0)


@kernel
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
        pedestrians: (P, 6) rows, changed in place; a row of length 0 is an empty slot.
        track: (P, 5) int64, changed in place.
        motion: (P, 11), changed in place.
    """
    heads = np.empty(BUCKETS, np.int32)
    following = np.empty(pedestrians.shape[0], np.int32)
    near = np.empty(NEAR, np.int32)
    crowded = np.empty(pedestrians.shape[0], np.bool_)
    hash_cells(pedestrians, _reach(dt_s), heads, following, crowded)
    # in this order, so that nobody who goes over to another mode moves twice
    _cross(
        walks,
        crossings,
        dt_s,
        seed,
        signals,
        threatened,
        ego,
        ego_half_length,
        ego_half_width,
        vehicles,
        pedestrians,
        track,
        motion,
        heads,
        following,
        near,
    )
    _wait(
        walks,
        crossings,
        dt_s,
        seed,
        signals,
        threatened,
        pedestrians,
        track,
        motion,
        heads,
        following,
        near,
    )
    _walk(
        walks,
        crossings,
        dt_s,
        seed,
        pedestrians,
        track,
        motion,
        heads,
        following,
        crowded,
        near,
    )
