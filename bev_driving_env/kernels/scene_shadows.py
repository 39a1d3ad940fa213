"""Which shadows fall on the ground that a camera sees."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .actors import PERSON, actor_variant, vehicle_height
from .jit import leaf_kernel
from .layout import HEADING, LENGTH, WIDTH, X, Y
from .people import person_height
from .scenery import BOXES, CARS, GABLES, SPRITES, Nearby, Scenery
from .shadows import cast_box, cast_crown, cast_vehicle
from .shapes import FOLIAGE, Lighting, Records
from .view import Ego, View

SHADOWS_M = 35.0


@leaf_kernel
def is_near(ego: Ego, x: float, y: float, reach_m: float) -> bool:
    """Whether a shadow that reaches so far can fall where shadows are drawn."""
    reach = SHADOWS_M + min(reach_m, SHADOWS_M)
    return (x - ego.x) ** 2 + (y - ego.y) ** 2 < reach * reach


@leaf_kernel
def cast_shadows(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    ego: Ego,
    vehicles: NDArray,
    pedestrians: NDArray,
    sunny: bool,
    looks: int,
    hull: NDArray,
) -> None:
    """All shadows on the ground that a camera may see."""
    for k in range(vehicles.shape[0]):
        if vehicles[k, LENGTH] > 0.0:
            cast_vehicle(
                view, records, lighting, vehicles[k, X], vehicles[k, Y], vehicles[k, HEADING],
                vehicles[k, LENGTH], vehicles[k, WIDTH], vehicle_height(vehicles[k, LENGTH]),
                sunny, hull,
            )  # fmt: skip
    for i in range(nearby.counts[CARS]):
        car = scenery.cars[nearby.cars[i]]
        cast_vehicle(
            view, records, lighting, car[0], car[1], car[2], car[3], car[4], car[5], sunny, hull
        )
    if not sunny:
        return
    cast_box(
        view, records, lighting, ego.x, ego.y, math.cos(ego.heading), math.sin(ego.heading),
        ego.length_m / 2.0, ego.width_m / 2.0, 0.02, 1.4, hull,
    )  # fmt: skip
    for i in range(nearby.counts[BOXES]):
        box = scenery.boxes[nearby.boxes[i]]
        if box[7] - box[6] > 0.6 and is_near(ego, box[0], box[1], box[4] + 5.0 * box[7]):
            cast_box(
                view, records, lighting, box[0], box[1], box[2], box[3], box[4], box[5], box[6],
                box[7], hull,
            )  # fmt: skip
    for i in range(nearby.counts[GABLES]):
        row = scenery.gables[nearby.gables[i]]
        if is_near(ego, row[0], row[1], row[4] + 5.0 * row[7]):
            cast_box(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4], 0.3, 0.0, row[7],
                hull,
            )  # fmt: skip
    for i in range(nearby.counts[SPRITES]):
        row = scenery.sprites[nearby.sprites[i]]
        if not is_near(ego, row[0], row[1], 5.0 * row[2]):
            continue
        if int(row[7]) == FOLIAGE:
            cast_crown(view, records, lighting, row[0], row[1], row[2], row[3], row[4])
        else:
            cast_box(
                view, records, lighting, row[0], row[1], 1.0, 0.0, row[3], row[3],
                row[2] - row[4], row[2] + row[4], hull,
            )  # fmt: skip
    for k in range(pedestrians.shape[0]):
        if pedestrians[k, LENGTH] > 0.0:
            height = person_height(pedestrians[k, WIDTH], actor_variant(looks, PERSON + k))
            cast_box(
                view, records, lighting, pedestrians[k, X], pedestrians[k, Y], 1.0, 0.0, 0.22, 0.22,
                0.0, height, hull,
            )  # fmt: skip
