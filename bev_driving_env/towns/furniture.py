"""Buildings, trees, poles, fences and shelters along a town's roads, from a fixed seed.

All of it stands beyond the kerb, so the road itself stays as CARLA has it. Buildings line the
streets up to the corners, where they hide the side road, as in a real small town.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import footprint
from ..kernels.detect import raster_value
from ..kernels.layout import ROAD_BIT, SIDEWALK_BIT

if TYPE_CHECKING:
    from .compiled import CompiledTown, Lane

KINDS = (
    "building",
    "house",
    "tree",
    "lamp",
    "signal",
    "fence",
    "hedge",
    "shelter",
    "car",
    "pillar",
)
"""A ``building`` has a flat roof, a ``house`` a gable; a ``car`` is parked off the road."""
BUILDING, HOUSE, TREE, LAMP, SIGNAL, FENCE, HEDGE, SHELTER, CAR, PILLAR = range(10)
SEED = 7
OCCUPANCY_PX_PER_M = 2.0
CLEAR_M = 0.7
"""Nothing but signal posts, and the clutter of dense towns, stands closer to the pavement."""
POST_CLEAR_M = 0.35
CLUTTER_CLEAR_M = 0.4
VERGE_M = 1.0
"""Where a town has no sidewalks, furniture keeps this much farther away."""
CELL_M = 16.0
_turns = np.arange(12) * (math.pi / 6.0)
RING = np.array([[0.0, *np.cos(_turns)], [0.0, *np.sin(_turns)]])
"""A point and twelve around it, on the unit circle."""


class Prop(NamedTuple):
    """One piece of furniture; its solid part is the box ``length_m`` by ``width_m``.

    Attributes:
        kind: Index into ``KINDS``.
        x: World x of its centre.
        y: World y.
        heading: Direction of its length; the road lies to the left of it.
        length_m: Extent along the heading.
        width_m: Extent across.
        height_m: Height.
        variant: Random number in [0, 1000) for its looks.
    """

    kind: int
    x: float
    y: float
    heading: float
    length_m: float
    width_m: float
    height_m: float
    variant: int


@dataclass(frozen=True)
class Frontage:
    """The right-hand side of a lane as a place to build on.

    Attributes:
        lane: The lane.
        kerb_m: Lateral offset of the pavement's edge, to the right of the lane centre.
        building_line_m: Lateral offset of the outer edge of the sidewalk.
    """

    lane: Lane
    kerb_m: float
    building_line_m: float

    def place(self, station_m: float, lateral_m: float) -> tuple[float, float, float]:
        """World pose beside the lane; stations beyond its ends follow its end directions."""
        beyond = station_m - min(max(station_m, 0.0), self.lane.length_m)
        x, y, heading = self.lane.pose_at(station_m)
        cos, sin = math.cos(heading), math.sin(heading)
        x, y = x + beyond * cos - lateral_m * sin, y + beyond * sin + lateral_m * cos
        return x, y, heading


def furnish(town: CompiledTown, *, dense: bool = False) -> tuple[Prop, ...]:
    """Place a town's furniture.

    Args:
        town: The town.
        dense: Add hedges, pillars, parked cars and trees that hide more; all the others stay.

    Returns:
        The furniture, the same in every process.
    """
    site = _Site(town)
    rng = np.random.default_rng(SEED)
    for signal, (x1, y1, x2, y2) in zip(town.signals, town.stop_lines, strict=True):
        # a post faces the traffic that stops at its line
        site.post(signal.x, signal.y, math.atan2(y2 - y1, x2 - x1) - math.pi / 2.0, rng)
    frontages = list(_frontages(town))
    for frontage in frontages:
        _lamps(site, frontage, rng)
    for frontage in frontages:
        _buildings(site, frontage, rng)
    for frontage in frontages:
        _street_trees(site, frontage, rng, spacing_m=(9.0, 28.0))
        _shelters(site, frontage, rng)
    if dense:
        _clutter(site, frontages, np.random.default_rng(SEED + 1))
    return tuple(site.props)


def _frontages(town: CompiledTown) -> Iterator[Frontage]:
    """Right-hand sides of lanes that border on open ground."""
    section, classes = town.cross_section, town.classes()
    walk_m = section.sidewalk_m or VERGE_M
    for lane in town.lanes:
        kerb_m = float(lane.half_width.max()) + section.shoulder_m
        frontage = Frontage(lane, kerb_m, kerb_m + walk_m)
        x, y, _ = frontage.place(lane.length_m / 2.0, frontage.building_line_m + 0.5)
        value = raster_value(classes.pixels, classes.grid, x, y)
        if value & (ROAD_BIT | SIDEWALK_BIT) == 0:
            yield frontage


class _Site:
    """What has been placed, and which ground is taken."""

    def __init__(self, town: CompiledTown) -> None:
        self.props: list[Prop] = []
        self._by_cell: dict[tuple[int, int], list[Prop]] = {}
        self._classes = town.classes()
        grid = self._classes.grid
        self._step = round(grid.px_per_m / OCCUPANCY_PX_PER_M)
        taken = (self._classes.pixels & (ROAD_BIT | SIDEWALK_BIT) != 0).astype(np.uint8)
        if town.cross_section.sidewalk_m == 0.0:
            side = 2 * round(VERGE_M * grid.px_per_m) + 1
            taken = np.asarray(cv2.dilate(taken, np.ones((side, side), np.uint8)), np.uint8)
        rows, columns = taken.shape
        size = columns // self._step, rows // self._step
        shrunk = cv2.resize(
            taken[: size[1] * self._step, : size[0] * self._step] * np.uint8(255),
            size,
            interpolation=cv2.INTER_AREA,
        )
        self._taken: NDArray[np.uint8] = (shrunk > 0).astype(np.uint8)
        self._origin = np.array([grid.x0_m, grid.y0_m])

    def is_clear(self, x: float, y: float, radius_m: float) -> bool:
        """Whether no pavement lies within a distance."""
        grid, pixels = self._classes.grid, self._classes.pixels
        columns = (x + radius_m * RING[0] - grid.x0_m) * grid.px_per_m
        rows = (y + radius_m * RING[1] - grid.y0_m) * grid.px_per_m
        inside = (columns >= 0) & (rows >= 0) & (columns < pixels.shape[1])
        inside &= rows < pixels.shape[0]
        around = pixels[rows[inside].astype(np.int64), columns[inside].astype(np.int64)]
        return not (around & ROAD_BIT).any()

    def _corners(self, prop: Prop, margin_m: float) -> NDArray[np.int32]:
        box = footprint(
            (prop.x, prop.y, prop.heading),
            prop.length_m + 2.0 * margin_m,
            prop.width_m + 2.0 * margin_m,
        )
        return np.asarray(((box - self._origin) * OCCUPANCY_PX_PER_M).round(), np.int32)

    def build(self, prop: Prop, margin_m: float = 0.25) -> bool:
        """Place something on free ground off the streets; returns whether there was room."""
        corners = self._corners(prop, margin_m)
        low, high = corners.min(axis=0), corners.max(axis=0) + 1
        rows, columns = self._taken.shape
        if (low < 0).any() or high[0] > columns or high[1] > rows:
            return False
        part = self._taken[low[1] : high[1], low[0] : high[0]]
        mask = np.zeros_like(part)
        cv2.fillConvexPoly(mask, corners - low, 1)
        if (part & mask).any():
            return False
        part |= mask
        self._add(prop)
        return True

    def _add(self, prop: Prop) -> None:
        self.props.append(prop)
        cell = int(prop.x // CELL_M), int(prop.y // CELL_M)
        self._by_cell.setdefault(cell, []).append(prop)

    def _near(self, x: float, y: float) -> Iterator[Prop]:
        """What stands within 16 m: more than half of the longest prop, so that none is missed."""
        column, row = int(x // CELL_M), int(y // CELL_M)
        for cell in itertools.product(range(column - 1, column + 2), range(row - 1, row + 2)):
            yield from self._by_cell.get(cell, ())

    def stand(self, prop: Prop, clear_m: float = CLEAR_M) -> bool:
        """Place something on a sidewalk or beside it, if it keeps clear of pavement and others."""
        reach = clear_m + math.hypot(prop.length_m, prop.width_m) / 2.0
        if not self.is_clear(prop.x, prop.y, reach):
            return False
        for other in self._near(prop.x, prop.y):
            room = (max(prop.length_m, prop.width_m) + max(other.length_m, other.width_m)) / 2.0
            if abs(other.x - prop.x) < room and abs(other.y - prop.y) < room:
                return False
        self._add(prop)
        return True

    def post(self, x: float, y: float, heading: float, rng: np.random.Generator) -> None:
        """Place a signal post, as far to the side as it takes to stand off the pavement."""
        right = np.array([-math.sin(heading), math.cos(heading)])
        for step in range(40):
            px, py = np.array([x, y]) + 0.1 * step * right
            if self.is_clear(px, py, POST_CLEAR_M):
                x, y = float(px), float(py)
                break
        variant = int(rng.integers(1000))
        self._add(Prop(SIGNAL, x, y, heading, 0.2, 0.2, 3.6, variant))


def _lamps(site: _Site, frontage: Frontage, rng: np.random.Generator) -> None:
    """Street lamps every 25 to 40 m, away from junctions."""
    lane = frontage.lane
    station = rng.uniform(12.0, 25.0)
    while not lane.in_junction and station < lane.length_m - 8.0:
        x, y, heading = frontage.place(station, frontage.kerb_m + 0.95)
        site.stand(Prop(LAMP, x, y, heading, 0.2, 0.2, 6.0, int(rng.integers(1000))))
        station += rng.uniform(25.0, 40.0)


def _buildings(site: _Site, frontage: Frontage, rng: np.random.Generator) -> None:
    """Row houses, houses with yards, gaps with fences."""
    station, end = -2.5, frontage.lane.length_m + 2.5
    while station < end - 5.0:
        width = min(rng.uniform(8.0, 22.0), end - station)
        setback = rng.choice([0.4, 0.8, 2.5, 5.0], p=[0.35, 0.25, 0.2, 0.2])
        built = False
        for depth in rng.uniform(8.0, 14.0) * np.array([1.0, 0.7, 0.45]):
            lateral = frontage.building_line_m + setback + depth / 2.0
            x, y, heading = frontage.place(station + width / 2.0, lateral)
            tall = rng.random() < 0.45
            kind = BUILDING if tall else HOUSE
            height = 3.2 * rng.integers(2, 5) if tall else rng.uniform(3.0, 5.5)
            variant = int(rng.integers(1000))
            built = site.build(Prop(kind, x, y, heading, width, depth, float(height), variant))
            if built:
                break
        if not built:
            station += 3.0
            continue
        if setback >= 2.5:
            _yard(site, frontage, station, width, setback, rng)
        station += width
        gap = rng.choice([0.0, rng.uniform(1.0, 3.0), rng.uniform(4.0, 12.0)], p=[0.3, 0.4, 0.3])
        if gap >= 4.0 and rng.random() < 0.6:
            x, y, heading = frontage.place(station + gap / 2.0, frontage.building_line_m + 0.3)
            height = rng.uniform(0.9, 1.9)
            site.build(Prop(FENCE, x, y, heading, gap - 0.6, 0.1, height, 0), 0.0)
        station += gap


def _yard(
    site: _Site,
    frontage: Frontage,
    station: float,
    width: float,
    setback: float,
    rng: np.random.Generator,
) -> None:
    """A hedge, a parked car or a tree in front of a house."""
    what = rng.random()
    middle = frontage.building_line_m + setback / 2.0
    variant = int(rng.integers(1000))
    if what < 0.35:
        x, y, heading = frontage.place(station + width / 2.0, frontage.building_line_m + 0.5)
        site.build(Prop(HEDGE, x, y, heading, width - 2.0, 0.7, rng.uniform(0.8, 1.6), variant), 0)
    elif what < 0.7 and setback > 4.0 and width > 6.0:
        x, y, heading = frontage.place(station + rng.uniform(3.0, width - 3.0), middle)
        site.build(Prop(CAR, x, y, heading, 4.3, 1.8, 1.5, variant), 0.0)
    else:
        x, y, heading = frontage.place(station + rng.uniform(1.0, width - 1.0), middle)
        site.stand(Prop(TREE, x, y, heading, 0.35, 0.35, rng.uniform(4.0, 9.0), variant))


def _street_trees(
    site: _Site, frontage: Frontage, rng: np.random.Generator, spacing_m: tuple[float, float]
) -> None:
    """Trees on the outer half of the sidewalk, their crowns over it."""
    walk_m = frontage.building_line_m - frontage.kerb_m
    station = rng.uniform(1.0, spacing_m[1])
    while station < frontage.lane.length_m:
        lateral = frontage.kerb_m + walk_m * rng.uniform(0.55, 0.85)
        x, y, heading = frontage.place(station, lateral)
        height, variant = rng.uniform(4.5, 8.5), int(rng.integers(1000))
        clear_m = min(1.2, 0.5 * walk_m)
        site.stand(Prop(TREE, x, y, heading, 0.35, 0.35, height, variant), clear_m)
        station += rng.uniform(*spacing_m)


def _shelters(site: _Site, frontage: Frontage, rng: np.random.Generator) -> None:
    """A bus shelter on some of the longer streets."""
    lane = frontage.lane
    if lane.in_junction or lane.length_m < 45.0 or rng.random() < 0.4:
        return
    walk_m = frontage.building_line_m - frontage.kerb_m
    lateral = frontage.kerb_m + max(1.6, walk_m - 0.9)
    x, y, heading = frontage.place(rng.uniform(15.0, lane.length_m - 15.0), lateral)
    variant = int(rng.integers(1000))
    site.stand(Prop(SHELTER, x, y, heading, 3.6, 1.3, 2.5, variant), 0.3)


def _clutter(site: _Site, frontages: list[Frontage], rng: np.random.Generator) -> None:
    """What makes ``hard`` hard: hedges, pillars and cars on the sidewalks, and more trees."""
    for frontage in frontages:
        _street_trees(site, frontage, rng, spacing_m=(5.0, 14.0))
        station = rng.uniform(2.0, 14.0)
        while station < frontage.lane.length_m - 2.0:
            kind = int(rng.choice([HEDGE, PILLAR, CAR], p=[0.4, 0.25, 0.35]))
            length, width, height = {
                HEDGE: (rng.uniform(2.0, 6.0), 0.8, rng.uniform(1.0, 2.0)),
                PILLAR: (1.2, 1.2, 3.0),
                CAR: (rng.uniform(4.2, 5.4), 1.9, rng.uniform(1.5, 2.3)),
            }[kind]
            x, y, heading = frontage.place(station, frontage.kerb_m + 0.6 + width / 2.0)
            prop = Prop(kind, x, y, heading, length, width, height, int(rng.integers(1000)))
            along = np.array([math.cos(heading), math.sin(heading)]) * length / 2.0
            spots = [(x, y) + share * along for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
            if all(site.is_clear(px, py, width / 2.0 + CLUTTER_CLEAR_M) for px, py in spots):
                site.stand(prop, -length / 2.0)
            station += length + rng.uniform(6.0, 22.0)
