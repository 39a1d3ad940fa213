"""Filling faces in an image, the nearest one in front."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .shapes import MARK, MOST_CORNERS, SIZE, Records
from .view import NEAR_M, View


class Canvas(NamedTuple):
    """Buffers of one image, used again for the next.

    Attributes:
        nearness: (H, W) float32 inverse depth of the face seen; 0 where there is none.
        face: (H, W) int32, number of the face seen; 0 for none.
        shadow: (H, W) uint8, 1 where the ground lies in shadow, 2 under a vehicle.
        flat_nearness: (H * W,) view of ``nearness``.
        flat_face: (H * W,) view of ``face``.
        flat_shadow: (H * W,) view of ``shadow``.
        outline: (2 * MOST_CORNERS, 2) scratch: corners in the image, clipped.
        edges: (2, H) scratch: where a polygon begins and ends in each row.
        spans: (2, H) scratch: first column covered and the one after the last.
    """

    nearness: NDArray[np.float32]
    face: NDArray[np.int32]
    shadow: NDArray[np.uint8]
    flat_nearness: NDArray[np.float32]
    flat_face: NDArray[np.int32]
    flat_shadow: NDArray[np.uint8]
    outline: NDArray[np.float64]
    edges: NDArray[np.float64]
    spans: NDArray[np.int32]


def new_canvas(height: int, width: int) -> Canvas:
    """Buffers for images of height by width."""
    nearness = np.zeros((height, width), np.float32)
    face = np.zeros((height, width), np.int32)
    shadow = np.zeros((height, width), np.uint8)
    return Canvas(
        nearness,
        face,
        shadow,
        nearness.reshape(-1),
        face.reshape(-1),
        shadow.reshape(-1),
        np.zeros((2 * MOST_CORNERS, 2)),
        np.zeros((2, height)),
        np.zeros((2, height), np.int32),
    )


@leaf_kernel
def outline_of(view: View, corners: NDArray, number: int, count: int, outline: NDArray) -> int:
    """Cut a polygon (camera frame) at the near plane and project it.

    Args:
        view: The camera.
        corners: (M, 8, 3) right, down, forward.
        number: Which polygon.
        count: Number of corners.
        outline: (16, 2) output, columns and rows.

    Returns:
        Number of corners of the outline.
    """
    kept = 0
    previous = count - 1
    for k in range(count):
        z0, z1 = corners[number, previous, 2], corners[number, k, 2]
        if (z0 >= NEAR_M) != (z1 >= NEAR_M):
            share = (NEAR_M - z0) / (z1 - z0)
            x = corners[number, previous, 0] + share * (
                corners[number, k, 0] - corners[number, previous, 0]
            )
            y = corners[number, previous, 1] + share * (
                corners[number, k, 1] - corners[number, previous, 1]
            )
            outline[kept, 0] = view.center_u + view.focal_px * x / NEAR_M
            outline[kept, 1] = view.center_v + view.focal_px * y / NEAR_M
            kept += 1
        if z1 >= NEAR_M:
            outline[kept, 0] = view.center_u + view.focal_px * corners[number, k, 0] / z1
            outline[kept, 1] = view.center_v + view.focal_px * corners[number, k, 1] / z1
            kept += 1
        previous = k
    return kept


@leaf_kernel
def fill_spans(
    view: View, outline: NDArray, count: int, edges: NDArray, spans: NDArray
) -> tuple[int, int]:
    """Find the columns that a projected convex polygon covers in each row.

    Args:
        view: The camera.
        outline: (>= count, 2) corners as column, row.
        count: Number of corners.
        edges: (2, H) scratch.
        spans: (2, H) output: first column and the one after the last.

    Returns:
        First row and the row after the last; equal if nothing is visible.
    """
    top, bottom = math.inf, -math.inf
    left, right = math.inf, -math.inf
    for k in range(count):
        left = min(left, outline[k, 0])
        right = max(right, outline[k, 0])
        top = min(top, outline[k, 1])
        bottom = max(bottom, outline[k, 1])
    if bottom < 0.0 or right < 0.0 or top > view.height - 1.0 or left > view.width - 1.0:
        return 0, 0
    first = max(0, math.ceil(top))
    stop = min(view.height - 1, math.floor(bottom)) + 1
    if stop <= first:
        return 0, 0
    # slices, and rows counted from the first: an index that cannot be negative lets loops vectorise
    lows, highs = edges[0, first:stop], edges[1, first:stop]
    for row in range(stop - first):
        lows[row], highs[row] = math.inf, -math.inf
    previous = count - 1
    for k in range(count):
        low, high = previous, k
        if outline[low, 1] > outline[high, 1]:
            low, high = high, low
        rise = outline[high, 1] - outline[low, 1]
        if rise > 0.0:
            slope = (outline[high, 0] - outline[low, 0]) / rise
            begin = max(math.ceil(max(outline[low, 1], -1.0)), first)
            end = min(math.floor(min(outline[high, 1], view.height)) + 1, stop)
            column = outline[low, 0] + (begin - outline[low, 1]) * slope
            for step in range(end - begin):
                row = np.uint64(begin - first + step)
                across = column + np.int32(step) * slope
                lows[row] = min(lows[row], across)
                highs[row] = max(highs[row], across)
        previous = k
    begins, ends = spans[0, first:stop], spans[1, first:stop]
    last = view.width - 1.0
    for row in range(stop - first):
        begins[row] = np.int32(math.ceil(min(max(lows[row], 0.0), last + 1.0)))
        ends[row] = np.int32(math.floor(min(max(highs[row], -1.0), last))) + np.int32(1)
    return first, stop


@leaf_kernel
def fill_face(
    view: View,
    corners: NDArray,
    number: int,
    first: int,
    stop: int,
    spans: NDArray,
    seen: NDArray,
    faces: NDArray,
) -> None:
    """Write a face where it is nearer than what is there already.

    Args:
        view: The camera.
        corners: (M, 8, 3), see ``Records``.
        number: Which face.
        first: First row.
        stop: Row after the last.
        spans: (2, H), see ``fill_spans``.
        seen: (H * W,) inverse depths.
        faces: (H * W,) face numbers.
    """
    x0, y0, z0 = corners[number, 0, 0], corners[number, 0, 1], corners[number, 0, 2]
    # plane through three corners; 1 / depth is linear in the image
    ux, uy, uz = (
        corners[number, 1, 0] - x0,
        corners[number, 1, 1] - y0,
        corners[number, 1, 2] - z0,
    )
    vx, vy, vz = (
        corners[number, 2, 0] - x0,
        corners[number, 2, 1] - y0,
        corners[number, 2, 2] - z0,
    )
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    offset = nx * x0 + ny * y0 + nz * z0
    if abs(offset) < 1e-9:
        return
    per_u = nx / (offset * view.focal_px)
    per_v = ny / (offset * view.focal_px)
    base = nz / offset - per_u * view.center_u - per_v * view.center_v
    slope, name = np.float32(per_u), np.int32(number)
    for row in range(first, stop):
        begin, end = spans[0, row], spans[1, row]
        start = np.float32(base + per_v * row + per_u * begin)
        where = row * view.width + begin
        for k in range(end - begin):
            # unsigned: an index that cannot be negative is needed for the loop to vectorise
            i = np.uint64(where + k)
            nearness = start + slope * np.float32(np.int32(k))
            nearer = nearness > seen[i]
            seen[i] = nearness if nearer else seen[i]
            faces[i] = name if nearer else faces[i]


@leaf_kernel
def fill_shadow(
    width: int, mark: int, first: int, stop: int, spans: NDArray, shadow: NDArray
) -> None:
    """Mark spans (2, H) in a shadow mask (H * W,)."""
    bit = np.uint8(mark)
    for row in range(first, stop):
        begin, end = spans[0, row], spans[1, row]
        where = row * width + begin
        for k in range(end - begin):
            i = np.uint64(where + k)
            shadow[i] = np.uint8(shadow[i] | bit)


@leaf_kernel
def fill_faces(
    view: View, canvas: Canvas, records: Records, first_face: int, last_face: int
) -> None:
    """Clear the canvas, then fill the faces and shadows of one image, ``last_face`` excluded."""
    seen, faces, shadow = canvas.flat_nearness, canvas.flat_face, canvas.flat_shadow
    outline, edges, spans = canvas.outline, canvas.edges, canvas.spans
    corners, table = records.corners, records.table
    seen[:] = np.float32(0.0)
    faces[:] = np.int32(0)
    shadow[:] = np.uint8(0)
    for number in range(first_face, last_face):
        kept = outline_of(view, corners, number, int(table[number, SIZE]), outline)
        if kept < 3:
            continue
        first, stop = fill_spans(view, outline, kept, edges, spans)
        mark = int(table[number, MARK])
        if stop <= first:
            continue
        if mark > 0:
            fill_shadow(view.width, mark, first, stop, spans, shadow)
        else:
            fill_face(view, corners, number, first, stop, spans, seen, faces)
