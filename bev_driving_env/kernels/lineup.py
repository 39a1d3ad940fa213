"""Who drives where: one world's vehicles, and the ego among them, in order along the rails."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import (
    ADMITTED,
    AFTER_RAIL,
    DISTANCE,
    HEADING_ERROR,
    LENGTH,
    NEXT_RAIL,
    RAIL,
    ROUTE_POSITION,
    SPEED,
    STATION,
    WAITED_S,
)
from .rails import Rails

NOBODY = -1
NOWHERE = -1
ON_ROUTE_M = 2.0
ON_ROUTE_RAD = math.radians(60.0)
"""The ego takes part in traffic while it is this near to its route and turned no farther."""
EGO_BRAKING_MPS2 = 3.5
"""An ego that would have to brake harder to stop at a line is taken to go on."""
AT_LINE_M = 10.0
"""An ego farther from its line than this is not waiting there."""
STANDING_MPS, OVER_M = 0.3, 1.5
"""Standing, it waits at its line even with its bumper this far over it."""


class Lineup(NamedTuple):
    """Drivers (D,) of one world, the ego the last; a rail of -1 means not there.

    Attributes:
        rail: Rail each is on.
        onward: The rail it goes on to, or -1.
        after: The rail after that, or -1.
        station: Metres of its centre along its rail.
        speed: m/s.
        length: Metres.
        waited: Seconds it has been waiting at a stop line.
        admitted: Whether it will not stop before the junction ahead.
        ahead: The next driver ahead on the same rail, or -1.
        rearmost: (G,) first driver on each rail, counted from its start, or -1.
        foremost: (G,) last one.
    """

    rail: NDArray
    onward: NDArray
    after: NDArray
    station: NDArray
    speed: NDArray
    length: NDArray
    waited: NDArray
    admitted: NDArray
    ahead: NDArray
    rearmost: NDArray
    foremost: NDArray


NUMBERS, METRES, ENDS = 5, 4, 2


@leaf_kernel
def lineup_in(numbers: NDArray, metres: NDArray, ends: NDArray) -> Lineup:
    """A line-up whose columns are rows of three tables: fewer arrays for Python to hand over.

    For other kernels only: Python would be given whole tables for columns.

    Args:
        numbers: (5, D) int64.
        metres: (4, D) float64.
        ends: (2, G) int64.
    """
    return Lineup(
        numbers[0],
        numbers[1],
        numbers[2],
        metres[0],
        metres[1],
        metres[2],
        metres[3],
        numbers[3],
        numbers[4],
        ends[0],
        ends[1],
    )


@leaf_kernel
def line_up(
    rails: Rails,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
    ego: NDArray,
    ego_length_m: float,
    ego_waited_s: float,
    progress: NDArray,
    route_rails: NDArray,
    route_rail_m: NDArray,
    route_rail_count: int,
    lineup: Lineup,
) -> None:
    """Fill a line-up from one world's state.

    Args:
        rails: The town's rails.
        vehicles: (V, 6); a length of 0 is an empty slot.
        track: (V, 6).
        motion: (V, 3).
        ego: (4,).
        ego_length_m: Its length.
        ego_waited_s: How long it has been standing.
        progress: (5,) of its route.
        route_rails: (K,) rails along its route.
        route_rail_m: (K,) route position at which each begins.
        route_rail_count: How many of them are valid.
        lineup: Output.
    """
    lineup.rearmost[:] = NOBODY
    lineup.foremost[:] = NOBODY
    count = vehicles.shape[0]
    for i in range(count):
        lineup.rail[i] = track[i, RAIL] if vehicles[i, LENGTH] > 0.0 else NOWHERE
        lineup.onward[i], lineup.after[i] = track[i, NEXT_RAIL], track[i, AFTER_RAIL]
        lineup.station[i], lineup.speed[i] = motion[i, STATION], vehicles[i, SPEED]
        lineup.length[i], lineup.waited[i] = vehicles[i, LENGTH], motion[i, WAITED_S]
        lineup.admitted[i] = track[i, ADMITTED]
    _place_ego(rails, ego, progress, route_rails, route_rail_m, route_rail_count, lineup)
    lineup.length[count], lineup.waited[count] = ego_length_m, 0.0
    if lineup.rail[count] >= 0:
        line_m = rails.length[lineup.rail[count]] - lineup.station[count] - 0.5 * ego_length_m
        if line_m < AT_LINE_M:
            lineup.waited[count] = ego_waited_s
        _admit_ego(lineup, line_m)
    for i in range(count + 1):
        if lineup.rail[i] >= 0:
            _insert(lineup, i)


@leaf_kernel
def _place_ego(
    rails: Rails,
    ego: NDArray,
    progress: NDArray,
    route_rails: NDArray,
    route_rail_m: NDArray,
    route_rail_count: int,
    lineup: Lineup,
) -> None:
    """Put the ego on the rail that its route runs along, if it keeps to its route."""
    i = lineup.rail.shape[0] - 1
    lineup.rail[i] = lineup.onward[i] = lineup.after[i] = NOWHERE
    lineup.speed[i], lineup.admitted[i] = ego[SPEED], 0
    if progress[DISTANCE] > ON_ROUTE_M or abs(progress[HEADING_ERROR]) > ON_ROUTE_RAD:
        return
    position = progress[ROUTE_POSITION]
    for k in range(route_rail_count - 1, -1, -1):
        if position >= route_rail_m[k]:
            lineup.rail[i], lineup.station[i] = route_rails[k], position - route_rail_m[k]
            if k + 1 < route_rail_count:
                lineup.onward[i] = route_rails[k + 1]
            if k + 2 < route_rail_count:
                lineup.after[i] = route_rails[k + 2]
            return


@leaf_kernel
def _admit_ego(lineup: Lineup, line_m: float) -> None:
    """An ego too near or too fast to stop at the line ahead is on its way into the junction."""
    i = lineup.rail.shape[0] - 1
    needed_m = lineup.speed[i] ** 2 / (2.0 * EGO_BRAKING_MPS2)
    if lineup.speed[i] < STANDING_MPS:
        needed_m = -OVER_M  # stopped a little late, it still waits at its line
    lineup.admitted[i] = 1 if line_m < needed_m else 0


@leaf_kernel
def _insert(lineup: Lineup, i: int) -> None:
    """Sort a driver into the list of its rail."""
    rail, station = lineup.rail[i], lineup.station[i]
    behind = lineup.rearmost[rail]
    if behind == NOBODY or station < lineup.station[behind]:
        lineup.ahead[i] = behind
        lineup.rearmost[rail] = i
        if behind == NOBODY:
            lineup.foremost[rail] = i
        return
    while lineup.ahead[behind] != NOBODY and lineup.station[lineup.ahead[behind]] <= station:
        behind = lineup.ahead[behind]
    lineup.ahead[i] = lineup.ahead[behind]
    lineup.ahead[behind] = i
    if lineup.ahead[i] == NOBODY:
        lineup.foremost[rail] = i
