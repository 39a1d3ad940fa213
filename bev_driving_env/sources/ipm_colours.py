"""Finding the road in a picture of the ground by its colour, whatever colour it has today.

The car stands on the road, so the ground right ahead of and behind it shows the road's colour.
From there on it is followed outwards: haze, sheen and headlights change a colour with distance,
so each step learns the next metres' colour from what it has already found.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import BEVGeometry
from .ipm_ground import Gaps, GroundView, cell_centres

Mask = NDArray[np.uint8]
Colours = NDArray[np.float32]

CELL_M = 0.4
"""Ground is classified in cells of about this size."""
COARSE_M = 0.8
"""The road's colour is followed in cells of about this size."""
BLACK = 3
"""A camera that shows nothing brighter than this is dark."""

SEED_HALF_WIDTH_M = 0.8
SEED_NEAR_M, SEED_FAR_M = 3.0, 6.0
"""Where ahead of the car and behind it the ground must be road."""
SEED_SPREAD = 0.25
"""Most deviation of the logarithm of brightness there, so as to leave out lines."""
CORRIDOR_HALF_WIDTH_M, CORRIDOR_M = 1.0, 12.0
"""The car drives along here, so ground of the road's colour that reaches in is road."""
LEAST_SHARE = 0.06
"""Share of the corridor that it must cover."""
FOOTPRINT_M = 2.5, 1.0
"""Half the length and half the width of what the car surely stands on."""

CHROMA = 0.1
"""Most deviation of the logarithms of red over green and of blue over green."""
DARKER, DARKEST = 0.28, 1.0
"""Most deviation of the logarithm of brightness downwards: in the light, and in shadow."""
FIRST_BRIGHTER = 0.14
"""Most deviation upwards, as long as the ground beside the road is not known."""
LEAST_BRIGHTER, MOST_BRIGHTER = 0.1, 0.35
"""Range of it afterwards: half the contrast to the ground beside the road."""
USUAL_CONTRAST = 0.3
STRIP_M = 1.6
"""Width of what is beside the road."""
MOST_STEP = 0.15
"""Most difference of two cameras' logarithms of a colour that exposure can explain."""

ROUNDS, SETTLED = 5, 0.002
"""Most steps outwards; they end early when less than this share of the cells changes."""
RING_SIGMA_M = 1.5
"""Rings learn from their neighbours within about this distance."""
ENOUGH = 8.0
"""A ring with more cells than this counts no more than one with as many."""
LEAST_ROAD_M2 = 40.0
"""If less was found than this, it began on a patch of the road that is darker than the rest."""
NEAR_M = 14.0
"""Road must hang together within this distance, where pictures are sharp."""
SHADOW_SHARE = 0.08
"""Share of a dark patch that must lie at the edge of the road to be a shadow on it."""
EDGE_M = 0.2
"""Road goes on this much beyond its colour, because edge lines and kerbs are bright."""
HOLE_M2 = 40.0
"""Largest hole in the road that is filled: a patch of other asphalt."""
GAP_M = 9.0
"""How far away ground may be that tells what unseen ground is."""

