"""Drawing the sparse route map: what a navigation system knows, seen from a noisy position fix."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .bev import to_pixel
from .jit import leaf_kernel
from .layout import HEADING, ROUTE_POSITION, Pose, Window, X, Y
from .noise import mix, normal

DISC_RADIUS_M = 2.0
NEXT_POINTS = 5
GPS_OFFSET_SIGMA_M = 0.55
"""Standard deviation per axis of the offset that stays for an episode."""
GPS_JITTER_SIGMA_M = 0.1
"""Standard deviation per axis of what each control step adds."""
DISC, MARKER = 255, 128
"""Brightness of a plan point in view, and of the direction to the first one out of view."""
PLAN_X, PLAN_Y, PLAN_STATION = 0, 1, 2

OFFSET_X, OFFSET_Y = 1, 2
JITTER = 6
"""Counter of the seed of the jitter; the two offsets use up 2 to 5."""


@leaf_kernel
def gps_offset(seed: int, step: int) -> tuple[float, float]:
    """World-frame error of the position fix: one offset per episode plus jitter per control step.

    Args:
        seed: Seed of the episode.
        step: Number of the control step.

    Returns:
        Offset (dx, dy) in metres by which all plan points of the frame are shifted.
    """
    jitter_seed = mix(seed, JITTER)
    return (
        GPS_OFFSET_SIGMA_M * normal(seed, OFFSET_X)
        + GPS_JITTER_SIGMA_M * normal(jitter_seed, 2 * step),
        GPS_OFFSET_SIGMA_M * normal(seed, OFFSET_Y)
        + GPS_JITTER_SIGMA_M * normal(jitter_seed, 2 * step + 1),
    )


@leaf_kernel
def brighten_disc(plane: NDArray, column: float, row: float, radius: float, value: int) -> None:
    """Raise every pixel (H, W) uint8 whose centre lies in a disc to at least a value.

    Args:
        plane: (H, W), written in place; parts of the disc outside it are skipped.
        column: Column of the centre.
        row: Row of the centre.
        radius: Radius in pixels; a centre exactly on the circle counts as inside.
        value: Brightness; brighter pixels keep theirs.
    """
    value8 = np.uint8(value)
    height, width = plane.shape
    for v in range(max(0, math.ceil(row - radius)), min(height - 1, math.floor(row + radius)) + 1):
        half = math.sqrt(max(0.0, radius * radius - (v - row) ** 2))
        begin = max(0, math.ceil(column - half))
        end = min(width - 1, math.floor(column + half))
        for u in range(begin, end + 1):
            plane[v, u] = max(plane[v, u], value8)


@leaf_kernel
def window_exit(window: Window, column: float, row: float) -> tuple[float, float]:
    """Pixel (column, row) where the line from the ego to a pixel outside leaves the window."""
    part, last = 1.0, window.size - 1.0
    du, dv = column - window.ego_column, row - window.ego_row
    # the ego is inside: a side that the point lies beyond is never parallel to the line
    if column < 0.0:
        part = min(part, -window.ego_column / du)
    elif column > last:
        part = min(part, (last - window.ego_column) / du)
    if row < 0.0:
        part = min(part, -window.ego_row / dv)
    elif row > last:
        part = min(part, (last - window.ego_row) / dv)
    return window.ego_column + part * du, window.ego_row + part * dv


@leaf_kernel
def draw_route_map(
    plane: NDArray,
    window: Window,
    plan: NDArray,
    size: int,
    position_m: float,
    pose: Pose,
    offset_x: float,
    offset_y: float,
) -> None:
    """Draw the next plan points as discs, up to the first one out of view.

    That one is drawn at half brightness where its direction meets the border.

    Args:
        plane: (size, size) uint8, drawn on.
        window: BEV window.
        plan: (P, 3) x, y and station of the plan points, in driving order.
        size: How many of them are valid.
        position_m: The ego's route position; points at or before it are passed.
        pose: The ego's true pose.
        offset_x: World-frame shift of all points in metres, as of a wrong position fix.
        offset_y: The same along y.
    """
    radius, last = DISC_RADIUS_M * window.px_per_m, window.size - 1.0
    first = 0
    while first < size and plan[first, PLAN_STATION] <= position_m:
        first += 1
    for k in range(first, min(first + NEXT_POINTS, size)):
        column, row = to_pixel(window, pose, plan[k, PLAN_X] + offset_x, plan[k, PLAN_Y] + offset_y)
        if column < 0.0 or row < 0.0 or column > last or row > last:
            column, row = window_exit(window, column, row)
            brighten_disc(plane, column, row, radius, MARKER)
            break
        brighten_disc(plane, column, row, radius, DISC)


@leaf_kernel
def render_route_maps(
    window: Window,
    selected: NDArray,
    ego: NDArray,
    progress: NDArray,
    plan_points: NDArray,
    plan_size: NDArray,
    seeds: NDArray,
    steps: NDArray,
    noisy: bool,
    maps: NDArray,
) -> None:
    """Render the route map of every selected world.

    Args:
        window: BEV window.
        selected: (N,) bool.
        ego: (N, 4).
        progress: (N, 5).
        plan_points: (N, P, 3) x, y and station.
        plan_size: (N,) number of valid plan points; 0 means no plan.
        seeds: (N,) int64 episode seeds.
        steps: (N,) int64 control steps since the episode began.
        noisy: Whether the position fix is as wrong as GPS.
        maps: (N, size, size) uint8 output, every pixel of selected worlds written.
    """
    for n in range(ego.shape[0]):
        if not selected[n]:
            continue
        heading = ego[n, HEADING]
        pose = Pose(ego[n, X], ego[n, Y], math.cos(heading), math.sin(heading))
        offset_x, offset_y = 0.0, 0.0
        if noisy:
            offset_x, offset_y = gps_offset(seeds[n], steps[n])
        maps[n] = 0
        draw_route_map(
            maps[n],
            window,
            plan_points[n],
            plan_size[n],
            progress[n, ROUTE_POSITION],
            pose,
            offset_x,
            offset_y,
        )
