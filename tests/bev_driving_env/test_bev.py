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
