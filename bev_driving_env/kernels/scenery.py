"""What cameras see of a town and its actors, shape by shape."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import paints as paint
from .actors import (
    PARKED,
    PERSON,
    actor_variant,
    draw_signal,
    draw_vehicle,
    vehicle_height,
)
from .jit import leaf_kernel
from .layout import HEADING, LENGTH, SPEED, WIDTH, X, Y
from .occlusion import Skyline, is_hidden, nearest_first, raise_skyline, within_reach
from .people import draw_person
from .shapes import (
    BRICKS,
    TWO_SIDED,
    Lighting,
    Records,
    draw_box,
    draw_gable,
    draw_sprite,
    draw_wall,
)
from .view import Ego, View, may_see

SIGHT_M = 150.0
TREES_M = 90.0
CARS_M = 70.0
KERBS_M = 28.0
PEOPLE_M = 60.0
DETAIL = 60.0
"""Boxes are drawn up to this many times their size away."""
BOXES, GABLES, SPRITES, CARS, KERBS = range(5)
KERB_HEIGHT_M = 0.12
TALLEST_M = 2.0
"""Nobody is taller."""
STANDING_MPS = 0.3
"""Slower vehicles show their brake lights; slower people have their feet together."""


class Scenery(NamedTuple):
    """Everything upright that does not move, as tables; built by ``cameras.scenery``.

    Attributes:
        boxes: (B, 12) x, y, cos, sin, half length, half width, low, high, slot, pattern, slot of
            the top, variant.
        gables: (G, 11) x, y, cos, sin, half length, half width, eaves, ridge, slot, slot of the
            roof, variant.
        sprites: (S, 9) x, y, z, half width, half height, round, slot, pattern, variant.
        cars: (K, 7) x, y, heading, length, width, height, variant.
        kerbs: (E, 4) end points x0, y0, x1, y1.
        signals: (S, 4) x, y and the direction that the head faces; in the order of the town's.
    """

    boxes: NDArray[np.float64]
    gables: NDArray[np.float64]
    sprites: NDArray[np.float64]
    cars: NDArray[np.float64]
    kerbs: NDArray[np.float64]
    signals: NDArray[np.float64]


class Nearby(NamedTuple):
    """Rows of the scenery's tables that are near enough to be seen, boxes and gables in order.

    Attributes:
        counts: (5,) how many rows of each table.
        distances: (rows of the largest table,) scratch for sorting.
        boxes: (B,) their numbers, the nearest first.
        gables: (G,) likewise.
        sprites: (S,) in any order, as the next two.
        cars: (K,).
        kerbs: (E,).
    """

    counts: NDArray[np.int64]
    distances: NDArray[np.float64]
    boxes: NDArray[np.int64]
    gables: NDArray[np.int64]
    sprites: NDArray[np.int64]
    cars: NDArray[np.int64]
    kerbs: NDArray[np.int64]


@leaf_kernel
def find_nearby(scenery: Scenery, ego: Ego, nearby: Nearby) -> None:
    """List what is near enough to be seen, the nearest first, once for all cameras."""
    x, y = ego.x, ego.y
    counts = nearby.counts
    keys = nearby.distances
    counts[BOXES] = nearest_first(
        scenery.boxes, scenery.boxes[:, 4], x, y, SIGHT_M, keys, nearby.boxes
    )
    counts[GABLES] = nearest_first(
        scenery.gables, scenery.gables[:, 4], x, y, SIGHT_M, keys, nearby.gables
    )
    counts[SPRITES] = within_reach(scenery.sprites, x, y, TREES_M, nearby.sprites)
    counts[CARS] = within_reach(scenery.cars, x, y, CARS_M, nearby.cars)
    counts[KERBS] = within_reach(scenery.kerbs, x, y, KERBS_M, nearby.kerbs)


@leaf_kernel
def draw_buildings(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    skyline: Skyline,
) -> None:
    """Boxes and gables, front to back, leaving out what nearer buildings hide."""
    boxes = scenery.boxes
    for i in range(nearby.counts[BOXES]):
        box = boxes[nearby.boxes[i]]
        radius = math.sqrt(box[4] ** 2 + box[5] ** 2)
        size = radius + box[7] - box[6]
        if not may_see(view, box[0], box[1], radius, DETAIL * size):
            continue
        if is_hidden(view, skyline, box[0], box[1], radius, box[7]):
            continue
        draw_box(
            view, records, lighting, box[0], box[1], box[2], box[3], box[4], box[5],
            box[6], box[7], int(box[8]), int(box[9]), int(box[10]), int(box[11]),
        )  # fmt: skip
        if box[6] == 0.0 and box[7] > view.place[2]:
            hide_behind(view, skyline, box)
    gables = scenery.gables
    for i in range(nearby.counts[GABLES]):
        row = gables[nearby.gables[i]]
        radius = math.sqrt(row[4] ** 2 + row[5] ** 2) + 1.0
        if may_see(view, row[0], row[1], radius, SIGHT_M) and not is_hidden(
            view, skyline, row[0], row[1], radius, row[7]
        ):
            draw_gable(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4], row[5],
                row[6], row[7], int(row[8]), int(row[9]), int(row[10]),
            )  # fmt: skip


@leaf_kernel
def hide_behind(view: View, skyline: Skyline, box: NDArray) -> None:
    """Raise the skyline by the two diagonals of a box: each hides what is behind the box."""
    ax, ay = box[2] * box[4], box[3] * box[4]
    bx, by = -box[3] * box[5], box[2] * box[5]
    x, y = box[0], box[1]
    raise_skyline(view, skyline, x + ax + bx, y + ay + by, x - ax - bx, y - ay - by, box[7])
    raise_skyline(view, skyline, x + ax - bx, y + ay - by, x - ax + bx, y - ay + by, box[7])


@leaf_kernel
def draw_street(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    skyline: Skyline,
) -> None:
    """Trees, poles, parked cars and kerbs, after the buildings that may hide them."""
    for i in range(nearby.counts[SPRITES]):
        row = scenery.sprites[nearby.sprites[i]]
        if may_see(view, row[0], row[1], row[3], TREES_M) and not is_hidden(
            view, skyline, row[0], row[1], row[3], row[2] + row[4]
        ):
            draw_sprite(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4],
                row[5] > 0.0, int(row[6]), int(row[7]), int(row[8]),
            )  # fmt: skip
    for i in range(nearby.counts[CARS]):
        car = scenery.cars[nearby.cars[i]]
        if may_see(view, car[0], car[1], car[3], CARS_M) and not is_hidden(
            view, skyline, car[0], car[1], car[3], car[5]
        ):
            draw_vehicle(
                view, records, lighting, car[0], car[1], car[2], car[3], car[4], car[5],
                PARKED, int(car[6]),
            )  # fmt: skip
    for i in range(nearby.counts[KERBS]):
        kerb = scenery.kerbs[nearby.kerbs[i]]
        x, y = (kerb[0] + kerb[2]) / 2.0, (kerb[1] + kerb[3]) / 2.0
        if may_see(view, x, y, 5.0, KERBS_M):
            draw_wall(
                view, records, lighting, kerb[0], kerb[1], kerb[2], kerb[3], 0.0,
                KERB_HEIGHT_M, paint.KERB, BRICKS, nearby.kerbs[i], TWO_SIDED,
            )  # fmt: skip


@leaf_kernel
def draw_actors(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    skyline: Skyline,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
    looks: int,
) -> None:
    """Vehicles, people and signal heads; the episode and a row's number decide its looks."""
    for k in range(vehicles.shape[0]):
        x, y, length = vehicles[k, X], vehicles[k, Y], vehicles[k, LENGTH]
        if length <= 0.0 or not may_see(view, x, y, length, SIGHT_M):
            continue
        height = vehicle_height(length)
        # riders are taller than their motorbikes
        if not is_hidden(view, skyline, x, y, length, max(height, TALLEST_M)):
            draw_vehicle(
                view, records, lighting, x, y, vehicles[k, HEADING], length, vehicles[k, WIDTH],
                height, vehicles[k, SPEED] < STANDING_MPS, actor_variant(looks, k),
            )  # fmt: skip
    for k in range(pedestrians.shape[0]):
        x, y, size = pedestrians[k, X], pedestrians[k, Y], pedestrians[k, LENGTH]
        if size <= 0.0 or not may_see(view, x, y, 1.0, PEOPLE_M):
            continue
        if not is_hidden(view, skyline, x, y, 1.0, TALLEST_M):
            draw_person(
                view, records, lighting, x, y, pedestrians[k, HEADING], pedestrians[k, WIDTH],
                pedestrians[k, SPEED] > STANDING_MPS, actor_variant(looks, PERSON + k),
            )  # fmt: skip
    heads = scenery.signals
    for k in range(heads.shape[0]):
        if may_see(view, heads[k, 0], heads[k, 1], 1.0, TREES_M):
            draw_signal(
                view, records, lighting, heads[k, 0], heads[k, 1], heads[k, 2],
                heads[k, 3], signals[k],
            )  # fmt: skip
