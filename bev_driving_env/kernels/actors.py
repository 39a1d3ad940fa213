"""Vehicles and signal heads, put together from shapes."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from . import paints as paint
from .jit import leaf_kernel
from .layout import SIGNAL_GREEN, SIGNAL_RED, SIGNAL_YELLOW
from .noise import mix
from .shapes import (
    EMISSIVE,
    FLAT,
    GLASS,
    NO_VARIANT,
    PLAIN,
    ROUND,
    Lighting,
    Records,
    draw_box,
    draw_disc,
    draw_sprite,
)
from .view import View

SIGNAL_HEAD_M = 2.9
"""Height of the middle of a signal head."""
BIKE_LENGTH_M, VAN_LENGTH_M, TRUCK_LENGTH_M = 3.0, 5.1, 6.5
"""Shorter than the first is a motorbike; from the others on, a van and a truck."""
VAN_HEIGHT_M, TRUCK_HEIGHT_M = 1.7, 2.6
"""From these heights on, a vehicle has the shape of a van, or of a truck."""
DETAIL_M = 45.0
"""Lamps and wheels are drawn up to this distance."""
PARKED = cast("bool", np.array([False])[0])
"""Not braking; of numpy's type, see ``shapes``."""
PERSON = 1 << 20
"""Added to the number of a pedestrian, to tell it from a vehicle."""


@leaf_kernel
def actor_variant(looks: int, number: int) -> int:
    """What decides the paint or the clothes of an actor.

    Args:
        looks: Random number of the episode.
        number: Number of the vehicle's row, or ``PERSON`` and that of the pedestrian's.

    Returns:
        A random number from 0 to 2^24 - 1.
    """
    return int(mix(looks, number) >> np.uint64(40))


@leaf_kernel
def vehicle_height(length_m: float) -> float:
    """Height of a vehicle of some length: motorbike, car, van or truck."""
    if length_m < BIKE_LENGTH_M:
        return 1.2
    if length_m < VAN_LENGTH_M:
        return 1.5
    return 2.15 if length_m < TRUCK_LENGTH_M else 3.0


