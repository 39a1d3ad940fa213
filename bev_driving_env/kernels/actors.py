"""Vehicles, people and signal heads, put together from shapes."""

from __future__ import annotations

import math

from . import paints as paint
from .jit import kernel
from .layout import SIGNAL_GREEN, SIGNAL_RED, SIGNAL_YELLOW
from .shapes import (
    EMISSIVE,
    FLAT,
    GLASS,
    NO_VARIANT,
    PLAIN,
    ROUND,
    SLATS,
    Lighting,
    Records,
    draw_box,
    draw_disc,
    draw_sprite,
)
from .view import View

SIGNAL_HEAD_M = 2.9
"""Height of the middle of a signal head."""
TRUCK_LENGTH_M, BIKE_LENGTH_M = 6.5, 3.0
DETAIL_M = 45.0
"""Lamps and wheels are drawn up to this distance."""


@kernel
def vehicle_height(length_m: float) -> float:
    """Height of a vehicle of some length: motorbike, car, or truck."""
    if length_m < BIKE_LENGTH_M:
        return 1.2
    return 1.5 if length_m < TRUCK_LENGTH_M else 3.0


@kernel
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
    variant: int,
) -> None:
    """A vehicle: body, cabin with windows, wheels, head and tail lamps."""
    cos, sin = math.cos(heading), math.sin(heading)
    body = paint.CAR + variant % paint.CARS
    half, side = length_m / 2.0, width_m / 2.0
    if length_m < BIKE_LENGTH_M:
        draw_bike(view, records, lighting, x, y, cos, sin, half, side, body, variant)
        return
    boxy = height_m > 1.7
    sill, belt = 0.28, (0.62 if boxy else 0.58) * height_m
    draw_box(
        view, records, lighting, x, y, cos, sin, half, side, sill, belt, body, PLAIN, body,
        variant,
    )  # fmt: skip
    # the cabin: glass all round under a painted roof
    back, front = (0.0, 0.80) if boxy else (0.16, 0.66)
    extent = (front - back) * half
    middle = -0.16 * half if boxy else (1.0 - back - front) * half
    cx, cy = x + cos * middle, y + sin * middle
    top = height_m - 0.06
    draw_box(
        view, records, lighting, cx, cy, cos, sin, extent, side * 0.88, belt, top,
        paint.GLASS, GLASS, body, variant,
    )  # fmt: skip
    draw_box(
        view, records, lighting, cx, cy, cos, sin, extent * 0.9, side * 0.86, top, height_m,
        body, PLAIN, body, variant,
    )  # fmt: skip
    if abs(view.place[0] - x) + abs(view.place[1] - y) > DETAIL_M:
        return
    radius = min(0.34, 0.24 * height_m)
    for end in (-0.62, 0.62):
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
                    ly - sin * (half + 0.01), 0.74, -cos, -sin, 0.18, 0.1, paint.TAILLIGHT,
                    EMISSIVE, variant,
                )  # fmt: skip


@kernel
def draw_bike(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    cos: float,
    sin: float,
    half: float,
    side: float,
    body: int,
    variant: int,
) -> None:
    """A motorbike and its rider."""
    draw_box(
        view, records, lighting, x, y, cos, sin, half, min(side, 0.16), 0.15, 0.85, body,
        PLAIN, body, variant,
    )  # fmt: skip
    draw_sprite(
        view, records, lighting, x - 0.15 * cos, y - 0.15 * sin, 1.15, 0.26, 0.4, FLAT,
        paint.CLOTH + variant % paint.CLOTHES, PLAIN, variant,
    )  # fmt: skip
    draw_sprite(view, records, lighting, x, y, 1.68, 0.15, 0.16, ROUND, paint.TYRE, PLAIN, variant)


@kernel
def draw_person(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    width_m: float,
    height_m: float,
    variant: int,
) -> None:
    """A standing or walking person: legs, trunk and head."""
    half = max(0.18, 0.4 * width_m)
    hip, neck = 0.46 * height_m, 0.84 * height_m
    lower = paint.CLOTH + (variant // 8) % paint.CLOTHES
    upper = paint.CLOTH + variant % paint.CLOTHES
    skin = paint.SKIN + variant % paint.SKINS
    draw_sprite(
        view, records, lighting, x, y, hip / 2.0, 0.72 * half, hip / 2.0, FLAT, lower,
        SLATS, variant,
    )  # fmt: skip
    draw_sprite(
        view, records, lighting, x, y, (hip + neck) / 2.0, half, (neck - hip) / 2.0, FLAT,
        upper, PLAIN, variant,
    )  # fmt: skip
    draw_sprite(
        view, records, lighting, x, y, 0.92 * height_m, 0.09 * height_m, 0.085 * height_m,
        ROUND, skin, PLAIN, variant,
    )  # fmt: skip


@kernel
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
