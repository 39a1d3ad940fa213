"""One step of all that moves but the ego: signals, vehicles, pedestrians."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .hazards import leader_ahead, line_ahead, people_ahead
from .idm import JAM_GAP_M, idm_interaction
from .jit import kernel
from .layout import HEADING, LAST_RAIL, SPEED, STOPPED_S, X, Y
from .lineup import NOBODY, Lineup, empty_lineup, line_up
from .noise import mix
from .pedestrians import mark_occupied, step_pedestrians
from .rails import Rails
from .signals import SignalPlan, show_signals
from .vehicles import clear_crossings, step_vehicles, stopping_distance
from .walks import Crossings, Walks

PEOPLE = 0x9E0B1E
"""Keeps pedestrians' random numbers apart from all others of the episode."""
NEAR_M = 10.0
"""Whoever stands this near to something to wait for is waiting for it."""


@kernel
def step_traffic(
    rails: Rails,
    walks: Walks,
    crossings: Crossings,
    plan: SignalPlan,
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
        dt_s: Seconds.
        half_length_m: Half the ego's length.
        half_width_m: Half its width.
        running: (N,) bool.
        episode_seed: (N,).
        steps: (N,) control steps since reset.
        ego: (N, 4).
        progress: (N, 5).
        timers: (N, 2).
        route_rails: (N, K) rails along each ego's route.
        route_rail_m: (N, K) route position at which each begins.
        route_rail_count: (N,) how many are valid.
        vehicles: (N, V, 6).
        track: (N, V, 6).
        motion: (N, V, 3).
        pedestrians: (N, P, 6).
        pedestrian_track: (N, P, ...).
        pedestrian_motion: (N, P, ...).
        signals: (N, S) uint8.
        waiting: (N,) bool output, whether the ego has something to wait for.
    """
    count, people = vehicles.shape[1], pedestrians.shape[1]
    lineup = empty_lineup(count + 1, rails.length.shape[0])
    accelerations = np.empty(count)
    places = crossings.length.shape[0]
    occupied, threatened = np.zeros((places, 2), np.uint8), np.zeros(places, np.uint8)
    for n in range(ego.shape[0]):
        if not running[n]:
            continue
        if plan.phase.shape[0]:
            show_signals(plan, (steps[n] + 1) * dt_s, episode_seed[n], signals[n])
        occupied[:] = 0
        if people:
            mark_occupied(crossings, pedestrian_track[n], pedestrian_motion[n], occupied)
        line_up(
            rails, vehicles[n], track[n], motion[n], ego[n], 2.0 * half_length_m,
            timers[n, STOPPED_S], progress[n], route_rails[n], route_rail_m[n],
            route_rail_count[n], lineup,
        )  # fmt: skip
        waiting[n] = has_to_wait(rails, lineup, count, signals[n], occupied)
        step_vehicles(
            rails, dt_s, episode_seed[n], signals[n], occupied, ego[n], half_length_m,
            half_width_m, lineup, accelerations, vehicles[n], track[n], motion[n],
        )  # fmt: skip
        if people:
            threatened[:] = 0
            for i in range(count + 1):
                if lineup.rail[i] >= 0:
                    last = track[n, i, LAST_RAIL] if i < count else NOBODY
                    reach_m = stopping_distance(lineup.speed[i])
                    clear_crossings(rails, lineup, i, last, reach_m, threatened)
            threaten_by_ego(crossings, ego[n], half_length_m, threatened)
            step_pedestrians(
                walks, crossings, dt_s, mix(episode_seed[n], PEOPLE), signals[n], threatened,
                ego[n], half_length_m, half_width_m, vehicles[n], pedestrians[n],
                pedestrian_track[n], pedestrian_motion[n],
            )  # fmt: skip


@kernel
def has_to_wait(rails: Rails, lineup: Lineup, i: int, signals: NDArray, occupied: NDArray) -> bool:
    """Whether a leader, a line or people within 10 m of its front keep driver ``i`` from going."""
    if lineup.rail[i] < 0:
        return False
    line_m, _ = line_ahead(rails, lineup, i, signals, occupied)
    if min(line_m, people_ahead(rails, lineup, i, occupied)) < NEAR_M:
        return True
    leader, leader_m = leader_ahead(rails, lineup, i)
    return leader != NOBODY and leader_m - 0.5 * (lineup.length[i] + lineup.length[leader]) < NEAR_M


@kernel
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


@kernel
def ego_allowance(
    rails: Rails,
    crossings: Crossings,
    half_length_m: float,
    ego: NDArray,
    progress: NDArray,
    timers: NDArray,
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
    lineup = empty_lineup(count + 1, rails.length.shape[0])
    occupied = np.zeros((crossings.length.shape[0], 2), np.uint8)
    mark_occupied(crossings, pedestrian_track, pedestrian_motion, occupied)
    line_up(
        rails, vehicles, track, motion, ego, 2.0 * half_length_m, timers[STOPPED_S], progress,
        route_rails, route_rail_m, route_rail_count, lineup,
    )  # fmt: skip
    if lineup.rail[count] < 0:
        return 0.0
    speed = lineup.speed[count]
    strongest = 0.0
    leader, leader_m = leader_ahead(rails, lineup, count)
    if leader != NOBODY:
        jam_m = JAM_GAP_M + 0.5 * (lineup.length[count] + lineup.length[leader])
        strongest = idm_interaction(speed, leader_m, jam_m, speed - lineup.speed[leader])
    line_m, _ = line_ahead(rails, lineup, count, signals, occupied)
    if line_m < math.inf:
        strongest = max(strongest, idm_interaction(speed, line_m, 1.0, speed))
    people_m = people_ahead(rails, lineup, count, occupied)
    if people_m < math.inf:
        strongest = max(strongest, idm_interaction(speed, max(people_m, 0.0), 0.8, speed))
    return strongest
