"""One step of all that moves but the ego: signals, vehicles, pedestrians."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .crossing import mark_occupied
from .crowd import Crowd, empty_crowd
from .hazards import leader_ahead, line_ahead, people_ahead, strongest_interaction
from .jit import leaf_kernel
from .layout import HEADING, LAST_RAIL, SPEED, STOPPED_S, X, Y
from .lineup import ENDS, METRES, NOBODY, NUMBERS, Lineup, line_up, lineup_in
from .noise import mix
from .pedestrians import step_pedestrians
from .rails import Rails
from .signals import SignalPlan, show_signals
from .vehicles import clear_crossings, step_vehicles, stopping_distance
from .walks import Crossings, Walks

PEOPLE = 0x9E0B1E
"""Keeps pedestrians' random numbers apart from all others of the episode."""
SLOW_MPS = 1.0
NEAR_M = 10.0
"""Whoever stands this near to something to wait for is waiting for it."""


class Workspace(NamedTuple):
    """Room to work in, made once: what is in it between steps means nothing.

    Attributes:
        numbers: For the line-up, likewise the next two.
        metres: See ``lineup_in``.
        ends: See ``lineup_in``.
        accelerations: (V,) what the vehicles have decided.
        occupied: (C, 2) uint8 halves of crossings with people on them.
        threatened: (C,) uint8 crossings that somebody could no longer stop before.
        crowd: For the pedestrians.
    """

    numbers: NDArray
    metres: NDArray
    ends: NDArray
    accelerations: NDArray
    occupied: NDArray
    threatened: NDArray
    crowd: Crowd


def make_workspace(vehicles: int, pedestrians: int, rails: int, crossings: int) -> Workspace:
    """Room for the traffic of one world at a time."""
    return Workspace(
        numbers=np.zeros((NUMBERS, vehicles + 1), np.int64),
        metres=np.zeros((METRES, vehicles + 1)),
        ends=np.zeros((ENDS, rails), np.int64),
        accelerations=np.zeros(vehicles),
        occupied=np.zeros((crossings, 2), np.uint8),
        threatened=np.zeros(crossings, np.uint8),
        crowd=empty_crowd(pedestrians),
    )


@leaf_kernel
def step_traffic(
    rails: Rails,
    walks: Walks,
    crossings: Crossings,
    plan: SignalPlan,
    work: Workspace,
    dt_s: float,
    half_length_m: float,
    half_width_m: float,
    running: NDArray,
    episode_seed: NDArray,
    steps: NDArray,
    ego: NDArray,
    progress: NDArray,
    timers: NDArray,
    route_rails: NDArray,
    route_rail_m: NDArray,
    route_rail_count: NDArray,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
    pedestrians: NDArray,
    pedestrian_track: NDArray,
    pedestrian_motion: NDArray,
    signals: NDArray,
    waiting: NDArray,
) -> None:
    """Advance the traffic of every running world by one control step, in place.

    All decide by what they see at its beginning: signals, each other, and the ego.

    Args:
        rails: The town's rails.
        walks: Its sidewalks.
        crossings: Its pedestrian crossings.
        plan: Its signals; with no phases (a plan of length 0) they stay as they are.
        work: Room to work in.
        dt_s: Seconds.
        half_length_m: Half the ego's length.
        half_width_m: Half its width.
        running: (N,) bool.
        episode_seed: (N,).
        steps: (N,) control steps since reset.
        ego: (N, 4).
        progress: (N, 5).
        timers: (N, 6).
        route_rails: (N, K) rails along each ego's route.
        route_rail_m: (N, K) route position at which each begins.
        route_rail_count: (N,) how many are valid.
        vehicles: (N, V, 6).
        track: (N, V, 6).
        motion: (N, V, 3).
        pedestrians: (N, P, 6).
        pedestrian_track: (N, P, 5).
        pedestrian_motion: (N, P, 11).
        signals: (N, S) uint8.
        waiting: (N,) bool, whether the ego has something to wait for; updated.
    """
    count, people = vehicles.shape[1], pedestrians.shape[1]
    lineup = lineup_in(work.numbers, work.metres, work.ends)
    occupied, threatened = work.occupied, work.threatened
    occupied[:] = 0  # nobody marks it where there are no pedestrians
    for n in range(ego.shape[0]):
        if not running[n]:
            continue
        if plan.phase.shape[0]:
            show_signals(plan, (steps[n] + 1) * dt_s, episode_seed[n], signals[n])
        if people:
            mark_occupied(crossings, pedestrian_track[n], pedestrian_motion[n], occupied)
        line_up(
            rails, vehicles[n], track[n], motion[n], ego[n], 2.0 * half_length_m,
            patience(timers[n], waiting[n]), progress[n], route_rails[n], route_rail_m[n],
            route_rail_count[n], lineup,
        )  # fmt: skip
        slow = ego[n, SPEED] < SLOW_MPS
        waiting[n] = slow and has_to_wait(rails, lineup, count, signals[n], occupied)
        step_vehicles(
            rails, dt_s, episode_seed[n], signals[n], occupied, ego[n], half_length_m,
            half_width_m, lineup, work.accelerations, vehicles[n], track[n], motion[n],
        )  # fmt: skip
        if people:
            threatened[:] = 0
            for i in range(count + 1):
                if lineup.rail[i] >= 0:
                    last = track[n, i, LAST_RAIL] if i < count else NOBODY
                    # the line-up is from before they moved
                    reach_m = stopping_distance(lineup.speed[i]) + lineup.speed[i] * dt_s
                    clear_crossings(rails, lineup, i, last, reach_m, threatened)
            threaten_by_ego(crossings, ego[n], half_length_m, threatened)
            step_pedestrians(
                walks, crossings, dt_s, mix(episode_seed[n], PEOPLE), signals[n], threatened,
                ego[n], half_length_m, half_width_m, vehicles[n], work.crowd, pedestrians[n],
                pedestrian_track[n], pedestrian_motion[n],
            )  # fmt: skip


