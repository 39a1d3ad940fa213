"""People, put together from shapes."""

from __future__ import annotations

import math

from . import paints as paint
from .jit import leaf_kernel
from .shapes import FLAT, PLAIN, ROUND, SLATS, Lighting, Records, draw_sprite, draw_strip
from .view import View

DETAIL_M = 25.0
"""Arms, hair and bags are drawn up to this distance."""
STRIDE_M, SWING = 0.82, 0.20
"""Length of two steps, and how far a foot swings to either side of the hip, by body height."""


@leaf_kernel
def person_height(width_m: float, variant: int) -> float:
    """Height of a person: 1.1 to 1.35 m with a child's footprint, up to 1.95 m with the widest."""
    least = min(max(1.1 + 4.0 * (width_m - 0.35), 1.1), 1.7)
    return least + 0.0125 * (variant % 21)


@leaf_kernel
def draw_person(
    view: View,
    records: Records,
    lighting: Lighting,
    x: float,
    y: float,
    heading: float,
    width_m: float,
    walking: bool,
    variant: int,
) -> None:
    """A person who stands or walks: legs, trunk or coat, head; near by, arms, hair and a bag.

    How far the legs are apart depends on the place alone: on the metres along the heading.
    """
    height_m = person_height(width_m, variant)
    dx, dy = view.place[0] - x, view.place[1] - y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-3:
        return
    cos, sin = math.cos(heading), math.sin(heading)
    # from the side one sees less of the shoulders
    breadth = max(0.17, 0.36 * width_m)
    half = breadth * (0.68 + 0.32 * abs(dx * cos + dy * sin) / distance)
    # a child's head is large for its body
    head = 0.085 + 0.03 * height_m
    neck, hip = height_m - 1.9 * head, 0.47 * height_m
    lower = paint.CLOTH + (variant // 8) % paint.CLOTHES
    upper = paint.CLOTH + variant % paint.CLOTHES
    skin = paint.SKIN + variant % paint.SKINS
    swing = 0.0
    if walking:
        stride = STRIDE_M * height_m
        swing = SWING * height_m * math.sin(2.0 * math.pi * (x * cos + y * sin) / stride)
    # jacket, or a coat or skirt that hangs down and widens
    long_coat = (variant // 64) % 4 == 0
    hem, flare = (0.3 * height_m, 1.1) if long_coat else (0.95 * hip, 0.8)
    detailed = distance < DETAIL_M
    for hand in (-1.0, 1.0):
        aside = 0.42 * breadth * hand
        lx, ly = x - sin * aside, y + cos * aside
        draw_strip(
            view, records, lighting, lx + hand * swing * cos, ly + hand * swing * sin, 0.0,
            0.3 * half, lx, ly, hip, 0.48 * half, lower, variant,
        )  # fmt: skip
        if detailed:
            aside = (breadth + 0.02) * hand
            ax, ay = x - sin * aside, y + cos * aside
            ahead = -0.8 * hand * swing
            draw_strip(
                view, records, lighting, ax + ahead * cos, ay + ahead * sin, 0.43 * height_m,
                0.17 * breadth, ax, ay, neck - 0.04, 0.24 * breadth, upper, variant,
            )  # fmt: skip
    draw_strip(view, records, lighting, x, y, hem, flare * half, x, y, neck, half, upper, variant)
    top = height_m - head
    draw_sprite(view, records, lighting, x, y, top, 0.85 * head, head, ROUND, skin, PLAIN, variant)
    if not detailed:
        return
    # hair or a hat: over the head, and behind it
    covers = (paint.TYRE, paint.TRUNK, paint.FENCE, upper)
    draw_sprite(
        view, records, lighting, x - 0.05 * cos, y - 0.05 * sin, top + 0.3 * head, 0.9 * head,
        0.85 * head, ROUND, covers[(variant // 256) % 4], PLAIN, variant,
    )  # fmt: skip
    bag = (variant // 1024) % 4
    if bag == 0:  # on the back
        draw_sprite(
            view, records, lighting, x - 0.2 * cos, y - 0.2 * sin, 0.66 * height_m, 0.7 * breadth,
            0.12 * height_m, FLAT, lower, PLAIN, variant,
        )  # fmt: skip
    elif bag == 1:  # in the hand
        aside = breadth + 0.06
        draw_sprite(
            view, records, lighting, x - sin * aside, y + cos * aside, 0.3 * height_m, 0.14, 0.13,
            FLAT, paint.TRUNK, SLATS, variant,
        )  # fmt: skip
