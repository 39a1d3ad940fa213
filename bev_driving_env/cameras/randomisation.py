"""Looks far beyond those of any appearance, to train networks that must not trust colours.

Domain randomisation (Tobin et al., "Domain Randomization for Transferring Deep Neural Networks from
Simulation to the Real World", IROS 2017): whoever has seen asphalt, grass and light of any colour
takes those of a new place for one more of them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..kernels import paints as paint
from ..towns.ground import ASPHALT, CRACK, GRASS, KERB, PATCH, SIDEWALK, WHITE, YELLOW
from .conditions import Condition
from .look import Look, draw_look

PAINTED = (
    *range(paint.WALL, paint.WALL + paint.WALLS),
    *range(paint.ROOF, paint.ROOF + paint.ROOFS),
    *range(paint.LEAF, paint.LEAF + paint.LEAVES),
    *(paint.TRUNK, paint.FENCE, paint.HEDGE),
    *range(paint.CAR, paint.CAR + paint.CARS),
    *range(paint.CLOTH, paint.CLOTH + paint.CLOTHES),
    *range(paint.POSTER, paint.POSTER + paint.POSTERS),
)
"""Slots of paints that may have any colour; lamps, glass, tyres and skin may not."""
MARKS_OVER_ASPHALT = 1.25
"""Paint on the road is at least so much brighter than the road."""
FULL_DAY = 0.55
"""Least light of sun and sky together."""

Floats = NDArray[np.float64]


def randomised_look(seed: int, cameras: int = 4) -> Look:
    """Draw a look whose colours and light vary far more than those of ``"train"``.

    It is made of one of ``"train"``; the palettes and conditions of ``"test"`` and ``"hard"``
    play no part. The cameras' mounting errors are those of every look.

    Args:
        seed: Any int of at least 0; the same seed gives the same look in every process.
        cameras: Number of cameras.
    """
    look = draw_look("train", seed, cameras)
    rng = np.random.default_rng([seed, 0xD0])  # not that of the look which it is made of
    paints = look.paints.copy()
    paints[list(PAINTED)] *= _tints(rng, 0.25, 0.15, len(PAINTED))
    sun = 0.0 if rng.random() < 0.4 else float(rng.uniform(0.2, 0.95))
    ambient = max(float(rng.uniform(0.25, 1.0)), FULL_DAY - sun)
    return dataclasses.replace(
        look,
        condition=_condition(look.condition, ambient + 0.5 * sun, rng),
        ground=_ground(look.ground, rng),
        paints=np.clip(paints, 0.0, 255.0),
        sun_elevation_rad=float(np.radians(rng.uniform(10.0, 75.0))),
        sun=sun,
        ambient=ambient,
        sight_m=float(np.exp(rng.uniform(np.log(120.0), np.log(1500.0)))),
        clouds=float(rng.uniform(0.0, 1.0)),
        wetness=float(rng.uniform(0.2, 0.9)) if rng.random() < 0.3 else 0.0,
        noise=float(rng.uniform(1.0, 7.0)),
        blur_px=float(rng.uniform(0.0, 0.8)),
        exposure=rng.uniform(0.7, 1.35) * rng.uniform(0.9, 1.1, cameras),
        balance=rng.uniform(0.9, 1.1, (cameras, 3)),
    )


def _ground(ground: Floats, rng: np.random.Generator) -> Floats:
    """Ground colours (8, 3) of a road, a verge and paint that nobody has seen yet."""
    made = ground.copy()
    road, verge = _tints(rng, 0.25, 0.06), _tints(rng, 0.18, 0.08)
    for material in (ASPHALT, PATCH, CRACK):
        made[material] *= road * _tints(rng, 0.06, 0.0)
    for material in (SIDEWALK, KERB):
        made[material] *= verge * _tints(rng, 0.04, 0.0)
    made[GRASS] *= _tints(rng, 0.3, 0.2)
    for material in (WHITE, YELLOW):
        made[material] *= _tints(rng, 0.08, 0.04)
    made = np.clip(made, 4.0, 255.0)
    darkest_mark = made[[WHITE, YELLOW]].mean(axis=1).min()
    brightest = darkest_mark / MARKS_OVER_ASPHALT
    for material in (ASPHALT, PATCH, CRACK):
        made[material] *= min(1.0, brightest / made[material].mean())
    return made


def _condition(condition: Condition, light: float, rng: np.random.Generator) -> Condition:
    """Weather whose colours are anyone's, as bright as the light on the ground."""
    sun_tint, ambient_tint, haze_tint = _tints(rng, 0.0, 0.12, 3)
    level = min(light, 1.1)
    haze = np.clip(210.0 * level * rng.uniform(0.8, 1.15) * haze_tint, 0.0, 255.0)
    zenith = np.clip(haze * rng.uniform(0.4, 1.0) * _tints(rng, 0.0, 0.15), 0.0, 255.0)
    cloud = np.clip(haze * rng.uniform(0.85, 1.2), 0.0, 255.0)
    return dataclasses.replace(
        condition,
        name="randomised",
        sun_tint=_triple(sun_tint),
        ambient_tint=_triple(ambient_tint),
        haze_rgb=_triple(haze),
        zenith_rgb=_triple(zenith),
        cloud_rgb=_triple(cloud),
        lit_windows=float(rng.uniform(0.0, 0.3)),
        glare=float(rng.uniform(0.1, 0.4)) if rng.random() < 0.2 else 0.0,
    )


def _tints(
    rng: np.random.Generator, brightness: float, hue: float, count: int | None = None
) -> Floats:
    """Factors of colours, (3,) or (count, 3): one of all three channels times one of each."""
    rows = () if count is None else (count,)
    return np.exp(rng.normal(0.0, brightness, (*rows, 1)) + rng.normal(0.0, hue, (*rows, 3)))


def _triple(colour: Floats) -> tuple[float, float, float]:
    red, green, blue = colour.tolist()
    return red, green, blue