@leaf_kernel
def patience(timers: NDArray, waiting: bool) -> float:
    """How long the ego has been standing because it had to (one that is parked starves nobody)."""
    return timers[STOPPED_S] if waiting else 0.0


@leaf_kernel
def has_to_wait(rails: Rails, lineup: Lineup, i: int, signals: NDArray, occupied: NDArray) -> bool:
    """Whether a leader, a line or people within 10 m of its front keep driver ``i`` from going."""
    if lineup.rail[i] < 0:
        return False
    line_m, _ = line_ahead(rails, lineup, i, signals, occupied)
    if min(line_m, people_ahead(rails, lineup, i, occupied)) < NEAR_M:
        return True
    leader, leader_m = leader_ahead(rails, lineup, i)
    return leader != NOBODY and leader_m - 0.5 * (lineup.length[i] + lineup.length[leader]) < NEAR_M


@leaf_kernel
def threaten_by_ego(
    crossings: Crossings, ego: NDArray, half_length_m: float, threatened: NDArray
) -> None:
    """Mark the crossings straight ahead of the ego, wherever it drives."""
    cos, sin = math.cos(ego[HEADING]), math.sin(ego[HEADING])
    reach_m = half_length_m + 1.0 + stopping_distance(ego[SPEED])
    for c in range(crossings.length.shape[0]):
        dx = 0.5 * (crossings.ends[c, 0] + crossings.ends[c, 2]) - ego[X]
        dy = 0.5 * (crossings.ends[c, 1] + crossings.ends[c, 3]) - ego[Y]
        ahead = dx * cos + dy * sin
        aside = abs(dy * cos - dx * sin)
        if -half_length_m - 1.0 < ahead < reach_m and aside < 0.5 * crossings.length[c] + 1.0:
            threatened[c] = 1


@leaf_kernel
def ego_allowance(
    rails: Rails,
    crossings: Crossings,
    work: Workspace,
    half_length_m: float,
    ego: NDArray,
    progress: NDArray,
    timers: NDArray,
    waiting: bool,
    route_rails: NDArray,
    route_rail_m: NDArray,
    route_rail_count: int,
    vehicles: NDArray,
    track: NDArray,
    motion: NDArray,
    pedestrian_track: NDArray,
    pedestrian_motion: NDArray,
    signals: NDArray,
) -> float:
    """What leaders, signals, people and junctions take off the ego's acceleration (m/s^2).

    The rules are those of the other vehicles; arguments are one world's of ``step_traffic``.
    """
    count = vehicles.shape[0]
    lineup, occupied = lineup_in(work.numbers, work.metres, work.ends), work.occupied
    mark_occupied(crossings, pedestrian_track, pedestrian_motion, occupied)
    line_up(
        rails, vehicles, track, motion, ego, 2.0 * half_length_m, patience(timers, waiting),
        progress, route_rails, route_rail_m, route_rail_count, lineup,
    )  # fmt: skip
    if lineup.rail[count] < 0:
        return 0.0
    leader, leader_m = leader_ahead(rails, lineup, count)
    line_m, _ = line_ahead(rails, lineup, count, signals, occupied)
    people_m = people_ahead(rails, lineup, count, occupied)
    return strongest_interaction(
        lineup, count, leader, leader_m, line_m, people_m, math.inf, ego, ego[HEADING]
    )
