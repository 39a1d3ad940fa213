"""One control step of every ego: the only place where its simulated time passes."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy.typing import NDArray

from .detect import (
    NONE,
    actor_hit,
    is_against_traffic,
    is_deviating,
    is_off_road,
    is_standing,
    red_line_crossed,
)
from .dynamics import advance, braked, sway
from .jit import leaf_kernel
from .layout import (
    ACCELERATION,
    BLOCKED,
    BLOCKED_S,
    COLLISION_PEDESTRIAN,
    COLLISION_STATIC,
    COLLISION_VEHICLE,
    DISTANCE,
    HEADING,
    INVOLVED_PEDESTRIAN,
    INVOLVED_SIGNAL,
    INVOLVED_VEHICLE,
    OFF_ROAD,
    OUTSIDE_M,
    PEDESTRIAN_HOLD_S,
    RED_LIGHT,
    ROUTE_DEVIATION,
    ROUTE_DONE,
    SPEED,
    STATIC_HOLD_S,
    STEERING,
    STOPPED_S,
    TRAVELLED_M,
    VEHICLE_HOLD_S,
    WRONG_LANE,
    WRONG_LANE_S,
    Physics,
    RasterGrid,
    X,
    Y,
)
from .overlap import SolidGrid, hits_any
from .progress import update_progress
from .reward import fill_reward_terms

CONTACT_HOLD_S = 2.0
"""Touching again within this time is still the same collision."""


class Ground(NamedTuple):
    """What a town's ground is and what stands on it.

    Attributes:
        classes: Raster of static classes (rows, columns) uint8.
        classes_grid: Where it lies.
        directions: Raster of lane directions (rows, columns) uint8.
        directions_grid: Where it lies.
        solids: (F, 5) footprints of furniture (``towns.solids``), likewise the next three.
        solid_start: (cells + 1,).
        solid_items: (M,).
        solid_grid: Where the cells lie.
        stop_lines: (S, 4) end points x1, y1, x2, y2 of the signals' stop lines.
    """

    classes: NDArray
    classes_grid: RasterGrid
    directions: NDArray
    directions_grid: RasterGrid
    solids: NDArray
    solid_start: NDArray
    solid_items: NDArray
    solid_grid: SolidGrid
    stop_lines: NDArray


@leaf_kernel
def current_infractions(
    physics: Physics,
    ground: Ground,
    ego: NDArray,
    front_x: float,
    front_y: float,
    moved_m: float,
    progress: NDArray,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
    waiting: bool,
    timers: NDArray,
    travelled: NDArray,
    involved: NDArray,
) -> int:
    """Advance one world's timers by a physics step and return the infractions that hold now.

    Args:
        physics: Constants.
        ground: The town.
        ego: (4,).
        front_x: World x of the middle of the front bumper before this physics step.
        front_y: World y of it.
        moved_m: Metres driven in it.
        progress: (5,).
        vehicles: (V, 6).
        pedestrians: (P, 6).
        signals: (S,).
        waiting: Whether the ego has something to wait for.
        timers: (6,).
        travelled: (2,).
        involved: (3,).
    """
    holding = 0
    dt, half_length, half_width = physics.dt_s, physics.half_length_m, physics.half_width_m
    rounding_s = 0.5 * dt  # timers add up many small steps
    off_road = is_off_road(ground.classes, ground.classes_grid, ego, half_length, half_width)
    against = is_against_traffic(ground.directions, ground.directions_grid, ego)
    travelled[TRAVELLED_M] += moved_m
    if off_road or against:
        travelled[OUTSIDE_M] += moved_m
    if off_road:
        holding |= OFF_ROAD
    if is_deviating(progress[DISTANCE], physics.deviation_m):
        holding |= ROUTE_DEVIATION
    timers[WRONG_LANE_S] = timers[WRONG_LANE_S] + dt if against else 0.0
    if timers[WRONG_LANE_S] > physics.wrong_lane_after_s + rounding_s:
        holding |= WRONG_LANE
    if is_standing(ego, physics.blocked_speed_mps):
        timers[STOPPED_S] += dt
        if not waiting:
            timers[BLOCKED_S] += dt
    else:
        timers[STOPPED_S] = timers[BLOCKED_S] = 0.0
    if timers[BLOCKED_S] > physics.blocked_after_s + rounding_s:
        holding |= BLOCKED
    vehicle = actor_hit(ego, half_length, half_width, vehicles)
    if vehicle != NONE:
        involved[INVOLVED_VEHICLE] = vehicle
    if _still_touching(timers, VEHICLE_HOLD_S, vehicle != NONE, dt):
        holding |= COLLISION_VEHICLE
    pedestrian = actor_hit(ego, half_length, half_width, pedestrians)
    if pedestrian != NONE:
        involved[INVOLVED_PEDESTRIAN] = pedestrian
    if _still_touching(timers, PEDESTRIAN_HOLD_S, pedestrian != NONE, dt):
        holding |= COLLISION_PEDESTRIAN
    static = hits_any(
        ground.solids, ground.solid_start, ground.solid_items, ground.solid_grid, ego,
        half_length, half_width,
    )  # fmt: skip
    if _still_touching(timers, STATIC_HOLD_S, static, dt):
        holding |= COLLISION_STATIC
    now_x = ego[X] + half_length * math.cos(ego[HEADING])
    now_y = ego[Y] + half_length * math.sin(ego[HEADING])
    signal = red_line_crossed(ground.stop_lines, signals, front_x, front_y, now_x, now_y)
    if signal != NONE:
        involved[INVOLVED_SIGNAL] = signal
        holding |= RED_LIGHT
    return holding


@leaf_kernel
def _still_touching(timers: NDArray, timer: int, touching: bool, dt_s: float) -> bool:
    """Whether a contact, or the last one shortly after it, holds."""
    if touching:
        timers[timer] = CONTACT_HOLD_S
        return True
    timers[timer] = max(timers[timer] - dt_s, 0.0)
    return timers[timer] > 0.5 * dt_s


@leaf_kernel
def step_worlds(
    physics: Physics,
    ground: Ground,
    running: NDArray,
    actions: NDArray,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
    waiting: NDArray,
    ego: NDArray,
    command: NDArray,
    route_points: NDArray,
    route_size: NDArray,
    route_spacing: NDArray,
    route_length: NDArray,
    progress: NDArray,
    timers: NDArray,
    travelled: NDArray,
    involved: NDArray,
    attitude: NDArray,
    holding: NDArray,
    steps: NDArray,
    returns: NDArray,
    began: NDArray,
    success: NDArray,
    reward_terms: NDArray,
    rewards: NDArray,
) -> None:
    """Advance every running world's ego by one control step, in place.

    Args:
        physics: Constants.
        ground: The town.
        running: (N,) bool; a world that is not running keeps its state.
        actions: (N, 2) in [-1, 1]: acceleration, steering.
        vehicles: (N, V, 6).
        pedestrians: (N, P, 6).
        signals: (N, S).
        waiting: (N,) bool.
        ego: (N, 4).
        command: (N, 2), the previous action; becomes this one.
        route_points: (N, R, 4).
        route_size: (N,) valid points.
        route_spacing: (N,) metres between points.
        route_length: (N,) metres.
        progress: (N, 5).
        timers: (N, 6).
        travelled: (N, 2).
        involved: (N, 3).
        attitude: (N, 2).
        holding: (N,) infraction bits that hold.
        steps: (N,) control steps since reset.
        returns: (N,) sum of rewards since reset.
        began: (N,) output, infraction bits that began in this step.
        success: (N,) output, whether the route is complete.
        reward_terms: (N, 5) output.
        rewards: (N,) output, their sums.
    """
    for n in range(ego.shape[0]):
        began[n] = 0
        if not running[n]:
            continue
        car, points, size = ego[n], route_points[n], route_size[n]
        done_before = progress[n, ROUTE_DONE]
        steering = actions[n, STEERING] * physics.max_steering_rad
        for _ in range(physics.substeps):
            acceleration = braked(
                actions[n, ACCELERATION] * physics.max_acceleration_mps2,
                car[SPEED],
                physics.speed_limit_mps,
                physics.dt_s,
            )
            speed, heading = car[SPEED], car[HEADING]
            front_x = car[X] + physics.half_length_m * math.cos(heading)
            front_y = car[Y] + physics.half_length_m * math.sin(heading)
            advance(car, acceleration, steering, physics.half_length_m, physics.dt_s)
            lateral = speed * (car[HEADING] - heading) / physics.dt_s
            sway(attitude[n], (car[SPEED] - speed) / physics.dt_s, lateral, physics.dt_s)
            update_progress(car, points, size, route_spacing[n], progress[n])
            now = current_infractions(
                physics, ground, car, front_x, front_y, speed * physics.dt_s, progress[n],
                vehicles[n], pedestrians[n], signals[n], waiting[n], timers[n], travelled[n],
                involved[n],
            )  # fmt: skip
            began[n] |= now & ~holding[n]
            holding[n] = now
        fill_reward_terms(
            physics, done_before, progress[n], command[n], actions[n], began[n], reward_terms[n]
        )
        command[n, ACCELERATION] = actions[n, ACCELERATION]
        command[n, STEERING] = actions[n, STEERING]
        steps[n] += 1
        rewards[n] = reward_terms[n].sum()
        returns[n] += rewards[n]
        end_x = points[size - 1, X] - car[X]
        end_y = points[size - 1, Y] - car[Y]
        near = end_x * end_x + end_y * end_y < physics.success_distance_m**2
        done = progress[n, ROUTE_DONE] >= physics.success_fraction * route_length[n]
        success[n] = near and done
