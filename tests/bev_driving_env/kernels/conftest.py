"""One-world BEV drawing for the tests of the BEV kernel."""

import numpy as np
import pytest

from bev_driving_env.bev import bev_window
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.kernels.bev import render_worlds
from bev_driving_env.kernels.layout import (
    ACTOR_COLUMNS,
    PROGRESS_COLUMNS,
    ROUTE_POSITION,
    RasterGrid,
)

NOWHERE = (np.zeros((1, 1), np.uint8), RasterGrid(0.0, 0.0, 10.0))


class Picture:
    """A BEV (6, size, size) with the ego-frame and world coordinates of its pixel centres."""

    def __init__(self, bev, pose, size, px_per_m, ego_row):
        self.bev = bev
        v, u = np.mgrid[:size, :size]
        self.ahead = (ego_row - v) / px_per_m
        self.left = (size / 2 - u) / px_per_m
        x, y, heading = pose
        cos, sin = np.cos(heading), np.sin(heading)
        self.x = x + self.ahead * cos + self.left * sin
        self.y = y + self.ahead * sin - self.left * cos

    def frame_of(self, pose):
        """Distance ahead of and to the right of a pose, for every pixel."""
        dx, dy = self.x - pose[0], self.y - pose[1]
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        return dx * cos + dy * sin, dy * cos - dx * sin


@pytest.fixture
def draw():
    """Function that renders one world, made of only what it is given."""

    def draw_one(
        pose,
        *,
        raster=NOWHERE,
        route=None,
        position=0.0,
        vehicles=(),
        pedestrians=(),
        stop_lines=(),
        signals=(),
        size=192,
        px_per_m=5.0,
        ego_row=152,
    ):
        points, spacing = (np.zeros((2, 4)), 1.0) if route is None else route
        progress = np.zeros((1, PROGRESS_COLUMNS))
        progress[0, ROUTE_POSITION] = position
        bev = np.full((1, 6, size, size), 77, np.uint8)  # every pixel must be overwritten
        render_worlds(
            bev_window(BEVGeometry(size=size, px_per_m=px_per_m, ego_row=ego_row)),
            *raster,
            np.array(stop_lines, dtype=np.float64).reshape(-1, 4),
            np.array([True]),
            np.array([[*pose, 0.0]]),
            points[None],
            np.array([0 if route is None else len(points)]),
            np.array([spacing]),
            progress,
            np.array(vehicles, dtype=np.float64).reshape(1, -1, ACTOR_COLUMNS),
            np.array(pedestrians, dtype=np.float64).reshape(1, -1, ACTOR_COLUMNS),
            np.array(signals, dtype=np.uint8).reshape(1, -1),
            bev,
        )
        assert set(np.unique(bev)) <= {0, 255}
        return Picture(bev[0], pose, size, px_per_m, ego_row)

    return draw_one
