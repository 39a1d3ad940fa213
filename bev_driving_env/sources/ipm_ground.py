"""Inverse perspective mapping: what cameras see of flat ground, laid out as a BEV."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras.rig import project
from ..frames import BEVGeometry

UNSEEN = -1
CHORD_DIRECTIONS = 12
"""Number of lines through each unseen cell."""
OPENCV_MOST_ROWS = 32766
"""The images, one below the other, can be sampled as one image up to this height."""
OUTSIDE = -9.0
"""A coordinate outside every image, which OpenCV paints black."""
OVERLAP_M, OVERLAP_CELLS = 14.0, 200
"""Cameras are compared on ground within this distance, on no more cells than about so many."""


class GroundView:
    """Which pixel of which camera shows each BEV cell, if the world were flat.

    Where several cameras see a cell, the one that shows it largest and nearest to its optical
    axis is asked.

    Args:
        geometry: The BEV.
        intrinsics: (C, 3, 3).
        extrinsics: ``camera_from_ego`` (C, 4, 4).
        size: Height and width of the images.

    Attributes:
        camera: (size, size) index of the camera asked, ``UNSEEN`` where there is none.
        seen: (size, size) bool, whether there is one.
        cameras: How many there are.
        pairs: Which of them see the same ground nearby, in the order of ``overlaps``.
    """

    def __init__(
        self,
        geometry: BEVGeometry,
        intrinsics: NDArray[np.floating],
        extrinsics: NDArray[np.floating],
        size: tuple[int, int],
    ) -> None:
        height, width = size
        x, y = cell_centres(geometry)
        points = np.stack([x, y, np.zeros_like(x)], axis=-1)
        columns, rows = np.zeros_like(x), np.zeros_like(x)
        best = np.zeros_like(x)
        near: NDArray[np.bool_] = np.asarray(np.hypot(x, y) < OVERLAP_M)
        shown: list[tuple[NDArray[np.bool_], NDArray[np.float64]]] = []
        self.camera: NDArray[np.int64] = np.full(x.shape, UNSEEN)
        for number, (intrinsic, extrinsic) in enumerate(zip(intrinsics, extrinsics, strict=True)):
            pixels, depth = project(intrinsic, extrinsic, points)
            u, v = pixels[..., 0], pixels[..., 1]
            place = -extrinsic[:3, :3].T.astype(np.float64) @ extrinsic[:3, 3]
            distance = np.linalg.norm(points - place, axis=-1)
            # NaN, for cells behind the camera, fails every comparison
            inside = (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)
            shown.append((inside & near, pixels))
            axial = depth / np.maximum(distance, 1e-6)
            magnification = intrinsic[0, 0] * intrinsic[1, 1] / np.maximum(distance, 1e-6) ** 2
            score = np.where(inside, axial * magnification, 0.0)
            better = score > best
            best[better], self.camera[better] = score[better], number
            columns[better] = np.clip(u[better], 0.0, width - 1.0)
            rows[better] = np.clip(v[better], 0.0, height - 1.0)
        self.seen: NDArray[np.bool_] = self.camera != UNSEEN
        self._overlaps = _overlaps(shown, (width - 1, height - 1))
        self.cameras = len(intrinsics)
        self.pairs = [(a, b) for a, b, _, _ in self._overlaps]
        self._stacked: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._tables: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
        if len(intrinsics) * height <= OPENCV_MOST_ROWS:
            tall = np.where(self.seen, self.camera * height + rows, OUTSIDE)
            wide = np.where(self.seen, columns, OUTSIDE)
            self._stacked = cv2.convertMaps(
                wide.astype(np.float32), tall.astype(np.float32), cv2.CV_16SC2
            )
            return
        for number in range(len(intrinsics)):
            here = self.camera == number
            wide, tall = (np.where(here, part, OUTSIDE) for part in (columns, rows))
            self._tables.append((wide.astype(np.float32), tall.astype(np.float32)))

    def project(self, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The images (C, H, W, 3) as seen from above: (size, size, 3), black where unseen."""
        if self._stacked is not None:
            tall = np.ascontiguousarray(images).reshape(-1, *images.shape[2:])
            return np.asarray(cv2.remap(tall, *self._stacked, cv2.INTER_LINEAR), np.uint8)
        rgb = np.zeros((*self.seen.shape, 3), np.uint8)
        for image, (columns, rows) in zip(images, self._tables, strict=True):
            rgb += np.asarray(cv2.remap(image, columns, rows, cv2.INTER_LINEAR), np.uint8)
        return rgb

    def overlaps(
        self, images: NDArray[np.uint8]
    ) -> list[tuple[int, int, NDArray[np.uint8], NDArray[np.uint8]]]:
        """What pairs of cameras show of the same ground: numbers of both, pixels (N, 3) of both."""
        return [
            (a, b, images[a][tuple(pixels_a)], images[b][tuple(pixels_b)])
            for a, b, pixels_a, pixels_b in self._overlaps
        ]


