"""Rendering the six BEV channels of every world."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fill import fill_convex
from .jit import kernel, leaf_kernel
from .layout import (
    DIRECTION_X,
    DIRECTION_Y,
    HEADING,
    LANE_BIT,
    LENGTH,
    ROAD_BIT,
    ROUTE_POSITION,
    SIGNAL_YELLOW,
    WIDTH,
    Pose,
    RasterGrid,
    Window,
    X,
    Y,
)
from .progress import route_pose

ROAD, ROUTE, LANE, VEHICLES, PEDESTRIANS, LIGHTS = range(6)
FRACTION = 16
"""Raster coordinates are integers with this many fractional bits."""


class Scratch(NamedTuple):
    """Buffers for views of one size, made once for all worlds.

    Attributes:
        columns: (size,) int32 offsets of a row's pixels in the raster, in fractions of a column.
        rows: (size,) likewise, in fractions of a row.
        offsets: (size,) int32 where its pixels lie in the flat raster.
        values: (size,) uint8 raster values.
        corner_columns: (4,) corners of a quad.
        corner_rows: (4,) see above.
        spans: (size, 2) see ``fill_convex``.
    """

    columns: NDArray[np.int32]
    rows: NDArray[np.int32]
    offsets: NDArray[np.int32]
    values: NDArray[np.uint8]
    corner_columns: NDArray[np.float64]
    corner_rows: NDArray[np.float64]
    spans: NDArray[np.float64]


@leaf_kernel
def sample_static(
    classes: NDArray,
    grid: RasterGrid,
    window: Window,
    pose: Pose,
    scratch: Scratch,
    road: NDArray,
    lane: NDArray,
) -> None:
    """Sample the road and lane planes from the static raster (nearest pixel), every pixel.

    Half of a step's time goes into this loop. Coordinates are 32-bit integers with 16 fractional
    bits, relative to the first pixel of each row; the loop over offsets vectorises, the one over
    loads does nothing else, and an unsigned index spares the check for negative ones.
    """
    height, width = classes.shape
    flat, stride, shift = classes.reshape(-1), np.int32(width), np.int32(FRACTION)
    size = window.size
    scale = grid.px_per_m / window.px_per_m * (1 << FRACTION)
    # one BEV column to the right moves by (-sin, cos) in the world, one row down by (-cos, -sin)
    dx, dy = int(round(-pose.sin * scale)), int(round(pose.cos * scale))
    columns, rows = scratch.columns, scratch.rows
    offsets, values = scratch.offsets, scratch.values
    for u in range(size):
        columns[u], rows[u] = u * dx, u * dy
    ahead, left = window.ego_row / window.px_per_m, window.ego_column / window.px_per_m
    per_m = grid.px_per_m * (1 << FRACTION)
    x = pose.x + ahead * pose.cos + left * pose.sin
    y = pose.y + ahead * pose.sin - left * pose.cos
    column0 = int(math.floor((x - grid.x0_m) * per_m))
    row0 = int(math.floor((y - grid.y0_m) * per_m))
    for v in range(size):
        column, row = column0 - v * dy, row0 + v * dx
        base_column, base_row = column >> FRACTION, row >> FRACTION
        part_column = np.int32(column - (base_column << FRACTION))
        part_row = np.int32(row - (base_row << FRACTION))
        last_column = (column + (size - 1) * dx) >> FRACTION
        last_row = (row + (size - 1) * dy) >> FRACTION
        if (
            min(base_column, last_column) >= 0
            and max(base_column, last_column) < width
            and min(base_row, last_row) >= 0
            and max(base_row, last_row) < height
        ):
            for u in range(size):
                r = np.int32(np.int32(part_row + rows[u]) >> shift)
                c = np.int32(np.int32(part_column + columns[u]) >> shift)
                offsets[u] = np.int32(np.int32(r * stride) + c)
            base = base_row * width + base_column
            for u in range(size):
                values[u] = flat[np.uint64(base + offsets[u])]
        else:
            for u in range(size):
                r = base_row + ((part_row + rows[u]) >> shift)
                c = base_column + ((part_column + columns[u]) >> shift)
                within = r >= 0 and c >= 0 and r < height and c < width
                values[u] = classes[r, c] if within else 0
        for u in range(size):
            # 0 - 1 wraps to 255
            road[v, u] = np.uint8(0) - (values[u] & np.uint8(ROAD_BIT))
            lane[v, u] = np.uint8(0) - ((values[u] & np.uint8(LANE_BIT)) >> np.uint8(1))


@leaf_kernel
def to_pixel(window: Window, pose: Pose, world_x: float, world_y: float) -> tuple[float, float]:
    """BEV pixel (column, row) of a world point, seen from the ego pose."""
    dx, dy = world_x - pose.x, world_y - pose.y
    ahead = dx * pose.cos + dy * pose.sin
    left = dx * pose.sin - dy * pose.cos
    return (
        window.ego_column - window.px_per_m * left,
        window.ego_row - window.px_per_m * ahead,
    )


@leaf_kernel
def draw_route(
    plane: NDArray,
    window: Window,
    points: NDArray,
    size: int,
    spacing_m: float,
    position_m: float,
    pose: Pose,
    scratch: Scratch,
) -> None:
    """Draw the planned lane centre from a route position to 80 m ahead as a band.

    Samples with the same direction are merged into one quad, so a straight costs one.
    """
    end_m = min(position_m + window.route_ahead_m, (size - 1) * spacing_m)
    half = window.route_half_width_m
    columns, rows, spans = scratch.corner_columns, scratch.corner_rows, scratch.spans
    px, py, dir_x, dir_y = route_pose(points, size, spacing_m, position_m)
    columns[0], rows[0] = to_pixel(window, pose, px + dir_y * half, py - dir_x * half)
    columns[1], rows[1] = to_pixel(window, pose, px - dir_y * half, py + dir_x * half)
    i = int(position_m / spacing_m) + 1
    while True:
        while (i + 1) * spacing_m < end_m and points[i + 1, DIRECTION_X] * dir_x + points[
            i + 1, DIRECTION_Y
        ] * dir_y > 1.0 - 1e-12:
            i += 1
        final = i * spacing_m >= end_m
        px, py, dir_x, dir_y = route_pose(points, size, spacing_m, min(i * spacing_m, end_m))
        columns[3], rows[3] = to_pixel(window, pose, px + dir_y * half, py - dir_x * half)
        columns[2], rows[2] = to_pixel(window, pose, px - dir_y * half, py + dir_x * half)
        fill_convex(plane, columns, rows, spans, 0, 255)
        if final:
            break
        columns[0], rows[0], columns[1], rows[1] = columns[3], rows[3], columns[2], rows[2]
        i += 1


@leaf_kernel
def draw_boxes(
    plane: NDArray,
    window: Window,
    boxes: NDArray,
    min_half_m: float,
    pose: Pose,
    scratch: Scratch,
) -> None:
    """Draw actor footprints (V, 6); rows of length 0 are empty slots."""
    columns, rows, spans = scratch.corner_columns, scratch.corner_rows, scratch.spans
    reach = (window.size * 1.5) / window.px_per_m
    for k in range(boxes.shape[0]):
        if boxes[k, LENGTH] <= 0.0:
            continue
        if abs(boxes[k, X] - pose.x) > reach or abs(boxes[k, Y] - pose.y) > reach:
            continue
        half_length = max(boxes[k, LENGTH] / 2.0, min_half_m)
        half_width = max(boxes[k, WIDTH] / 2.0, min_half_m)
        c, s = math.cos(boxes[k, HEADING]), math.sin(boxes[k, HEADING])
        for corner in range(4):
            ahead = half_length if corner < 2 else -half_length
            right = half_width if corner in (1, 2) else -half_width
            columns[corner], rows[corner] = to_pixel(
                window,
                pose,
                boxes[k, X] + ahead * c - right * s,
                boxes[k, Y] + ahead * s + right * c,
            )
        fill_convex(plane, columns, rows, spans, 0, 255)


@leaf_kernel
def draw_stop_lines(
    plane: NDArray,
    window: Window,
    stop_lines: NDArray,
    signals: NDArray,
    pose: Pose,
    scratch: Scratch,
) -> None:
    """Draw the stop lines (S, 4) whose signal (S,) is yellow or red."""
    columns, rows, spans = scratch.corner_columns, scratch.corner_rows, scratch.spans
    for k in range(stop_lines.shape[0]):
        if signals[k] < SIGNAL_YELLOW:
            continue
        c0, r0 = to_pixel(window, pose, stop_lines[k, 0], stop_lines[k, 1])
        c1, r1 = to_pixel(window, pose, stop_lines[k, 2], stop_lines[k, 3])
        length = math.sqrt((c1 - c0) ** 2 + (r1 - r0) ** 2)
        across_c = -(r1 - r0) / length * window.stop_line_half_px
        across_r = (c1 - c0) / length * window.stop_line_half_px
        columns[0], rows[0] = c0 + across_c, r0 + across_r
        columns[1], rows[1] = c1 + across_c, r1 + across_r
        columns[2], rows[2] = c1 - across_c, r1 - across_r
        columns[3], rows[3] = c0 - across_c, r0 - across_r
        fill_convex(plane, columns, rows, spans, 0, 255)


@kernel
def render_worlds(
    window: Window,
    classes: NDArray,
    grid: RasterGrid,
    stop_lines: NDArray,
    selected: NDArray,
    ego: NDArray,
    route_points: NDArray,
    route_size: NDArray,
    route_spacing: NDArray,
    progress: NDArray,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
    bev: NDArray,
) -> None:
    """Render the BEV of every selected world.

    Args:
        window: BEV window.
        classes: Static raster (rows, columns) uint8 with one bit per class.
        grid: Where it lies.
        stop_lines: (S, 4) end points x1, y1, x2, y2.
        selected: (N,) bool.
        ego: (N, 4).
        route_points: (N, R, 4).
        route_size: (N,); a size below 2 means no route.
        route_spacing: (N,) metres.
        progress: (N, 5).
        vehicles: (N, V, 6).
        pedestrians: (N, P, 6).
        signals: (N, S) uint8.
        bev: (N, 6, size, size) uint8 output, every pixel written.
    """
    size = window.size
    scratch = Scratch(
        np.empty(size, np.int32),
        np.empty(size, np.int32),
        np.empty(size, np.int32),
        np.empty(size, np.uint8),
        np.empty(4),
        np.empty(4),
        np.empty((size, 2)),
    )
    for n in range(ego.shape[0]):
        if not selected[n]:
            continue
        heading = ego[n, HEADING]
        pose = Pose(ego[n, X], ego[n, Y], math.cos(heading), math.sin(heading))
        sample_static(classes, grid, window, pose, scratch, bev[n, ROAD], bev[n, LANE])
        bev[n, ROUTE] = 0
        bev[n, VEHICLES:] = 0
        if route_size[n] >= 2:
            draw_route(
                bev[n, ROUTE],
                window,
                route_points[n],
                route_size[n],
                route_spacing[n],
                progress[n, ROUTE_POSITION],
                pose,
                scratch,
            )
        draw_boxes(bev[n, VEHICLES], window, vehicles[n], 0.0, pose, scratch)
        draw_boxes(
            bev[n, PEDESTRIANS], window, pedestrians[n], window.pedestrian_half_extent_m, pose,
            scratch,
        )  # fmt: skip
        draw_stop_lines(bev[n, LIGHTS], window, stop_lines, signals[n], pose, scratch)
