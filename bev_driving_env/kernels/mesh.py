"""Filling faces in an image, the nearest one in front."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import kernel
from .shapes import MOST_CORNERS, Records
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
        spans: (H, 2) scratch: columns covered in each row.
    """

    nearness: NDArray[np.float32]
    face: NDArray[np.int32]
    shadow: NDArray[np.uint8]
    flat_nearness: NDArray[np.float32]
    flat_face: NDArray[np.int32]
    flat_shadow: NDArray[np.uint8]
    outline: NDArray[np.float64]
    spans: NDArray[np.float64]


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
        np.zeros((height, 2)),
    )


@kernel
def outline_of(view: View, corners: NDArray, count: int, outline: NDArray) -> int:
    """Cut a polygon (camera frame) at the near plane and project it.

    Args:
        view: The camera.
        corners: (8, 3) right, down, forward.
        count: Number of corners.
        outline: (16, 2) output, columns and rows.

    Returns:
        Number of corners of the outline.
    """
    kept = 0
    previous = count - 1
    for k in range(count):
        z0, z1 = corners[previous, 2], corners[k, 2]
        if (z0 >= NEAR_M) != (z1 >= NEAR_M):
            share = (NEAR_M - z0) / (z1 - z0)
            x = corners[previous, 0] + share * (corners[k, 0] - corners[previous, 0])
            y = corners[previous, 1] + share * (corners[k, 1] - corners[previous, 1])
            outline[kept, 0] = view.center_u + view.focal_px * x / NEAR_M
            outline[kept, 1] = view.center_v + view.focal_px * y / NEAR_M
            kept += 1
        if z1 >= NEAR_M:
            outline[kept, 0] = view.center_u + view.focal_px * corners[k, 0] / z1
            outline[kept, 1] = view.center_v + view.focal_px * corners[k, 1] / z1
            kept += 1
        previous = k
    return kept


@kernel
def fill_spans(view: View, outline: NDArray, count: int, spans: NDArray) -> tuple[int, int]:
    """First and last column of a projected convex polygon in each row.

    Args:
        view: The camera.
        outline: (>= count, 2) corners as column, row.
        count: Number of corners.
        spans: (H, 2) output.

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
    first = max(0, int(math.ceil(top)))
    last = min(view.height - 1, int(math.floor(bottom)))
    if last < first:
        return 0, 0
    for row in range(first, last + 1):
        spans[row, 0], spans[row, 1] = math.inf, -math.inf
    previous = count - 1
    for k in range(count):
        low, high = previous, k
        if outline[low, 1] > outline[high, 1]:
            low, high = high, low
        rise = outline[high, 1] - outline[low, 1]
        if rise > 0.0:
            slope = (outline[high, 0] - outline[low, 0]) / rise
            begin = max(int(math.ceil(max(outline[low, 1], -1.0))), first)
            end = min(int(math.floor(min(outline[high, 1], view.height))), last)
            column = outline[low, 0] + (begin - outline[low, 1]) * slope
            for row in range(begin, end + 1):
                spans[row, 0] = min(spans[row, 0], column)
                spans[row, 1] = max(spans[row, 1], column)
                column += slope
        previous = k
    return first, last + 1


@kernel
def fill_face(view: View, canvas: Canvas, records: Records, number: int, kept: int) -> None:
    """Write a face where it is nearer than what is there already."""
    first, stop = fill_spans(view, canvas.outline, kept, canvas.spans)
    if stop <= first:
        return
    c = records.corners[number]
    # plane through three corners; 1 / depth is linear in the image
    ux, uy, uz = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    vx, vy, vz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    offset = nx * c[0, 0] + ny * c[0, 1] + nz * c[0, 2]
    if abs(offset) < 1e-9:
        return
    per_u = nx / (offset * view.focal_px)
    per_v = ny / (offset * view.focal_px)
    base = nz / offset - per_u * view.center_u - per_v * view.center_v
    slope, name = np.float32(per_u), np.int32(number)
    seen, faces = canvas.flat_nearness, canvas.flat_face
    for row in range(first, stop):
        begin = max(0, int(math.ceil(max(canvas.spans[row, 0], 0.0))))
        end = int(math.floor(min(canvas.spans[row, 1], view.width - 1.0)))
        start = np.float32(base + per_v * row + per_u * begin)
        where = row * view.width + begin
        for k in range(end + 1 - begin):
            # unsigned: an index that cannot be negative is needed for the loop to vectorise
            i = np.uint64(where + k)
            nearness = start + slope * np.float32(k)
            nearer = nearness > seen[i]
            seen[i] = nearness if nearer else seen[i]
            faces[i] = name if nearer else faces[i]


@kernel
def fill_shadow(view: View, canvas: Canvas, mark: int, kept: int) -> None:
    """Mark the outline in the shadow mask."""
    first, stop = fill_spans(view, canvas.outline, kept, canvas.spans)
    bit, shadow = np.uint8(mark), canvas.flat_shadow
    for row in range(first, stop):
        begin = max(0, int(math.ceil(max(canvas.spans[row, 0], 0.0))))
        end = int(math.floor(min(canvas.spans[row, 1], view.width - 1.0)))
        where = row * view.width + begin
        for k in range(end + 1 - begin):
            i = np.uint64(where + k)
            shadow[i] = np.uint8(shadow[i] | bit)


@kernel
def fill_faces(view: View, canvas: Canvas, records: Records) -> None:
    """Clear the canvas, then fill all faces and shadows that have been listed."""
    canvas.flat_nearness[:] = np.float32(0.0)
    canvas.flat_face[:] = np.int32(0)
    canvas.flat_shadow[:] = np.uint8(0)
    for number in range(1, records.used[0]):
        kept = outline_of(view, records.corners[number], records.sizes[number], canvas.outline)
        if kept < 3:
            continue
        if records.mark[number]:
            fill_shadow(view, canvas, records.mark[number], kept)
        else:
            fill_face(view, canvas, records, number, kept)
