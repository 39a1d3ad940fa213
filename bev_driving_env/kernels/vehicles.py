"""One step of one world's vehicles along their rails."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .hazards import (
    commit_distance,
    ego_ahead,
    leader_ahead,
    line_ahead,
    people_ahead,
    speed_ahead,
    strongest_interaction,
)
from .idm import CLIP_MPS2, idm_free
from .jit import leaf_kernel
from .layout import (
    ADMITTED,
    AFTER_RAIL,
    CHOICES,
    HEADING,
    LAST_RAIL,
    NEXT_RAIL,
    RAIL,
    SPEED,
    STATION,
    WAITED_S,
    WANTED_MPS,
    WIDTH,
    X,
    Y,
)
from .lineup import NOBODY, NOWHERE, STANDING_MPS, Lineup
from .noise import mix, uniform
from .rails import CROSSING, CROSSING_M, Rails, rail_pose
from .right_of_way import FREE, FULL
from .snap import PER_UNIT, snap, write_row

WAYS = 0x7A4C
"""Keeps the random choices of way apart from all other random numbers of the episode."""
BUMPER_M = 0.5
"""Bumpers never come closer than this, whatever the model says."""
REROUTE_S = 6.0
"""Who has waited this long and then finds no room behind the junction takes another way."""


@leaf_kernel
def choose_way(rails: Rails, rail: int, seed: int, vehicle: int, choice: int) -> int:
    """The rail that a vehicle goes on to at the end of a rail, at random; -1 at a dead end."""
    ways = 0
    while ways < rails.following.shape[1] and rails.following[rail, ways] >= 0:
        ways += 1
    if ways == 0:
        return NOWHERE
    draw = uniform(mix(seed, WAYS + vehicle), choice)
    return rails.following[rail, int(draw * ways)]


@leaf_kernel
def set_out(rails: Rails, seed: int, vehicles: NDArray, track: NDArray, motion: NDArray) -> None:
    """Let vehicles that have a rail and a station choose their ways, and write their poses."""
    for i in range(vehicles.shape[0]):
        rail = track[i, RAIL]
        track[i, LAST_RAIL], track[i, AFTER_RAIL] = NOWHERE, NOWHERE
        track[i, NEXT_RAIL] = choose_way(rails, rail, seed, i, 0)
        if track[i, NEXT_RAIL] >= 0:
            track[i, AFTER_RAIL] = choose_way(rails, track[i, NEXT_RAIL], seed, i, 1)
        track[i, CHOICES] = 2
        x, y, heading = rail_pose(rails, rail, motion[i, STATION])
        write_row(vehicles[i], x, y, heading, 0.0)


@leaf_kernel
def step_vehicles(
    rails: Rails,
    dt_s: float,
    seed: int,
    signals: NDArray,
    occupied: NDArray,
    ego: NDArray,
    ego_half_length_m: float,
    ego_half_width_m: float,
    lineup: Lineup,
    accelerations: NDArray,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
) -> None:
    """Let all vehicles of one world decide, then move them, in place.

    Args:
        rails: The town's rails.
        dt_s: Seconds.
        seed: Of the episode.
        signals: (S,).
        occupied: (C, 2) halves of crossings with people on them.
        ego: (4,).
        ego_half_length_m: Half its length.
        ego_half_width_m: Half its width.
        lineup: All drivers, as they are now.
        accelerations: (V,) room to work in.
        vehicles: (V, 6).
        track: (V, 6).
        motion: (V, 3).
    """
    for i in range(vehicles.shape[0]):
        if lineup.rail[i] >= 0:
            accelerations[i] = _decide(
                rails, dt_s, seed, signals, occupied, ego, ego_half_length_m, ego_half_width_m,
                lineup, i, vehicles, track, motion,
            )  # fmt: skip
    for i in range(vehicles.shape[0]):
        if lineup.rail[i] >= 0:
            _move(rails, dt_s, seed, lineup, i, accelerations[i], vehicles, track, motion)


@leaf_kernel
def _decide(
    rails: Rails,
    dt_s: float,
    seed: int,
    signals: NDArray,
    occupied: NDArray,
    ego: NDArray,
    ego_half_length_m: float,
    ego_half_width_m: float,
    lineup: Lineup,
    i: int,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
) -> float:
    """Acceleration of vehicle ``i``; also settles whether it enters the junction ahead."""
    speed, rail = lineup.speed[i], lineup.rail[i]
    line_left_m = rails.length[rail] - lineup.station[i] - 0.5 * lineup.length[i]
    if lineup.admitted[i] and speed < STANDING_MPS and line_left_m > 0.0:
        lineup.admitted[i] = 0  # held up before the line: others may go meanwhile
    line_m, reason = line_ahead(rails, lineup, i, signals, occupied)
    first_in_line = lineup.ahead[i] == NOBODY and not rails.movement[rail]
    if line_m == math.inf and first_in_line and line_left_m <= commit_distance(speed):
        lineup.admitted[i] = 1
    track[i, ADMITTED] = lineup.admitted[i]
    if reason != FREE and speed < STANDING_MPS:
        motion[i, WAITED_S] += dt_s
        if reason == FULL and motion[i, WAITED_S] > REROUTE_S:
            _take_another_way(rails, seed, i, track)
            motion[i, WAITED_S] = 0.0
    leader, leader_m = leader_ahead(rails, lineup, i)
    people_m = people_ahead(rails, lineup, i, occupied)
    ego_m = ego_ahead(
        rails, lineup, i, vehicles[i, X], vehicles[i, Y], 0.5 * vehicles[i, WIDTH], ego,
        ego_half_length_m, ego_half_width_m,
    )  # fmt: skip
    strongest = strongest_interaction(
        lineup, i, leader, leader_m, line_m, people_m, ego_m, ego, vehicles[i, HEADING]
    )
    wanted = min(motion[i, WANTED_MPS], speed_ahead(rails, lineup, i))
    acceleration = max(idm_free(speed, wanted), -CLIP_MPS2) - strongest
    acceleration = min(max(acceleration, -CLIP_MPS2), CLIP_MPS2)
    if leader != NOBODY:
        # the model alone does not always keep bumpers apart, with room to stop in the next step
        free_m = leader_m - 0.5 * (lineup.length[i] + lineup.length[leader]) - BUMPER_M
        fastest = max(free_m, 0.0) / dt_s - 0.5 * speed
        acceleration = min(acceleration, (fastest - speed) / dt_s)
    return acceleration


@leaf_kernel
def _take_another_way(rails: Rails, seed: int, i: int, track: NDArray) -> None:
    """Choose anew where vehicle ``i`` goes at the end of its road, and after that."""
    rail, before = track[i, RAIL], track[i, NEXT_RAIL]
    for _ in range(4):
        track[i, NEXT_RAIL] = choose_way(rails, rail, seed, i, track[i, CHOICES])
        track[i, CHOICES] += 1
        if track[i, NEXT_RAIL] != before:
            break
    track[i, AFTER_RAIL] = choose_way(rails, track[i, NEXT_RAIL], seed, i, track[i, CHOICES])
    track[i, CHOICES] += 1


@leaf_kernel
def _move(
    rails: Rails,
    dt_s: float,
    seed: int,
    lineup: Lineup,
    i: int,
    acceleration: float,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
) -> None:
    """Move vehicle ``i`` along its rails and write its row."""
    before = vehicles[i, SPEED]
    speed = snap(max(before + acceleration * dt_s, 0.0), PER_UNIT)
    motion[i, STATION] += 0.5 * (before + speed) * dt_s
    rail = track[i, RAIL]
    if motion[i, STATION] >= rails.length[rail] and track[i, NEXT_RAIL] >= 0:
        motion[i, STATION] -= rails.length[rail]
        track[i, LAST_RAIL] = rail
        rail = track[i, RAIL] = track[i, NEXT_RAIL]
        track[i, NEXT_RAIL] = track[i, AFTER_RAIL]
        if track[i, NEXT_RAIL] >= 0:
            way = choose_way(rails, track[i, NEXT_RAIL], seed, i, track[i, CHOICES])
            track[i, AFTER_RAIL] = way
            track[i, CHOICES] += 1
        track[i, ADMITTED] = 0
        motion[i, WAITED_S] = 0.0
    elif motion[i, STATION] > rails.length[rail]:
        motion[i, STATION], speed = rails.length[rail], 0.0
    x, y, heading = rail_pose(rails, rail, motion[i, STATION])
    write_row(vehicles[i], x, y, heading, speed)


@leaf_kernel
def clear_crossings(
    rails: Rails, lineup: Lineup, i: int, last_rail: int, reach_m: float, threatened: NDArray
) -> None:
    """Mark the crossings that driver ``i`` is on or could no longer stop before.

    Args:
        rails: The town's rails.
        lineup: Drivers.
        i: Which one.
        last_rail: The rail it came from, or -1.
        reach_m: Metres ahead of its front within which it could not stop.
        threatened: (C,) uint8 output; only ever set.
    """
    rail, half = lineup.rail[i], 0.5 * lineup.length[i]
    low_m, high_m = lineup.station[i] - half - 1.0, lineup.station[i] + half + reach_m + 1.0
    _mark_between(rails, rail, low_m, high_m, threatened)
    if lineup.onward[i] >= 0 and high_m > rails.length[rail]:
        length = rails.length[rail]
        _mark_between(rails, lineup.onward[i], low_m - length, high_m - length, threatened)
    if last_rail >= 0 and low_m < 0.0:
        length = rails.length[last_rail]
        _mark_between(rails, last_rail, low_m + length, high_m + length, threatened)


@leaf_kernel
def _mark_between(
    rails: Rails, rail: int, low_m: float, high_m: float, threatened: NDArray
) -> None:
    for k in range(rails.crossing_first[rail], rails.crossing_first[rail + 1]):
        if low_m <= rails.crossings[k, CROSSING_M] <= high_m:
            threatened[int(rails.crossings[k, CROSSING])] = 1


@leaf_kernel
def stopping_distance(speed_mps: float) -> float:
    """Metres in which any driver can come to a stop without haste."""
    return 0.5 * speed_mps + speed_mps * speed_mps / (2.0 * 2.0)