@leaf_kernel
def draw_vehicle(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    heading: float,
    length_m: float,
    width_m: float,
    height_m: float,
    braking: bool,
    variant: int,
) -> None:
    """A vehicle: body, cabin with windows, wheels, head and tail lamps."""
    cos, sin = math.cos(heading), math.sin(heading)
    body = paint.CAR + variant % paint.CARS
    half, side = length_m / 2.0, width_m / 2.0
    detailed = abs(view.place[0] - x) + abs(view.place[1] - y) <= DETAIL_M
    if length_m < BIKE_LENGTH_M:
        draw_bike(view, records, lighting, x, y, cos, sin, half, body, detailed, braking, variant)
        return
    # from back to front, in half lengths: the painted lower body, the cabin with glass all round
    # under a roof, and the load space of vans and trucks
    truck, van = height_m > TRUCK_HEIGHT_M, height_m > VAN_HEIGHT_M
    style = (variant // paint.CARS) % 3
    if truck:
        sill, belt, roof = 0.45, 1.35, 2.1
        body_back, cab, load = 0.60, (0.60, 0.96), (-1.0, 0.56)
    elif van:
        sill, belt, roof = 0.28, 0.5 * height_m, height_m - 0.1
        body_back, cab, load = -1.0, (0.30, 0.74), (-0.98, 0.32)
    else:
        # saloon, hatchback or estate
        sill, belt, roof = 0.28, 0.58 * height_m, height_m - 0.06
        body_back, cab, load = -1.0, (-0.68 - 0.12 * style, 0.34), (0.0, 0.0)
    middle, extent = (1.0 + body_back) / 2.0 * half, (1.0 - body_back) / 2.0 * half
    draw_box(
        view, records, lighting, x + cos * middle, y + sin * middle, cos, sin, extent, side,
        sill, belt, body, PLAIN, body, variant,
    )  # fmt: skip
    middle, extent = (cab[0] + cab[1]) / 2.0 * half, (cab[1] - cab[0]) / 2.0 * half
    cx, cy = x + cos * middle, y + sin * middle
    draw_box(
        view, records, lighting, cx, cy, cos, sin, extent, side * 0.88, belt, roof, paint.GLASS,
        GLASS, body, variant,
    )  # fmt: skip
    draw_box(
        view, records, lighting, cx, cy, cos, sin, extent * 0.9, side * 0.86, roof,
        min(height_m, roof + 0.25), body, PLAIN, body, variant,
    )  # fmt: skip
    if van:
        middle, extent = (load[0] + load[1]) / 2.0 * half, (load[1] - load[0]) / 2.0 * half
        cx, cy = x + cos * middle, y + sin * middle
        # a truck's box has a colour of its own, above a dark frame
        slot = paint.CAR + style if truck else body
        bottom = 0.85 if truck else belt
        draw_box(
            view, records, lighting, cx, cy, cos, sin, extent, side * (1.0 if truck else 0.94),
            bottom, height_m, slot, PLAIN, slot, variant,
        )  # fmt: skip
        if truck:
            draw_box(
                view, records, lighting, cx, cy, cos, sin, extent, side * 0.8, 0.5, 0.85,
                paint.TYRE, PLAIN, paint.TYRE, variant,
            )  # fmt: skip
    if not detailed:
        return
    radius = 0.46 if truck else 0.33
    front_axle = 0.74 if truck else 0.62
    tail = paint.LENS_RED if braking else paint.TAILLIGHT
    for end in (-0.62, front_axle):
        for hand in (-1.0, 1.0):
            wx = x + cos * half * end - sin * (side + 0.01) * hand
            wy = y + sin * half * end + cos * (side + 0.01) * hand
            draw_disc(
                view, records, lighting, wx, wy, radius, -sin * hand, cos * hand, radius,
                radius, paint.TYRE, PLAIN, variant,
            )  # fmt: skip
            lx = x - sin * side * 0.72 * hand
            ly = y + cos * side * 0.72 * hand
            if end > 0.0:
                draw_disc(
                    view, records, lighting, lx + cos * (half + 0.01),
                    ly + sin * (half + 0.01), 0.68, cos, sin, 0.2, 0.11, paint.HEADLIGHT, EMISSIVE,
                    variant,
                )  # fmt: skip
            else:
                draw_disc(
                    view, records, lighting, lx - cos * (half + 0.01),
                    ly - sin * (half + 0.01), 0.74, -cos, -sin, 0.18, 0.1, tail, EMISSIVE,
                    variant,
                )  # fmt: skip


@leaf_kernel
def draw_bike(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    cos: float,
    sin: float,
    half: float,
    body: int,
    detailed: bool,
    braking: bool,
    variant: int,
) -> None:
    """A motorbike and its rider."""
    draw_box(
        view, records, lighting, x, y, cos, sin, 0.62 * half, 0.15, 0.4, 0.82, body, PLAIN, body,
        variant,
    )  # fmt: skip
    clothes = paint.CLOTH + variant % paint.CLOTHES
    draw_sprite(
        view, records, lighting, x - 0.15 * cos, y - 0.15 * sin, 1.12, 0.24, 0.4, FLAT, clothes,
        PLAIN, variant,
    )  # fmt: skip
    helmet = paint.CAR + (variant // paint.CARS) % paint.CARS
    draw_sprite(view, records, lighting, x, y, 1.64, 0.14, 0.15, ROUND, helmet, PLAIN, variant)
    for end in (-1.0, 1.0):
        # a wheel is seen edge-on, too: a narrow box inside the disc
        wx, wy = x + 0.66 * half * end * cos, y + 0.66 * half * end * sin
        draw_box(
            view, records, lighting, wx, wy, cos, sin, 0.17, 0.07, 0.06, 0.56, paint.TYRE, PLAIN,
            paint.TYRE, variant,
        )  # fmt: skip
        if not detailed:
            continue
        for hand in (-0.08, 0.08):
            draw_disc(
                view, records, lighting, wx - sin * hand, wy + cos * hand, 0.31,
                math.copysign(1.0, hand) * -sin, math.copysign(1.0, hand) * cos, 0.31, 0.31,
                paint.TYRE, PLAIN, variant,
            )  # fmt: skip
        lamp = paint.LENS_RED if braking else paint.TAILLIGHT
        draw_disc(
            view, records, lighting, x + 0.64 * half * end * cos, y + 0.64 * half * end * sin, 0.75,
            end * cos, end * sin, 0.1, 0.09, paint.HEADLIGHT if end > 0.0 else lamp, EMISSIVE,
            variant,
        )  # fmt: skip


@leaf_kernel
def draw_signal(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    cos: float,
    sin: float,
    state: int,
) -> None:
    """A signal post with a head of three lamps that faces (cos, sin)."""
    draw_sprite(
        view, records, lighting, x, y, 1.2, 0.08, 1.25, FLAT, paint.METAL, PLAIN, NO_VARIANT
    )
    draw_box(
        view, records, lighting, x, y, cos, sin, 0.16, 0.24, SIGNAL_HEAD_M - 0.5,
        SIGNAL_HEAD_M + 0.55, paint.HOUSING, PLAIN, paint.HOUSING, NO_VARIANT,
    )  # fmt: skip
    lit = (state == SIGNAL_RED, state == SIGNAL_YELLOW, state == SIGNAL_GREEN)
    for k in range(3):
        slot = paint.LENS_RED + k if lit[k] else paint.LENS_OFF
        draw_disc(
            view, records, lighting, x + 0.17 * cos, y + 0.17 * sin,
            SIGNAL_HEAD_M + 0.34 - 0.32 * k, cos, sin, 0.14, 0.14, slot,
            EMISSIVE if lit[k] else PLAIN, NO_VARIANT,
        )  # fmt: skip
