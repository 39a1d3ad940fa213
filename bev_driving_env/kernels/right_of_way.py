"""Who may enter a junction: signals first, then nobody in the way, then giving way."""

from __future__ import annotations

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import SIGNAL_OFF, SIGNAL_RED, SIGNAL_YELLOW
from .lineup import NOBODY, Lineup
from .rails import (
    CLEAR_M,
    CROSSES,
    CROSSING,
    CROSSING_M,
    CROSSING_SIDE,
    DIVERGES,
    MERGES,
    OTHER,
    RELATION,
    YIELDS,
    Rails,
)

FREE, STOP_SIGNAL, IN_THE_WAY, GIVE_WAY, PEOPLE, FULL = range(6)
"""Why a junction may not be entered, or ``FREE``."""
STOPPING_MPS2 = 3.0
"""A yellow light is driven through only where stopping would take more than this."""
ARRIVING_MPS = 0.5
GAP_S = 5.0
"""Traffic that goes first and will be at its line within this time is let through ..."""
PATIENCE_S = 15.0
"""... until one has waited this long."""
STARVED_S = 50.0
"""Longer than a cycle of signals: whoever has waited for so long gets the next room there is."""
ROLLING_MPS = 2.5
"""Traffic behind the junction that is faster than this will have made room."""
ROOM_M = 3.0
MOUTH_M = 4.0
"""A crossing this near to the line is on this side of the junction."""


@leaf_kernel
def may_enter(rails: Rails, lineup: Lineup, i: int, signals: NDArray, occupied: NDArray) -> int:
    """Whether driver ``i``, the first at its line, may enter the movement it goes on to.

    Args:
        rails: The town's rails.
        lineup: Drivers.
        i: Which one.
        signals: (S,).
        occupied: (C, 2) halves of crossings with people on them.

    Returns:
        ``FREE`` or the first reason against it.
    """
    road, movement = lineup.rail[i], lineup.onward[i]
    signal = rails.signal[road]
    light = signals[signal] if signal >= 0 else SIGNAL_OFF
    if light == SIGNAL_RED:
        return STOP_SIGNAL
    line_m = rails.length[road] - lineup.station[i] - 0.5 * lineup.length[i]
    if light == SIGNAL_YELLOW and lineup.speed[i] ** 2 <= 2.0 * STOPPING_MPS2 * line_m:
        return STOP_SIGNAL
    for k in range(rails.conflict_first[movement], rails.conflict_first[movement + 1]):
        other, relation = int(rails.conflicts[k, OTHER]), int(rails.conflicts[k, RELATION])
        if relation == DIVERGES:
            continue  # whoever is there is followed, not waited for
        if _is_taken(rails, lineup, i, other, relation, rails.conflicts[k, CLEAR_M]):
            return IN_THE_WAY
        if relation == MERGES and _is_starved(rails, lineup, i, other):
            return FULL
        goes_first = light == SIGNAL_OFF and rails.conflicts[k, YIELDS] > 0.0
        if goes_first and _is_coming(rails, lineup, i, other):
            return GIVE_WAY
    # where a signal keeps the others back, people behind the junction can be waited for inside
    reach_m = rails.length[movement] if light == SIGNAL_OFF else MOUTH_M
    for k in range(rails.crossing_first[movement], rails.crossing_first[movement + 1]):
        if rails.crossings[k, CROSSING_M] > reach_m:
            break
        if occupied[int(rails.crossings[k, CROSSING]), int(rails.crossings[k, CROSSING_SIDE])]:
            return PEOPLE
    if not _has_room(rails, lineup, i, movement):
        return FULL
    return FREE


@leaf_kernel
def _is_taken(
    rails: Rails, lineup: Lineup, i: int, other: int, relation: int, clear_m: float
) -> bool:
    """Whether somebody is on another movement, or on the way into it, and not yet clear."""
    j = lineup.rearmost[other]
    if j == i:
        j = lineup.ahead[j]
    if j != NOBODY and (relation == MERGES or lineup.station[j] <= clear_m):
        return True
    j = _first_towards(rails, lineup, i, other)
    if j != NOBODY and lineup.admitted[j]:
        return True
    if relation == CROSSES and clear_m > rails.length[other]:
        # its tail may still be in the way
        j = lineup.rearmost[rails.following[other, 0]]
        if j != NOBODY and j != i and lineup.station[j] <= clear_m - rails.length[other]:
            return True
    return False


@leaf_kernel
def _first_towards(rails: Rails, lineup: Lineup, i: int, movement: int) -> int:
    """Whoever but ``i`` is first at the line of a movement and goes on to it, or -1."""
    approach = rails.approach[movement]
    if approach < 0:
        return NOBODY
    j = lineup.foremost[approach]
    return NOBODY if j in (NOBODY, i) or lineup.onward[j] != movement else j


@leaf_kernel
def _is_coming(rails: Rails, lineup: Lineup, i: int, other: int) -> bool:
    """Whether somebody who goes first will soon be at the line of another movement."""
    j = _first_towards(rails, lineup, i, other)
    if j == NOBODY or lineup.waited[i] > PATIENCE_S or lineup.speed[j] < ARRIVING_MPS:
        return False
    line_m = rails.length[lineup.rail[j]] - lineup.station[j] - 0.5 * lineup.length[j]
    return line_m < GAP_S * lineup.speed[j]


@leaf_kernel
def _is_starved(rails: Rails, lineup: Lineup, i: int, other: int) -> bool:
    """Whether somebody else who goes to the same road has waited so long that ``i`` lets it go."""
    j = _first_towards(rails, lineup, i, other)
    return j != NOBODY and lineup.waited[j] > max(STARVED_S, lineup.waited[i])


@leaf_kernel
def _has_room(rails: Rails, lineup: Lineup, i: int, movement: int) -> bool:
    """Whether driver ``i`` will be able to leave the junction, with all who go there before it."""
    road = rails.following[movement, 0]
    if road < 0:
        return True
    j = lineup.rearmost[road]
    needed_m = lineup.length[i] + ROOM_M
    rolling = True
    room_m = rails.length[road]
    if j != NOBODY and j != i:
        room_m = lineup.station[j] - 0.5 * lineup.length[j]
        rolling = lineup.speed[j] > ROLLING_MPS
    k = lineup.rearmost[movement]
    while k != NOBODY:
        if k != i:
            needed_m += lineup.length[k] + ROOM_M
            rolling = rolling and lineup.speed[k] > ROLLING_MPS
        k = lineup.ahead[k]
    return room_m >= needed_m or (rolling and room_m >= lineup.length[i])