LOG = np.log((np.arange(256) + 6.0) / 100.0).astype(np.float32)
"""Logarithm of each grey level; the offset keeps the noise of dark pixels small."""
# logarithm of brightness, red over green, blue over green
_OPPONENTS = np.array([[1 / 3, 1 / 3, 1 / 3], [1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])


class RoadFinder:
    """Finds the road in pictures of the ground that one rig takes.

    Args:
        geometry: The BEV.
        view: How the rig sees it.
    """

    def __init__(self, geometry: BEVGeometry, view: GroundView) -> None:
        self._view, self._size = view, geometry.size
        self._fine = _Grid(geometry, view, CELL_M)
        self._coarse = _Grid(geometry, view, COARSE_M)
        self._rings = _Rings(self._coarse.ring, int(self._fine.ring.max()) + 1)
        self._exposure = _Exposure(view.pairs, view.cameras)
        step = geometry.size // self._fine.count
        self._camera = np.where(self._fine.seen, view.camera[::step, ::step], 0)
        self._gaps = Gaps(self._fine.seen, round(GAP_M / self._fine.cell_m))
        self._edge = disc(EDGE_M * geometry.px_per_m, 0)

    def find(self, images: NDArray[np.uint8], rgb: NDArray[np.uint8]) -> Mask:
        """The road in a picture of the ground.

        Args:
            images: (C, H, W, 3), what the cameras show.
            rgb: (size, size, 3), the ground as seen from above.

        Returns:
            (size, size) of 0 and 1; all 0 if the cameras are dark.
        """
        fine, coarse = self._fine, self._coarse
        small = cv2.resize(rgb, (fine.count, fine.count), interpolation=cv2.INTER_AREA)
        colours = _colours(np.asarray(cv2.medianBlur(small, 3), np.uint8))
        colours -= self._exposure.shifts(self._view.overlaps(images)).take(self._camera, axis=0)
        size = coarse.count, coarse.count
        blurred = np.asarray(cv2.resize(colours, size, interpolation=cv2.INTER_AREA), np.float32)
        first = self._first_colour(blurred)
        if first is None:
            return np.zeros((self._size, self._size), np.uint8)
        by_ring, brighter = self._follow(blurred, first)
        road = self._segment(colours - by_ring.take(fine.ring, axis=0), brighter)
        self._complete(road)
        smooth = cv2.resize(road * np.uint8(255), (self._size, self._size))
        return np.asarray(cv2.dilate((smooth > 127).view(np.uint8), self._edge), np.uint8)

    def _first_colour(self, colours: Colours) -> NDArray[np.float32] | None:
        """The road's colour beside the car, None if it is dark there."""
        places = [
            colours[cells] for cells in (self._coarse.ahead, self._coarse.behind) if cells.any()
        ]
        medians = [median(place) for place in places]
        medians = [median for median in medians if median[0] > LOG[BLACK]]
        if not medians:
            return None
        # one of them may be in shadow or on a dark patch, or lit by headlights alone
        if len(medians) == 2 and 0.0 < medians[1][0] - medians[0][0] < DARKEST:
            return medians[1]
        return medians[0]

    def _follow(self, colours: Colours, first: NDArray[np.float32]) -> tuple[Colours, float]:
        """The road's colour by ring (R, 3), and how much brighter than that it may be."""
        grid, brighter = self._coarse, FIRST_BRIGHTER
        road: NDArray[np.bool_] = (grid.ahead | grid.behind) & (
            np.abs(colours[..., 0] - first[0]) < SEED_SPREAD
        )
        for _ in range(ROUNDS):
            by_ring = self._rings.average(colours, road)
            deviation = colours - by_ring.take(grid.ring, axis=0)
            lit = _within(deviation, -DARKER, brighter) & grid.seen
            before, road = road, grid.reaching_in(grid.opened(lit) & grid.seen) & lit
            if np.count_nonzero(before != road) < SETTLED * road.size:
                break
            brighter = self._contrast(deviation[..., 0], road.view(np.uint8), brighter) / 2.0
            brighter = min(max(brighter, LEAST_BRIGHTER), MOST_BRIGHTER)
            if road.sum() * grid.cell_m**2 < LEAST_ROAD_M2:  # it began on a dark patch of the road
                brighter = MOST_BRIGHTER
        return by_ring, brighter

    def _contrast(self, deviation: Colours, road: Mask, brighter: float) -> float:
        """How much brighter the strip beside the road is."""
        grid = self._coarse
        strip = cv2.dilate(road, disc(STRIP_M / grid.cell_m)) > road
        strip &= grid.seen & grid.near & (deviation > 0.8 * brighter)
        values = deviation[strip]
        return float(median(values)) if len(values) > 5 else USUAL_CONTRAST

    def _segment(self, deviation: Colours, brighter: float) -> Mask:
        """Lit road that hangs together, and the shadows on it."""
        grid = self._fine
        deviation[..., 1:] = cv2.blur(deviation[..., 1:], (3, 3))
        patches = grid.opened(_within(deviation, -DARKER, brighter) & grid.seen)
        self._gaps.fill(patches)
        # first in the vicinity: far away, blurred edges would let it run round to the yards
        road = grid.reaching_in(patches & grid.near)
        road = grid.reaching_in(np.where(grid.near, road, patches).astype(np.uint8))
        dark = (_within(deviation, -DARKEST, -DARKER) & grid.seen).view(np.uint8)
        count, labels = cv2.connectedComponents(dark, connectivity=8)
        beside = cv2.dilate(road.view(np.uint8), disc(1.0)) > 0
        touching = np.bincount(labels[beside], minlength=count)
        shadow = touching > SHADOW_SHARE * np.bincount(labels.ravel(), minlength=count)
        shadow[0] = False
        return np.asarray((road | shadow.take(np.asarray(labels))) & grid.seen).view(np.uint8)

    def _complete(self, road: Mask) -> None:
        """Fill in what is unseen or enclosed, and drop what is apart."""
        grid = self._fine
        self._gaps.fill(road)
        road |= grid.footprint
        road[:] = cv2.morphologyEx(road, cv2.MORPH_CLOSE, disc(2.0))
        _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - road, connectivity=4)
        enclosed = stats[:, cv2.CC_STAT_AREA] < HOLE_M2 / grid.cell_m**2
        enclosed[0] = False
        road |= enclosed.take(np.asarray(labels))
        _, labels = cv2.connectedComponents(road, connectivity=4)
        road &= labels == labels[grid.footprint].max(initial=0)


