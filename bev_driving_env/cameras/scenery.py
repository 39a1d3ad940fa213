"""From furniture to the shapes that cameras see."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels import paints as paint
from ..kernels.layout import ROAD_BIT
from ..kernels.scenery import Scenery
from ..kernels.shapes import BRICKS, EMISSIVE, FACADE, FACADES, FOLIAGE, GLASS, PLAIN, POSTER, SLATS
from ..towns.furniture import (
    BUILDING,
    CAR,
    FENCE,
    HEDGE,
    HOUSE,
    LAMP,
    PILLAR,
    SHELTER,
    SIGNAL,
    TREE,
    Prop,
)

if TYPE_CHECKING:
    from ..towns.compiled import CompiledTown

KERB_PIECE_M = 8.0
KERB_TOLERANCE_PX = 0.6

Row = tuple[float, ...]


class _Tables:
    """Rows of the scenery's tables, collected prop by prop."""

    def __init__(self) -> None:
        self.boxes: list[Row] = []
        self.gables: list[Row] = []
        self.sprites: list[Row] = []
        self.cars: list[Row] = []
        self.signals: list[Row] = []

    def box(
        self,
        prop: Prop,
        slot: int,
        pattern: int,
        top_slot: int,
        *,
        ahead: float = 0.0,
        right: float = 0.0,
        length: float | None = None,
        width: float | None = None,
        low: float = 0.0,
        high: float | None = None,
    ) -> None:
        """Add a box placed relative to a prop, of the prop's size unless told otherwise."""
        cos, sin = math.cos(prop.heading), math.sin(prop.heading)
        x, y = prop.x + ahead * cos - right * sin, prop.y + ahead * sin + right * cos
        half_length = (prop.length_m if length is None else length) / 2.0
        half_width = (prop.width_m if width is None else width) / 2.0
        top = prop.height_m if high is None else high
        self.boxes.append(
            (
                *(x, y, cos, sin, half_length, half_width, low, top),
                *(slot, pattern, top_slot, prop.variant),
            )
        )

    def sprite(
        self,
        prop: Prop,
        low: float,
        high: float,
        half_width: float,
        slot: int,
        pattern: int,
        *,
        disc: bool = False,
        offset: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add a shape that turns to the camera, between two heights."""
        self.sprites.append(
            (
                *(prop.x + offset[0], prop.y + offset[1], (low + high) / 2.0),
                *(half_width, (high - low) / 2.0, float(disc), slot, pattern, prop.variant),
            )
        )


def _building(tables: _Tables, prop: Prop) -> None:
    wall = paint.WALL + prop.variant % paint.WALLS
    roof = paint.ROOF + prop.variant // 8 % paint.ROOFS
    tables.box(prop, wall, FACADE + prop.variant // 32 % FACADES, roof)
    cap = prop.height_m + 0.5
    size = {"length": prop.length_m + 0.3, "width": prop.width_m + 0.3}
    tables.box(prop, roof, PLAIN, roof, low=prop.height_m, high=cap, **size)


def _house(tables: _Tables, prop: Prop) -> None:
    wall = paint.WALL + prop.variant % paint.WALLS
    roof = paint.ROOF + prop.variant // 8 % paint.ROOFS
    tables.box(prop, wall, FACADE + prop.variant // 32 % FACADES, roof)
    # the ridge runs along the street or, on narrow lots, away from it
    turn = 0.0 if prop.length_m >= prop.width_m else math.pi / 2.0
    cos, sin = math.cos(prop.heading + turn), math.sin(prop.heading + turn)
    long, short = (prop.length_m, prop.width_m)[:: 1 if turn == 0.0 else -1]
    ridge = prop.height_m + short / 2.0 * (0.5 + 0.05 * (prop.variant % 7))
    tables.gables.append(
        (
            *(prop.x, prop.y, cos, sin, long / 2.0, short / 2.0),
            *(prop.height_m, ridge, wall, roof, prop.variant),
        )
    )


def _tree(tables: _Tables, prop: Prop) -> None:
    height, variant = prop.height_m, prop.variant
    leaf = paint.LEAF + variant % paint.LEAVES
    radius = min(0.30 * height, 2.3)
    tables.sprite(prop, 0.0, 0.55 * height, 0.13 + 0.012 * height, paint.TRUNK, BRICKS)
    tables.sprite(prop, 0.36 * height, height, radius, leaf, FOLIAGE, disc=True)
    for k, angle in enumerate((variant * 0.7, variant * 0.7 + 2.4)):
        offset = 0.55 * radius * math.cos(angle), 0.55 * radius * math.sin(angle)
        low = (0.34 + 0.1 * k) * height
        tables.sprite(
            prop, low, low + 0.45 * height, 0.72 * radius, leaf, FOLIAGE, disc=True, offset=offset
        )


def _lamp(tables: _Tables, prop: Prop) -> None:
    tables.sprite(prop, 0.0, prop.height_m, 0.06, paint.METAL, PLAIN)
    high = prop.height_m
    tables.box(
        prop, paint.METAL, PLAIN, paint.METAL, right=-0.9, length=0.1, width=1.8, low=high - 0.1
    )
    tables.box(
        prop, paint.LAMP, EMISSIVE, paint.METAL, right=-1.7, length=0.22, width=0.6,
        low=high - 0.22, high=high - 0.1,
    )  # fmt: skip


def _shelter(tables: _Tables, prop: Prop) -> None:
    high = prop.height_m
    back = prop.width_m / 2.0 - 0.05
    tables.box(prop, paint.METAL, PLAIN, paint.METAL, low=high - 0.15, length=prop.length_m + 0.4)
    tables.box(prop, paint.GLASS, GLASS, paint.METAL, right=back, width=0.06, high=high - 0.15)
    for end in (-0.5, 0.5):
        poster = paint.POSTER + prop.variant % paint.POSTERS
        tables.box(
            prop, poster if end > 0.0 else paint.GLASS, POSTER if end > 0.0 else GLASS,
            paint.METAL, ahead=end * prop.length_m, length=0.08, high=high - 0.15,
        )  # fmt: skip
    tables.box(
        prop, paint.FENCE, PLAIN, paint.FENCE, right=back - 0.3, width=0.4, low=0.4, high=0.5,
        length=prop.length_m - 0.8,
    )  # fmt: skip


def _fence(tables: _Tables, prop: Prop) -> None:
    tables.box(prop, paint.FENCE, SLATS, paint.FENCE)


def _hedge(tables: _Tables, prop: Prop) -> None:
    tables.box(prop, paint.HEDGE, FOLIAGE, paint.HEDGE)


def _pillar(tables: _Tables, prop: Prop) -> None:
    tables.box(prop, paint.POSTER + prop.variant % paint.POSTERS, POSTER, paint.METAL)


def _car(tables: _Tables, prop: Prop) -> None:
    tables.cars.append((*prop[1:7], prop.variant))


def _signal(tables: _Tables, prop: Prop) -> None:
    # its heading is that of the traffic it stops
    tables.signals.append((prop.x, prop.y, -math.cos(prop.heading), -math.sin(prop.heading)))


_SHAPES = {
    BUILDING: _building,
    HOUSE: _house,
    TREE: _tree,
    LAMP: _lamp,
    SIGNAL: _signal,
    FENCE: _fence,
    HEDGE: _hedge,
    SHELTER: _shelter,
    CAR: _car,
    PILLAR: _pillar,
}


def build_scenery(town: CompiledTown, props: Iterable[Prop]) -> Scenery:
    """The shapes of a town's furniture and kerbs.

    Args:
        town: The town.
        props: Its furniture.
    """
    tables = _Tables()
    for prop in props:
        _SHAPES[prop.kind](tables, prop)
    return Scenery(
        boxes=np.array(tables.boxes, np.float64).reshape(-1, 12),
        gables=np.array(tables.gables, np.float64).reshape(-1, 11),
        sprites=np.array(tables.sprites, np.float64).reshape(-1, 9),
        cars=np.array(tables.cars, np.float64).reshape(-1, 7),
        kerbs=kerb_lines(town),
        signals=np.array(tables.signals, np.float64).reshape(-1, 4),
    )


def kerb_lines(town: CompiledTown) -> NDArray[np.float64]:
    """Kerbs as pieces (E, 4) of at most 8 m, x0, y0, x1, y1; none without sidewalks."""
    if town.cross_section.sidewalk_m == 0.0:
        return np.zeros((0, 4))
    raster = town.classes()
    road = (raster.pixels & ROAD_BIT).astype(np.uint8)
    outlines, _ = cv2.findContours(road, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    pieces: list[NDArray[np.float64]] = []
    for outline in outlines:
        corners = cv2.approxPolyDP(outline, KERB_TOLERANCE_PX, True)[:, 0].astype(np.float64)
        corners = (corners + 0.5) / raster.grid.px_per_m
        corners += (raster.grid.x0_m, raster.grid.y0_m)
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            length = float(np.hypot(*(end - start)))
            count = math.ceil(length / KERB_PIECE_M)
            if count:
                stops = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
                pieces.append(np.hstack([stops[:-1], stops[1:]]))
    return np.concatenate(pieces) if pieces else np.zeros((0, 4))
