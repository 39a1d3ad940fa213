"""The sparse route map of a world state: the one place that calls its rendering kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernels.layout import Window
from .kernels.route_map import render_route_maps
from .world.state import WorldState


def route_maps(window: Window, state: WorldState, selected: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Render the plan as a navigation system with GPS shows it.

    Args:
        window: See ``bev_window``.
        state: State of N worlds.
        selected: (N,) which of them.

    Returns:
        (N, size, size) uint8, newly made; maps of worlds that are not selected are undefined.
    """
    maps = np.empty((len(selected), window.size, window.size), np.uint8)
    render_route_maps(
        window,
        selected,
        state.ego,
        state.progress,
        state.plan_points,
        state.plan_size,
        state.episode_seed,
        state.steps,
        True,
        maps,
    )
    return maps