class _Grid:
    """Where the cells of a size lie.

    Attributes:
        count: Cells along each side of the window.
        cell_m: Their size.
        seen: (count, count) bool, whether cameras see the whole cell; likewise the next.
        near: Whether it is in the vicinity.
        ring: Its distance in whole metres.
        ahead: Whether it is right ahead of the car.
        behind: Whether it is right behind it.
        corridor: Whether it is seen and in the corridor that the car drives along.
        footprint: Whether the car stands on it.
    """

    def __init__(self, geometry: BEVGeometry, view: GroundView, cell_m: float) -> None:
        size, wanted = geometry.size, max(1, round(cell_m * geometry.px_per_m))
        step = next(step for step in range(wanted, 0, -1) if size % step == 0)
        self.count, self.cell_m = size // step, step / geometry.px_per_m
        blocks = self.count, step, self.count, step
        x, y = (plane.reshape(blocks).mean(axis=(1, 3)) for plane in cell_centres(geometry))
        distance = np.hypot(x, y)
        self.seen: NDArray[np.bool_] = np.asarray(view.seen.reshape(blocks).all(axis=(1, 3)))
        self.near: NDArray[np.bool_] = np.asarray(distance < NEAR_M)
        self.ring = distance.astype(np.int64)
        middle = self.seen & (np.abs(y) < SEED_HALF_WIDTH_M)
        self.ahead = middle & (x > SEED_NEAR_M) & (x < SEED_FAR_M)
        self.behind = middle & (x < -SEED_NEAR_M) & (x > -SEED_FAR_M)
        self.corridor = self.seen & (np.abs(y) < CORRIDOR_HALF_WIDTH_M) & (np.abs(x) < CORRIDOR_M)
        self.footprint = (np.abs(x) < FOOTPRINT_M[0]) & (np.abs(y) < FOOTPRINT_M[1])
        self._corridor_cells = np.flatnonzero(self.corridor)
        self._unseen = ~self.seen

    def opened(self, chosen: NDArray[np.bool_]) -> Mask:
        """Chosen and unseen cells (count, count), without what is narrower than three."""
        cells = (chosen | self._unseen).view(np.uint8)
        return np.asarray(cv2.morphologyEx(cells, cv2.MORPH_OPEN, disc(1.0)), np.uint8)

    def reaching_in(self, patches: Mask) -> NDArray[np.bool_]:
        """Those patches that reach into the corridor."""
        count, labels = cv2.connectedComponents(patches, connectivity=4)
        inside = np.bincount(labels.take(self._corridor_cells), minlength=count)
        chosen = inside >= max(2.0, LEAST_SHARE * len(self._corridor_cells))
        chosen[0] = False
        return np.asarray(chosen.take(np.asarray(labels)))


