"""``IPM``: the honest baseline, inverse perspective mapping and colours, nothing learnt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frames import BEVGeometry
from .ipm_colours import RoadFinder
from .ipm_ground import GroundView
from .ipm_lines import LineFinder
from .ipm_route import draw_route
from .protocol import SensorFrame

_GEOMETRY = BEVGeometry()


class IPM:
    """``bev_source="ipm"``: lays the images out on flat ground and looks for the road by colour.

    The route is drawn through the points of the route map. Everything is computed from the frame
    at hand alone.

    Args:
        geometry: The BEV to predict.

    Attributes:
        geometry: See above.
        channels: Road, route and lane.
    """

    channels: tuple[str, ...] = ("road", "route", "lane")

    def __init__(self, geometry: BEVGeometry = _GEOMETRY) -> None:
        self.geometry = geometry
        self._rig: tuple[bytes, bytes, tuple[int, ...]] | None = None
        self._view: GroundView
        self._roads: RoadFinder
        self._lines: LineFinder

    def reset(self) -> None:
        """Nothing is remembered but tables that depend on the rig alone."""

    def __call__(self, frame: SensorFrame) -> NDArray[np.uint8]:
        """Predict (3, size, size): 255 where there is road, route, lane."""
        rgb = self._view_of(frame).project(frame.images)
        road = self._roads.find(frame.images, rgb)
        route = draw_route(self.geometry, frame.route_map)
        lane = self._lines.find(rgb, road)
        return np.stack([road, route, lane]) * np.uint8(255)

    def project(self, frame: SensorFrame) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """The images seen from above, as if everything in them lay on flat ground.

        Args:
            frame: Of any number of cameras.

        Returns:
            RGB (size, size, 3), black where no camera looks, and (size, size) whether one does.
        """
        view = self._view_of(frame)
        return view.project(frame.images), view.seen.copy()

    def _view_of(self, frame: SensorFrame) -> GroundView:
        rig = (frame.intrinsics.tobytes(), frame.extrinsics.tobytes(), frame.images.shape)
        if rig != self._rig:
            size = (frame.images.shape[1], frame.images.shape[2])
            self._view = GroundView(self.geometry, frame.intrinsics, frame.extrinsics, size)
            self._roads = RoadFinder(self.geometry, self._view)
            self._lines = LineFinder(self.geometry, self._view)
            self._rig = rig
        return self._view
