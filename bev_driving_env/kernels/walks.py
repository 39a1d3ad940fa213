"""Walks and crossings: where pedestrians walk, where things are along it, and what they keep."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel
from .noise import mix, uniform

WALK_X, WALK_Y, WALK_COS, WALK_SIN, FREE_FROM_M, FREE_TO_M, BEND = range(7)
WALK_COLUMNS = 7

# pedestrian_track (N, P, 5): walk, direction (along the walk, or from a crossing's first end to
# its second), mode, the crossing that a pedestrian waits for, is on or last took (-1: none yet),
# and how many random numbers he has drawn
WALK, DIRECTION, MODE, CROSSING, COUNTER = range(5)
PED_TRACK_COLUMNS = 5
WALKING, WAITING, ON_CROSSING = range(3)

(
    WALK_STATION,
    KERB_M,
    PLACE,
    ALONG_M,
    ASIDE_M,
    ASIDE_WANTED_M,
    PACE_MPS,
    BLOCKED_S,
    WAITED_FOR_S,
    HESITATE_AT_M,
    HESITATE_S,
) = range(11)
PED_MOTION_COLUMNS = 11
"""Columns of pedestrian_motion (N, P, 11).

The station on the walk, the distance from the kerb, where in the free band he would like to walk
(0 its kerb side, 1 the other), metres along the crossing from its first end, metres to the right
of the line (as seen from the first end) that he is and would like to be, pace, how long something
has been in his way, how long he has been waiting, how far from where he stepped on to the road he
hesitates, and how much longer.
"""


DRIFT_MPS = 0.4
"""How fast a pedestrian goes aside."""
BLOCKED_DECAY = 0.25


class Walks(NamedTuple):
    """A town's sidewalks as W closed loops, each once around a block, the road on the left.

    Attributes:
        first: (W + 1,) int64, where each loop's part of ``samples`` begins. The last sample of a
            loop repeats its first.
        step_m: (W,) metres between samples of a loop, at most 0.5.
        length: (W,) metres around.
        half_width_m: Half the width of the sidewalk; the loop runs along its middle.
        samples: (M, 7) x, y, cosine and sine of the heading, the free lateral band (from and to
            which distance from the kerb nothing stands in the way), and the curvature in radians
            per metre, positive to the right.
    """

    first: NDArray
    step_m: NDArray
    length: NDArray
    half_width_m: float
    samples: NDArray


class Crossings(NamedTuple):
    """C straight ways over the road, kerb to kerb; each may be walked both ways.

    Attributes:
        ends: (C, 4) ax, ay, bx, by on the kerbs. Seen by the traffic of the approach, a is on the
            right.
        length: (C,) metres.
        walk: (C, 2) int64, the loop at each end.
        station: (C, 2) station of the loop's point nearest to each end.
        signal: (C,) int64, the signal of the approach; -1 for none.
        mouth: (C,) bool, whether it is at the mouth of a junction, not between two.
        stop_at: (M,) int64, for each sample of the walks 2 * crossing + end if that end lies
            between it and the next sample, else -1.
    """

    ends: NDArray
    length: NDArray
    walk: NDArray
    station: NDArray
    signal: NDArray
    mouth: NDArray
    stop_at: NDArray


@leaf_kernel
def walk_row(walks: Walks, walk: int, station_m: float) -> tuple[int, float]:
    """Sample at or before a station in [0, length], and which part of the way to the next."""
    where = station_m / walks.step_m[walk]
    first = walks.first[walk]
    row = min(int(where), walks.first[walk + 1] - first - 2)
    return first + row, where - row


@leaf_kernel
def walk_point(walks: Walks, walk: int, station_m: float, kerb_m: float) -> tuple[float, float]:
    """World point at a station in [0, length] and a distance from the kerb."""
    row, part = walk_row(walks, walk, station_m)
    return beside(walks.samples, row, part, kerb_m - walks.half_width_m)


@leaf_kernel
def beside(samples: NDArray, row: int, part: float, right: float) -> tuple[float, float]:
    """World point to the right of the middle, on a part of the way from a sample to the next."""
    x = samples[row, WALK_X] - right * samples[row, WALK_SIN]
    y = samples[row, WALK_Y] + right * samples[row, WALK_COS]
    next_x = samples[row + 1, WALK_X] - right * samples[row + 1, WALK_SIN]
    next_y = samples[row + 1, WALK_Y] + right * samples[row + 1, WALK_COS]
    return x + part * (next_x - x), y + part * (next_y - y)


@leaf_kernel
def walk_pose(walks: Walks, walk: int, station_m: float) -> tuple[float, float, float]:
    """Pose (x, y, heading) of the middle of the sidewalk at a station in [0, length]."""
    row, part = walk_row(walks, walk, station_m)
    samples = walks.samples
    x = samples[row, WALK_X] + part * (samples[row + 1, WALK_X] - samples[row, WALK_X])
    y = samples[row, WALK_Y] + part * (samples[row + 1, WALK_Y] - samples[row, WALK_Y])
    cos = samples[row, WALK_COS] + part * (samples[row + 1, WALK_COS] - samples[row, WALK_COS])
    sin = samples[row, WALK_SIN] + part * (samples[row + 1, WALK_SIN] - samples[row, WALK_SIN])
    return x, y, math.atan2(sin, cos)


@leaf_kernel
def wrap_station(walks: Walks, walk: int, station_m: float) -> float:
    """The same place in [0, length), for a station at most one loop outside."""
    length = walks.length[walk]
    if station_m < 0.0:
        station_m += length
    # a tiny negative station may have become the length itself
    return station_m - length if station_m >= length else station_m


@leaf_kernel
def walk_gap(walks: Walks, walk: int, from_m: float, to_m: float) -> float:
    """Signed way along a loop between two stations, the shorter way around."""
    length = walks.length[walk]
    gap = to_m - from_m
    return gap - length * round(gap / length)


@leaf_kernel
def nearest_on_walk(
    walks: Walks, walk: int, near_m: float, x: float, y: float
) -> tuple[float, float]:
    """Station and distance from the kerb of a world point, searched from a station nearby."""
    samples = walks.samples
    station, right = wrap_station(walks, walk, near_m), 0.0
    for _ in range(16):
        row, part = walk_row(walks, walk, station)
        cos = samples[row, WALK_COS] + part * (samples[row + 1, WALK_COS] - samples[row, WALK_COS])
        sin = samples[row, WALK_SIN] + part * (samples[row + 1, WALK_SIN] - samples[row, WALK_SIN])
        size = math.sqrt(cos * cos + sin * sin)
        cos, sin = cos / size, sin / size
        px = samples[row, WALK_X] + part * (samples[row + 1, WALK_X] - samples[row, WALK_X])
        py = samples[row, WALK_Y] + part * (samples[row + 1, WALK_Y] - samples[row, WALK_Y])
        ahead = (x - px) * cos + (y - py) * sin
        right = (y - py) * cos - (x - px) * sin
        if abs(ahead) < 1e-4:
            break
        # in a bend a metre of station is more or less than a metre at the point's distance
        ahead = min(max(0.7 * ahead, -2.0), 2.0)
        station = wrap_station(walks, walk, station + ahead)
    return station, right + walks.half_width_m


@leaf_kernel
def draw(seed: int, track: NDArray, i: int) -> float:
    """A pedestrian's next random number in [0, 1)."""
    track[i, COUNTER] += 1
    return uniform(mix(seed, i), track[i, COUNTER])


@leaf_kernel
def keep_right(seed: int, track: NDArray, motion: NDArray, i: int) -> None:
    """Choose a place on the right-hand side of the free band."""
    place = 0.45 * draw(seed, track, i)
    motion[i, PLACE] = 1.0 - place if track[i, DIRECTION] > 0 else place


@leaf_kernel
def note_blocked(motion: NDArray, i: int, dt_s: float, blocked: bool) -> int:
    """Keep the time something has been in the way; returns each whole second once, else 0."""
    before = motion[i, BLOCKED_S]
    if not blocked:
        motion[i, BLOCKED_S] = max(0.0, before - BLOCKED_DECAY * dt_s)
        return 0
    motion[i, BLOCKED_S] = before + dt_s
    return int(before + dt_s) if int(before + dt_s) > int(before) else 0
