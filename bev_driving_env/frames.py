"""Frames and units: the one place that says which way x, y and pixels run.

* World: metres, x east, y **south** (highway-env and CARLA agree); heading in radians,
  clockwise-positive from +x as seen from above.
* Ego: x forward, y **left**, z up, origin at the centre of the ego's footprint.
* BEV: row 0 is farthest ahead, column 0 farthest left; integer pixel coordinates are pixel
  *centres*, so the ego origin lies exactly on pixel (``ego_row``, ``size / 2``).

A pose is ``(x, y, heading)`` in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import is_int, is_number

Points = NDArray[np.float64]


def wrap_angle(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Wrap angles to [-pi, pi).

    >>> float(wrap_angle(3 * np.pi / 2)) == -np.pi / 2
    True
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def ego_axes(heading_rad: float) -> tuple[Points, Points]:
    """Unit vectors of the ego's forward (x) and left (y) axes in the world frame, each (2,)."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([cos, sin]), np.array([sin, -cos])


def world_from_ego(pose: Sequence[float] | Points, points: ArrayLike) -> Points:
    """Map ego-frame points (..., 2) to world points (..., 2).

    >>> world_from_ego((10.0, 0.0, 0.0), [1.0, 2.0]).tolist()  # 2 m to the left is north: -y
    [11.0, -2.0]
    """
    forward, left = ego_axes(pose[2])
    xy = np.asarray(points, dtype=np.float64)
    return np.asarray(pose[:2], dtype=np.float64) + xy[..., :1] * forward + xy[..., 1:2] * left


def ego_from_world(pose: Sequence[float] | Points, points: ArrayLike) -> Points:
    """Map world points (..., 2) to ego-frame points (..., 2); inverse of :func:`world_from_ego`."""
    forward, left = ego_axes(pose[2])
    offset = np.asarray(points, dtype=np.float64) - np.asarray(pose[:2], dtype=np.float64)
    return np.stack([offset @ forward, offset @ left], axis=-1)


def footprint(pose: Sequence[float] | Points, length_m: float, width_m: float) -> Points:
    """Corners (4, 2) of a box centred on a pose: front left, front right, rear right, rear left."""
    half_length, half_width = length_m / 2.0, width_m / 2.0
    corners = np.array(
        [
            [half_length, half_width],
            [half_length, -half_width],
            [-half_length, -half_width],
            [-half_length, half_width],
        ]
    )
    return world_from_ego(pose, corners)


@dataclass(frozen=True)
class BEVGeometry:
    """Where the bird's-eye view lies around the ego.

    Attributes:
        size: Side of the square image in pixels. The ego is at column ``size / 2``.
        px_per_m: Resolution. The static map is rasterised twice as fine and kept, so a finer BEV
            costs memory with the square of this number (20 MB for Town01 at 5, 330 MB at 20).
        ego_row: Row of the ego origin. ``ego_row / px_per_m`` metres are visible ahead.

    Raises:
        ValueError: A value is out of range; the message names it.
    """

    size: int = 192
    px_per_m: float = 5.0
    ego_row: int = 152

    def __post_init__(self) -> None:
        if not (is_int(self.size) and 16 <= self.size <= 2048 and self.size % 2 == 0):
            raise ValueError(f"BEV size must be an even int from 16 to 2048 px, got {self.size!r}")
        if not (is_number(self.px_per_m) and 0.5 <= self.px_per_m <= 20.0):
            raise ValueError(f"BEV px_per_m must be from 0.5 to 20, got {self.px_per_m!r}")
        if not (is_int(self.ego_row) and 0 <= self.ego_row < self.size):
            raise ValueError(
                f"BEV ego_row must be an int from 0 to {self.size - 1} when size is {self.size}, "
                f"got {self.ego_row!r}"
            )
        for name in ("size", "ego_row"):  # NumPy's integers would make the kernels compile anew
            object.__setattr__(self, name, int(getattr(self, name)))

    @property
    def ego_column(self) -> int:
        """Column of the ego origin."""
        return self.size // 2

    def pixel_from_ego(self, points: ArrayLike) -> Points:
        """Map ego-frame points (..., 2) to BEV pixels (..., 2), ordered (column u, row v).

        >>> BEVGeometry().pixel_from_ego([[0.0, 0.0], [30.4, 19.2]]).tolist()
        [[96.0, 152.0], [0.0, 0.0]]
        """
        xy = np.asarray(points, dtype=np.float64)
        column = self.ego_column - self.px_per_m * xy[..., 1]
        row = self.ego_row - self.px_per_m * xy[..., 0]
        return np.stack([column, row], axis=-1)

    def ego_from_pixel(self, pixels: ArrayLike) -> Points:
        """Map BEV pixels (..., 2) as (column u, row v) to ego-frame points (..., 2)."""
        uv = np.asarray(pixels, dtype=np.float64)
        x = (self.ego_row - uv[..., 1]) / self.px_per_m
        y = (self.ego_column - uv[..., 0]) / self.px_per_m
        return np.stack([x, y], axis=-1)


CHANNELS: tuple[str, ...] = ("road", "route", "lane", "vehicles", "pedestrians", "lights")
"""Names of the BEV channels, in the order of the first axis of every BEV array."""
