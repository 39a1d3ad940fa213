"""The ground-truth BEV of a world state: the one place that calls the rendering kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .frames import BEVGeometry
from .kernels.bev import render_worlds
from .kernels.layout import Window
from .towns.compiled import CompiledTown
from .towns.raster import Raster
from .world.state import WorldState

OVERSAMPLING = 2
"""The BEV is sampled from a raster this many times finer, which keeps thin lines smooth."""
ROUTE_AHEAD_M = 80.0
ROUTE_WIDTH_M = 3.2
PEDESTRIAN_HALF_EXTENT_M = 0.8
LINE_PX = 2.0
"""Width of lane boundaries; in pixels, so that they stay unbroken at any resolution."""
STOP_LINE_PX = 6.0


def bev_window(geometry: BEVGeometry) -> Window:
    """The kernel's constants for a geometry; widths and distances are the contract's."""
    return Window(
        size=geometry.size,
        ego_row=geometry.ego_row,
        ego_column=geometry.ego_column,
        px_per_m=float(geometry.px_per_m),
        route_ahead_m=ROUTE_AHEAD_M,
        route_half_width_m=ROUTE_WIDTH_M / 2.0,
        pedestrian_half_extent_m=PEDESTRIAN_HALF_EXTENT_M,
        stop_line_half_px=STOP_LINE_PX / 2.0,
    )


class BEVRenderer:
    """Renders the six channels of one town at one geometry.

    Args:
        town: The town.
        geometry: Size, resolution and ego position of the view.
    """

    def __init__(self, town: CompiledTown, geometry: BEVGeometry) -> None:
        self._classes: Raster = town.classes(
            OVERSAMPLING * geometry.px_per_m, LINE_PX / geometry.px_per_m
        )
        self._stop_lines = town.stop_lines
        self._window = bev_window(geometry)

    def render(
        self, state: WorldState, selected: NDArray[np.bool_], bev: NDArray[np.uint8]
    ) -> None:
        """Render selected worlds.

        Args:
            state: State of N worlds.
            selected: (N,) which of them.
            bev: (N, 6, size, size) uint8 output; every pixel of a selected world is written.
        """
        render_worlds(
            self._window,
            self._classes.pixels,
            self._classes.grid,
            self._stop_lines,
            selected,
            state.ego,
            state.route_points,
            state.route_size,
            state.route_spacing,
            state.progress,
            state.vehicles,
            state.pedestrians,
            state.signals,
            bev,
        )