Overlap = tuple[int, int, NDArray[np.int64], NDArray[np.int64]]


def _overlaps(
    shown: list[tuple[NDArray[np.bool_], NDArray[np.float64]]], most: tuple[int, int]
) -> list[Overlap]:
    """Pairs of cameras, and for each the (rows, columns) of cells that both of them show."""
    found = []
    for a, (shown_a, pixels_a) in enumerate(shown):
        for b, (shown_b, pixels_b) in enumerate(shown[:a]):
            cells = np.flatnonzero(shown_a & shown_b)
            if len(cells) < 10:
                continue
            cells = cells[:: -(-len(cells) // OVERLAP_CELLS)]
            first, second = (
                np.clip(np.rint(pixels.reshape(-1, 2)[cells]), 0, most).astype(np.int64).T[::-1]
                for pixels in (pixels_b, pixels_a)
            )
            found.append((b, a, first, second))
    return found


class Gaps:
    """Fills what no camera sees, such as the ground under the car, from what is around it.

    Of every straight line through an unseen cell, the first seen cell is looked up at either end.
    If both ends are road, the line votes for road, if neither is, against it. So straight edges
    go on straight.

    Args:
        seen: (H, W) bool.
        reach_px: How far a cell at the end of a line may be.
    """

    def __init__(self, seen: NDArray[np.bool_], reach_px: int) -> None:
        rows, columns = np.nonzero(~seen)
        count = len(rows)
        ends = np.zeros((CHORD_DIRECTIONS, 2, count), np.int64)
        found = np.zeros((CHORD_DIRECTIONS, 2, count), np.bool_)
        height, width = seen.shape
        for k in range(CHORD_DIRECTIONS):
            angle = np.pi * k / CHORD_DIRECTIONS
            for end, sign in enumerate((-1.0, 1.0)):
                for step in range(1, reach_px + 1):
                    v = np.rint(rows + sign * step * np.cos(angle)).astype(np.int64)
                    u = np.rint(columns + sign * step * np.sin(angle)).astype(np.int64)
                    inside = (v >= 0) & (v < height) & (u >= 0) & (u < width)
                    v, u = np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)
                    hit = inside & seen[v, u] & ~found[k, end]
                    ends[k, end, hit] = (v * width + u)[hit]
                    found[k, end] |= hit
        crossed: NDArray[np.bool_] = np.asarray(found.all(axis=1))
        near: NDArray[np.bool_] = np.asarray(crossed.any(axis=0))
        self._cells = (rows * width + columns)[near]
        self._ends = np.ascontiguousarray(ends[:, :, near].swapaxes(0, 1))
        self._crossed = crossed[:, near].astype(np.int8)

    def fill(self, plane: NDArray[np.uint8]) -> None:
        """Write 0 or 1 into the unseen cells of a plane (H, W) of 0 and 1, in place."""
        flat = plane.reshape(-1)
        ends = flat.take(self._ends)
        votes = (ends[0] + ends[1]).view(np.int8) - np.int8(1)  # -1, 0 or 1 of each line
        votes *= self._crossed
        flat[self._cells] = votes.sum(axis=0, dtype=np.int8) > 0


def cell_centres(geometry: BEVGeometry) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ego-frame x and y (size, size) of the cells' centres."""
    row, column = np.mgrid[: geometry.size, : geometry.size]
    points = geometry.ego_from_pixel(np.stack([column, row], axis=-1))
    return points[..., 0], points[..., 1]
