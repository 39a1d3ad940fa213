"""Finding painted lines in a picture of the ground."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from ..bev import LINE_PX
from ..frames import BEVGeometry
from .ipm_colours import LOG, Mask, median
from .ipm_ground import GroundView, cell_centres

LINE_M = 0.45
"""Lines are thinner than this."""
CONTRAST, NOISE = 0.05, 3.0
"""Least logarithm of their brightness over what is beside them: so much, and so many medians."""
RINGS_M = (0.0, 7.0, 12.0, 22.0)
"""Near by, the grain of the asphalt is seen, so each ring has a noise of its own. Farther away than
the last, pictures are too blurred for lines."""
VOTES = 12
SHORTEST_M, LONGEST_GAP_M = 4.0, 5.0
_YELLOW = np.array([[0.5, 0.5, 0.0]])
"""Brightness without blue, in which yellow paint hardly differs from asphalt."""


class LineFinder:
    """Finds painted lines: thin, brighter than the road at either side, and straight.

    Args:
        geometry: The BEV.
        view: How the rig sees it.
    """

    def __init__(self, geometry: BEVGeometry, view: GroundView) -> None:
        self._px_per_m = geometry.px_per_m
        x, y = cell_centres(geometry)
        away = np.hypot(x, y)
        self._rings = [
            view.seen & (away >= near) & (away < far) for near, far in itertools.pairwise(RINGS_M)
        ]
        side = 2 * max(1, round(LINE_M * geometry.px_per_m)) + 1
        self._beside = np.ones((side, side), np.uint8)

    def find(self, rgb: NDArray[np.uint8], road: Mask) -> Mask:
        """Lines on the road.

        Args:
            rgb: (size, size, 3) picture of the ground.
            road: (size, size) of 0 and 1.

        Returns:
            (size, size) of 0 and 1; all 0 where there is no road.
        """
        lines = np.zeros_like(road)
        bright = cv2.LUT(cv2.transform(rgb, _YELLOW), LOG)
        ridge = np.asarray(cv2.morphologyEx(bright, cv2.MORPH_TOPHAT, self._beside), np.float32)
        points = np.zeros_like(road)
        for ring in self._rings:
            places = ring & (road > 0)
            values = ridge[places][::8]
            if len(values):
                least = CONTRAST + NOISE * float(median(values))
                points |= ((ridge > least) & places).view(np.uint8)
        found = cv2.HoughLinesP(
            points,
            rho=1.0,
            theta=np.pi / 180.0,
            threshold=VOTES,
            minLineLength=SHORTEST_M * self._px_per_m,
            maxLineGap=LONGEST_GAP_M * self._px_per_m,
        )
        width = max(1, round(LINE_PX))
        for u1, v1, u2, v2 in [] if found is None else np.reshape(found, (-1, 4)):
            cv2.line(lines, (int(u1), int(v1)), (int(u2), int(v2)), 1, width)
        return lines & road
