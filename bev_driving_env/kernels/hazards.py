"""What a driver has to slow down for: leaders, stop lines, people, and an ego in its way."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .idm import JAM_GAP_M, idm_interaction
from .jit import leaf_kernel
from .layout import HEADING, SPEED, X, Y
from .lineup import NOBODY, Lineup
from .rails import (
    CLEAR_M,
    CROSSING,
    CROSSING_M,
    CROSSING_SIDE,
    DIVERGES,
    OTHER,
    RELATION,
    Rails,
    rail_pose,
    top_speed,
)
from .right_of_way import FREE, may_enter

SIGHT_M = 60.0
"""How far ahead leaders and stop lines matter."""
LINE_JAM_M = 1.0
CROSSING_HALF_M = 1.0
CROSSING_JAM_M = 0.8
EGO_SIGHT_M = 30.0
EGO_MARGIN_M = 0.4
NOMINAL_LENGTH_M = 5.0
"""Added to gap and jam gap alike, as if the ego were followed from centre to centre."""
APPROACH_MPS2 = 2.0
"""Deceleration with which slower rails ahead are approached."""
COMMIT_MPS2 = 2.5


@leaf_kernel
def speed_ahead(rails: Rails, lineup: Lineup, i: int) -> float:
    """Greatest speed that curves and limits allow driver ``i``, here and ahead."""
    rail, station = lineup.rail[i], lineup.station[i]
    allowed = top_speed(rails, rail, station)
    ahead_m = rails.length[rail] - station
    rail = lineup.onward[i]
    if rail >= 0:
        top = top_speed(rails, rail, 0.0)
        allowed = min(allowed, math.sqrt(top * top + 2.0 * APPROACH_MPS2 * max(ahead_m, 0.0)))
    return allowed


@leaf_kernel
def leader_ahead(rails: Rails, lineup: Lineup, i: int) -> tuple[int, float]:
    """The driver that ``i`` follows and the metres between their centres; (-1, inf) if none."""
    rail, station = lineup.rail[i], lineup.station[i]
    best, best_m = NOBODY, math.inf
    j = lineup.ahead[i]
    if j != NOBODY:
        return j, lineup.station[j] - station
    ahead_m = rails.length[rail] - station
    onward = lineup.onward[i]
    if onward >= 0 and ahead_m < SIGHT_M:
        j = lineup.rearmost[onward]
        if j != NOBODY and j != i:
            best, best_m = j, ahead_m + lineup.station[j]
        elif lineup.after[i] >= 0 and ahead_m + rails.length[onward] < SIGHT_M:
            j = lineup.rearmost[lineup.after[i]]
            if j != NOBODY and j != i:
                best, best_m = j, ahead_m + rails.length[onward] + lineup.station[j]
    # whoever turns off ahead is in the way until it has turned
    movement, offset_m = (rail, -station) if rails.movement[rail] else (onward, ahead_m)
    if movement >= 0 and offset_m < SIGHT_M:
        for k in range(rails.conflict_first[movement], rails.conflict_first[movement + 1]):
            if int(rails.conflicts[k, RELATION]) != DIVERGES:
                continue
            j = lineup.rearmost[int(rails.conflicts[k, OTHER])]
            while j != NOBODY and lineup.station[j] <= rails.conflicts[k, CLEAR_M]:
                between_m = offset_m + lineup.station[j]
                if j != i and 0.0 < between_m < best_m:
                    best, best_m = j, between_m
                    break
                j = lineup.ahead[j]
    return best, best_m


@leaf_kernel
def people_ahead(rails: Rails, lineup: Lineup, i: int, occupied: NDArray) -> float:
    """Metres from the front of driver ``i`` to the next crossing with people on it, or inf."""
    front_m = lineup.station[i] + 0.5 * lineup.length[i]
    rail, offset_m = lineup.rail[i], 0.0
    for part in range(2):
        for k in range(rails.crossing_first[rail], rails.crossing_first[rail + 1]):
            at_m = offset_m + rails.crossings[k, CROSSING_M] - CROSSING_HALF_M
            # somebody whose front is on it already goes on
            if at_m + CROSSING_HALF_M < front_m:
                continue
            if at_m - front_m > SIGHT_M:
                return math.inf
            if occupied[int(rails.crossings[k, CROSSING]), int(rails.crossings[k, CROSSING_SIDE])]:
                return at_m - front_m
        offset_m += rails.length[rail]
        rail = lineup.onward[i]
        if rail < 0 or offset_m - front_m > SIGHT_M or part == 1:
            break
    return math.inf


@leaf_kernel
def ego_ahead(
    rails: Rails,
    lineup: Lineup,
    i: int,
    x: float,
    y: float,
    half_width_m: float,
    ego: NDArray,
    ego_half_length_m: float,
    ego_half_width_m: float,
) -> float:
    """Metres that driver ``i`` can go along its way before it touches the ego, or inf.

    Args:
        rails: The town's rails.
        lineup: Drivers.
        i: Which one.
        x: World x of its centre.
        y: World y.
        half_width_m: Half its width.
        ego: (4,).
        ego_half_length_m: Half the ego's length.
        ego_half_width_m: Half its width.
    """
    dx, dy = ego[X] - x, ego[Y] - y
    if dx * dx + dy * dy > EGO_SIGHT_M * EGO_SIGHT_M:
        return math.inf
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    reach = half_width_m + EGO_MARGIN_M
    rail, front_m = lineup.rail[i], lineup.station[i] + 0.5 * lineup.length[i]
    onward, speed = lineup.onward[i], lineup.speed[i]
    look_m = min(EGO_SIGHT_M, 6.0 + 1.5 * speed + speed * speed / 4.0)
    length = rails.length[rail]
    along = 0.0
    while along <= look_m:
        station = front_m + along
        if station <= length:
            px, py, _ = rail_pose(rails, rail, station)
        elif onward >= 0:
            px, py, _ = rail_pose(rails, onward, min(station - length, rails.length[onward]))
        else:
            return math.inf
        dx, dy = px - ego[X], py - ego[Y]
        ahead = max(abs(dx * cos + dy * sin) - ego_half_length_m, 0.0)
        aside = max(abs(dy * cos - dx * sin) - ego_half_width_m, 0.0)
        if ahead * ahead + aside * aside < reach * reach:
            return max(along - reach + half_width_m, 0.0)
        along += 0.75
    return math.inf


@leaf_kernel
def line_ahead(
    rails: Rails, lineup: Lineup, i: int, signals: NDArray, occupied: NDArray
) -> tuple[float, int]:
    """Metres from the front of driver ``i`` to the line it has to stop at, or inf, and why.

    Only the first in line is asked; the others follow it.
    """
    rail, onward = lineup.rail[i], lineup.onward[i]
    if rails.movement[rail] or onward < 0 or not rails.movement[onward]:
        return math.inf, FREE
    if lineup.admitted[i] or lineup.ahead[i] != NOBODY:
        return math.inf, FREE
    line_m = rails.length[rail] - lineup.station[i] - 0.5 * lineup.length[i]
    if line_m > SIGHT_M:
        return math.inf, FREE
    reason = may_enter(rails, lineup, i, signals, occupied)
    if reason == FREE:
        return math.inf, FREE
    return max(line_m, 0.0), reason


@leaf_kernel
def commit_distance(speed_mps: float) -> float:
    """Distance to a line at which a driver decides to go on (metres from its front)."""
    return 2.0 + 0.5 * speed_mps + speed_mps * speed_mps / (2.0 * COMMIT_MPS2)


@leaf_kernel
def strongest_interaction(
    lineup: Lineup,
    i: int,
    leader: int,
    leader_m: float,
    line_m: float,
    people_m: float,
    ego_m: float,
    ego: NDArray,
    heading: float,
) -> float:
    """The greatest IDM interaction (m/s^2) among all that driver ``i`` has to mind.

    Args:
        lineup: Drivers.
        i: Which one.
        leader: The driver ahead, or -1.
        leader_m: Metres between their centres.
        line_m: Metres from its front to the line it stops at, or inf.
        people_m: Metres from its front to a crossing with people, or inf.
        ego_m: Metres it can go before it touches the ego, or inf.
        ego: (4,).
        heading: Its own, radians.
    """
    speed = lineup.speed[i]
    strongest = 0.0
    if leader != NOBODY:
        jam_m = JAM_GAP_M + 0.5 * (lineup.length[i] + lineup.length[leader])
        strongest = idm_interaction(speed, leader_m, jam_m, speed - lineup.speed[leader])
    if line_m < math.inf:
        strongest = max(strongest, idm_interaction(speed, line_m, LINE_JAM_M, speed))
    if people_m < math.inf:
        strongest = max(
            strongest, idm_interaction(speed, max(people_m, 0.0), CROSSING_JAM_M, speed)
        )
    if ego_m < math.inf:
        along = ego[SPEED] * math.cos(ego[HEADING] - heading)
        # as far from bumper to bumper as from a leader
        centres_m, jam_m = ego_m + NOMINAL_LENGTH_M, JAM_GAP_M + NOMINAL_LENGTH_M
        strongest = max(strongest, idm_interaction(speed, centres_m, jam_m, speed - along))
    return strongest
