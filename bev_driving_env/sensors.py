"""``Sensors``: what the car senses in each world, made of the world's state alone."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .bev import bev_window
from .cameras.renderer import CameraRenderer, CameraSettings
from .kernels.jit import announce_compilation
from .kernels.layout import SPEED
from .route_maps import route_maps
from .sources.protocol import SensorFrame
from .world.core import World


class Sensors:
    """Cameras, route map and measurements of N worlds.

    Asked twice in the same state, it answers with the same bits; nothing is made before it is
    asked for.

    Args:
        world: The worlds.
        settings: How the cameras see.
    """

    def __init__(self, world: World, settings: CameraSettings) -> None:
        self.world = world
        self.settings = settings
        self._window = bev_window(world.config.bev)
        self._intrinsics = settings.rig.intrinsics()
        self._extrinsics = settings.rig.extrinsics()

    @functools.cached_property
    def cameras(self) -> CameraRenderer:
        """The camera renderer, built when it is first needed."""
        vehicle = self.world.config.vehicle
        size = float(vehicle.length_m), float(vehicle.width_m)
        with announce_compilation():
            renderer = CameraRenderer(self.world.town, self.settings, size, len(self.world))
            # compiles or loads the kernels now, so that no later step pays for it
            renderer.render(self.world.state, 0)
        return renderer

    def prepare(self) -> None:
        """Build what the first image needs, if it is not there yet."""
        _ = self.cameras

    def images(self, n: int) -> NDArray[np.uint8]:
        """Camera images (C, H, W, 3) uint8 RGB of world ``n``, newly made."""
        return self.cameras.render(self.world.state, n)

    def route_maps(self, selected: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Route maps (N, size, size) uint8, newly made; those of other worlds are undefined."""
        return route_maps(self._window, self.world.state, selected)

    def measurements(self) -> NDArray[np.float32]:
        """Speed and last commands (N, 3) float32 of all worlds, newly made."""
        state = self.world.state
        table = np.empty((len(self.world), 3), np.float32)
        table[:, 0] = state.ego[:, SPEED]
        table[:, 1:] = state.command
        return table

    def frames(self, worlds: Iterable[int]) -> dict[int, SensorFrame]:
        """Everything that some worlds sense now, in arrays of their own."""
        chosen = list(worlds)
        selected = np.zeros(len(self.world), np.bool_)
        selected[chosen] = True
        maps, measurements = self.route_maps(selected), self.measurements()
        return {
            n: SensorFrame(
                images=self.images(n),
                intrinsics=self._intrinsics.copy(),
                extrinsics=self._extrinsics.copy(),
                route_map=maps[n].copy(),
                measurements=measurements[n].copy(),
            )
            for n in chosen
        }

    def frame(self, n: int) -> SensorFrame:
        """Everything that world ``n`` senses now."""
        return self.frames([n])[n]