class _Rings:
    """Averages over rings around the car, one per metre."""

    def __init__(self, ring: NDArray[np.int64], count: int) -> None:
        self._ring, self._count = ring.ravel(), max(count, int(ring.max()) + 1)
        apart = np.abs(np.arange(self._count)[:, None] - np.arange(self._count))
        # the second term decides where no ring nearby has a value
        self._weights = np.exp(-0.5 * (apart / RING_SIGMA_M) ** 2) + 1e-6 * np.exp(-1.0 * apart)

    def average(self, colours: Colours, chosen: NDArray[np.bool_]) -> Colours:
        """Average colour (R, 3) of the chosen cells of each ring and its neighbours."""
        cells = np.flatnonzero(chosen)
        ring = self._ring.take(cells)
        number = np.bincount(ring, minlength=self._count) + 1e-3
        trust = np.minimum(number, ENOUGH) / number
        planes = colours.reshape(-1, 3).take(cells, axis=0).T
        sums = np.stack([np.bincount(ring, plane, self._count) for plane in planes], axis=1)
        smooth = self._weights @ (sums * trust[:, None])
        smooth /= (self._weights @ (number * trust))[:, None]
        return np.asarray(smooth, np.float32)


class _Exposure:
    """Evens out the exposure of cameras, by what pairs of them show of the same ground."""

    def __init__(self, pairs: list[tuple[int, int]], cameras: int) -> None:
        rows = np.zeros((len(pairs), cameras))
        for row, (a, b) in zip(rows, pairs, strict=True):
            row[a], row[b] = -1.0, 1.0
        # shifts are kept small, above all the first camera's, to which the others are fitted
        held = 0.05 * np.eye(cameras)
        held[0, 0] = 1.0
        self._solve = np.linalg.pinv(np.concatenate([rows, held]))[:, : len(rows)]

    def shifts(
        self, overlaps: list[tuple[int, int, NDArray[np.uint8], NDArray[np.uint8]]]
    ) -> Colours:
        """What each camera shows too much (cameras, 3) of each colour."""
        steps = np.zeros((len(overlaps), 3), np.float32)
        for step, (_, _, a, b) in zip(steps, overlaps, strict=True):
            difference = median(_colours(b[None])[0] - _colours(a[None])[0])
            # else they show different sides of something upright
            if np.abs(difference).max() < MOST_STEP:
                step[:] = difference
        return np.asarray(self._solve @ steps, np.float32)


def median(values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Upper median along the first axis, faster than NumPy's for a few values."""
    return np.asarray(np.partition(values, len(values) // 2, axis=0)[len(values) // 2], np.float32)


def _colours(rgb: NDArray[np.uint8]) -> Colours:
    """Logarithms (H, W, 3) of brightness, red over green and blue over green."""
    return np.asarray(cv2.transform(cv2.LUT(rgb, LOG), _OPPONENTS), np.float32)


def _within(deviation: Colours, darkest: float, brightest: float) -> NDArray[np.bool_]:
    """Which cells (H, W) have the road's hue, and a brightness in a range."""
    return (
        np.asarray(
            cv2.inRange(deviation, (darkest, -CHROMA, -CHROMA), (brightest, CHROMA, CHROMA))
        ).view(np.uint8)
        > 0
    )


def disc(radius_px: float, least_px: int = 1) -> Mask:
    """Structuring element of a radius, rounded, but at least of a few pixels."""
    side = 2 * max(least_px, round(radius_px)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)
