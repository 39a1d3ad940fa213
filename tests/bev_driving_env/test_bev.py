from __future__ import annotations

import numpy as np
import pytest

from bev_driving_env.bev import BEVRenderer, bev_window
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.world.state import WorldState


@pytest.mark.parametrize(
    "geometry", [BEVGeometry(), BEVGeometry(size=64, px_per_m=2.0, ego_row=32)]
)
def test_the_bev_keeps_the_contracts_metres_in_any_geometry(geometry):
    window = bev_window(geometry)
    assert (window.size, window.ego_row) == (geometry.size, geometry.ego_row)
    assert window.ego_column == geometry.size // 2
    assert (window.route_ahead_m, 2.0 * window.route_half_width_m) == (80.0, 3.2)
    assert (window.pedestrian_half_extent_m, 2.0 * window.stop_line_half_px) == (0.8, 6.0)


def test_only_selected_worlds_are_drawn():
    town = compiled_town("Town02")
    state = WorldState.empty(3, signals=len(town.signals))
    state.ego[:, :2] = town.lanes[0].points[0, :2]
    bev = np.full((3, 6, 192, 192), 7, np.uint8)
    BEVRenderer(town, BEVGeometry()).render(state, np.array([True, False, True]), bev)
    assert (bev[1] == 7).all()
    assert set(np.unique(bev[[0, 2]])) == {0, 255}
    np.testing.assert_array_equal(bev[0], bev[2])


@pytest.mark.parametrize("px_per_m", [2.0, 5.0, 10.0])
def test_boundaries_are_about_two_pixels_wide_and_unbroken_at_any_resolution(px_per_m):
    town = compiled_town("Town02")
    lane = max(town.lanes, key=lambda lane: lane.length_m)
    x, y, heading = lane.pose_at(lane.length_m / 2.0)
    state = WorldState.empty(1, signals=len(town.signals))
    state.ego[0] = (x, y, heading + 0.2, 0.0)
    bev = np.zeros((1, 6, 96, 96), np.uint8)
    BEVRenderer(town, BEVGeometry(size=96, px_per_m=px_per_m, ego_row=48)).render(
        state, np.ones(1, np.bool_), bev
    )
    # the edge on the ego's right crosses every row near the middle: two pixels, give or take one
    lines = bev[0, 2] > 0
    for row in range(40, 57):
        right = np.flatnonzero(lines[row, 48:])
        first = right[: np.argmax(np.diff(np.append(right, 1000)) > 1) + 1]
        assert 1 <= len(first) <= 3
