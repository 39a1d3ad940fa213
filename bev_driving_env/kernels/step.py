"""One control step of every world: the only place where simulated time passes."""

from __future__ import annotations

from numpy.typing import NDArray

from .detect import is_against_traffic, is_deviating, is_off_road, is_standing
from .dynamics import advance, braked, sway
from .jit import kernel
from .layout import (
    ACCELERATION,
    BLOCKED,
    COLLISION_STATIC,
    DISTANCE,
    HEADING,
    OFF_ROAD,
    ROUTE_DEVIATION,
    ROUTE_DONE,
    SPEED,
    STEERING,
    STOPPED_S,
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


@kernel
def current_infractions(
    physics: Physics,
    classes: NDArray,
    classes_grid: RasterGrid,
    directions: NDArray,
    directions_grid: RasterGrid,
    solids: NDArray,
    solid_start: NDArray,
    solid_items: NDArray,
    solid_grid: SolidGrid,
    ego: NDArray,
    progress: NDArray,
    timers: NDArray,
) -> int:
    """Advance one world's timers by a physics step and return the infractions that hold now."""
    holding = 0
    rounding_s = 0.5 * physics.dt_s  # timers add up many small steps
    if is_off_road(classes, classes_grid, ego, physics.half_length_m, physics.half_width_m):
        holding |= OFF_ROAD
    if hits_any(
        solids,
        solid_start,
        solid_items,
        solid_grid,
        ego,
        physics.half_length_m,
        physics.half_width_m,
    ):
        holding |= COLLISION_STATIC
    if is_deviating(progress[DISTANCE], physics.deviation_m):
        holding |= ROUTE_DEVIATION
    if is_against_traffic(directions, directions_grid, ego):
        timers[WRONG_LANE_S] += physics.dt_s
    else:
        timers[WRONG_LANE_S] = 0.0
    if timers[WRONG_LANE_S] > physics.wrong_lane_after_s + rounding_s:
        holding |= WRONG_LANE
    if is_standing(ego, physics.blocked_speed_mps):
        timers[STOPPED_S] += physics.dt_s
    else:
        timers[STOPPED_S] = 0.0
    if timers[STOPPED_S] > physics.blocked_after_s + rounding_s:
        holding |= BLOCKED
    return holding


@kernel
def step_worlds(
    physics: Physics,
    classes: NDArray,
    classes_grid: RasterGrid,
    directions: NDArray,
    directions_grid: RasterGrid,
    solids: NDArray,
    solid_start: NDArray,
    solid_items: NDArray,
    solid_grid: SolidGrid,
    running: NDArray,
    actions: NDArray,
    ego: NDArray,
    command: NDArray,
    route_points: NDArray,
    route_size: NDArray,
    route_spacing: NDArray,
    route_length: NDArray,
    progress: NDArray,
    timers: NDArray,
    attitude: NDArray,
    holding: NDArray,
    steps: NDArray,
    returns: NDArray,
    began: NDArray,
    success: NDArray,
    reward_terms: NDArray,
    rewards: NDArray,
) -> None:
    """Advance every running world by one control step, in place.

    Args:
        physics: Constants.
        classes: Raster of static classes (rows, columns) uint8.
        classes_grid: Where it lies.
        directions: Raster of lane directions (rows, columns) uint8.
        directions_grid: Where it lies.
        solids: (F, 5) footprints of furniture (``towns.solids``), likewise the next three.
        solid_start: (cells + 1,).
        solid_items: (M,).
        solid_grid: Where the cells lie.
        running: (N,) bool; a world that is not running keeps its state.
        actions: (N, 2) in [-1, 1]: acceleration, steering.
        ego: (N, 4).
        command: (N, 2), the previous action; becomes this one.
        route_points: (N, R, 4).
        route_size: (N,) valid points.
        route_spacing: (N,) metres between points.
        route_length: (N,) metres.
        progress: (N, 5).
        timers: (N, 2).
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
            advance(car, acceleration, steering, physics.half_length_m, physics.dt_s)
            lateral = speed * (car[HEADING] - heading) / physics.dt_s
            sway(attitude[n], (car[SPEED] - speed) / physics.dt_s, lateral, physics.dt_s)
            update_progress(car, points, size, route_spacing[n], progress[n])
            now = current_infractions(
                physics,
                classes,
                classes_grid,
                directions,
                directions_grid,
                solids,
                solid_start,
                solid_items,
                solid_grid,
                car,
                progress[n],
                timers[n],
            )
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
