"""Palettes: what colours a town has. No material of ``test`` has a colour it has in ``train``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels import paints as paint
from ..towns.ground import MATERIALS

RGB = tuple[int, int, int]
JITTER = 7.0
"""Each colour varies by this much from episode to episode, each channel by itself."""
GRAIN: dict[str, float] = {
    "grass": 0.34,
    "asphalt": 0.11,
    "patch": 0.09,
    "crack": 0.10,
    "sidewalk": 0.08,
    "kerb": 0.08,
    "white": 0.08,
    "yellow": 0.08,
}
"""How grainy each material is."""


@dataclass(frozen=True)
class Palette:
    """Colours of one place.

    Attributes:
        name: What it is called.
        ground: Colour of each of ``towns.ground.MATERIALS``.
        walls: Eight colours of walls.
        roofs: Four colours of roofs.
        leaves: Four colours of trees; hedges take the first.
    """

    name: str
    ground: Mapping[str, RGB]
    walls: tuple[RGB, ...]
    roofs: tuple[RGB, ...]
    leaves: tuple[RGB, ...]

    def ground_array(self) -> NDArray[np.float64]:
        """Ground colours (8, 3) in the order of ``MATERIALS``."""
        return np.array([self.ground[name] for name in MATERIALS], np.float64)


def _ground(
    grass: RGB, asphalt: RGB, patch: RGB, sidewalk: RGB, white: RGB, yellow: RGB
) -> dict[str, RGB]:
    """A ground palette; cracks and kerbs follow from asphalt and sidewalk."""
    dark: RGB = tuple(round(0.55 * c) for c in asphalt)  # type: ignore[assignment]
    stone: RGB = tuple(min(255, round(1.12 * c)) for c in sidewalk)  # type: ignore[assignment]
    return {
        "grass": grass,
        "asphalt": asphalt,
        "patch": patch,
        "crack": dark,
        "sidewalk": sidewalk,
        "kerb": stone,
        "white": white,
        "yellow": yellow,
    }


TRAIN_PALETTES = (
    Palette(
        "meadow",
        _ground(
            (84, 118, 52),
            (98, 100, 104),
            (80, 82, 86),
            (172, 170, 164),
            (232, 232, 228),
            (222, 178, 48),
        ),
        walls=(
            (196, 182, 160),
            (178, 120, 96),
            (214, 208, 196),
            (150, 156, 164),
            (188, 164, 120),
            (160, 96, 80),
            (222, 214, 180),
            (130, 140, 150),
        ),
        roofs=((126, 70, 56), (92, 84, 82), (110, 92, 76), (74, 78, 86)),
        leaves=((58, 96, 40), (74, 112, 44), (46, 84, 42), (92, 120, 54)),
    ),
    Palette(
        "suburb",
        _ground(
            (104, 132, 66),
            (82, 84, 90),
            (104, 104, 106),
            (196, 192, 184),
            (240, 238, 232),
            (236, 192, 40),
        ),
        walls=(
            (232, 226, 212),
            (204, 190, 168),
            (166, 178, 186),
            (218, 196, 166),
            (148, 116, 92),
            (190, 200, 190),
            (240, 236, 224),
            (176, 150, 132),
        ),
        roofs=((84, 80, 80), (146, 84, 62), (100, 104, 110), (118, 76, 58)),
        leaves=((66, 104, 52), (52, 90, 46), (84, 118, 48), (72, 100, 58)),
    ),
    Palette(
        "harbour",
        _ground(
            (92, 108, 62),
            (116, 116, 118),
            (96, 97, 100),
            (150, 152, 156),
            (224, 226, 228),
            (206, 164, 60),
        ),
        walls=(
            (168, 88, 72),
            (140, 80, 66),
            (186, 176, 162),
            (120, 124, 130),
            (158, 104, 84),
            (204, 196, 184),
            (104, 110, 118),
            (180, 132, 100),
        ),
        roofs=((70, 72, 78), (88, 88, 92), (104, 72, 62), (82, 78, 72)),
        leaves=((54, 88, 48), (68, 98, 56), (80, 108, 60), (60, 92, 40)),
    ),
    Palette(
        "spring",
        _ground(
            (122, 150, 62),
            (90, 92, 92),
            (70, 72, 76),
            (184, 178, 160),
            (236, 236, 230),
            (230, 200, 74),
        ),
        walls=(
            (226, 206, 170),
            (238, 230, 206),
            (196, 150, 116),
            (206, 212, 206),
            (180, 190, 170),
            (214, 176, 150),
            (160, 150, 140),
            (244, 240, 230),
        ),
        roofs=((150, 90, 70), (120, 100, 90), (96, 86, 82), (130, 76, 60)),
        leaves=((98, 136, 52), (116, 150, 62), (84, 124, 56), (130, 154, 78)),
    ),
)
"""Seen in training."""

TEST_PALETTES = (
    Palette(
        "dry",
        _ground(
            (168, 152, 92),
            (146, 138, 124),
            (126, 112, 100),
            (206, 186, 156),
            (252, 240, 200),
            (240, 214, 110),
        ),
        walls=(
            (226, 186, 138),
            (206, 152, 104),
            (240, 214, 170),
            (190, 128, 90),
            (214, 170, 126),
            (236, 200, 150),
            (180, 140, 110),
            (248, 228, 190),
        ),
        roofs=((176, 98, 64), (190, 116, 78), (160, 88, 60), (150, 110, 80)),
        leaves=((122, 122, 62), (140, 132, 70), (108, 112, 58), (134, 140, 84)),
    ),
    Palette(
        "autumn",
        _ground(
            (140, 112, 58),
            (62, 56, 62),
            (44, 42, 48),
            (164, 136, 122),
            (214, 206, 196),
            (196, 146, 32),
        ),
        walls=(
            (122, 60, 52),
            (96, 66, 58),
            (150, 120, 106),
            (86, 88, 100),
            (134, 82, 60),
            (110, 100, 92),
            (164, 140, 120),
            (78, 70, 72),
        ),
        roofs=((58, 50, 52), (74, 58, 54), (48, 52, 60), (86, 62, 52)),
        leaves=((168, 96, 40), (184, 122, 44), (146, 80, 40), (160, 134, 56)),
    ),
    Palette(
        "coast",
        _ground(
            (128, 140, 104),
            (142, 144, 148),
            (124, 126, 132),
            (220, 214, 206),
            (255, 255, 252),
            (252, 226, 150),
        ),
        walls=(
            (250, 250, 248),
            (214, 230, 240),
            (244, 236, 220),
            (186, 208, 222),
            (255, 244, 226),
            (200, 220, 214),
            (236, 240, 246),
            (222, 204, 190),
        ),
        roofs=((80, 118, 150), (100, 132, 158), (186, 110, 86), (124, 140, 150)),
        leaves=((96, 124, 84), (110, 136, 98), (82, 112, 80), (124, 142, 104)),
    ),
)
"""Held out: no material's colour lies within twice ``JITTER`` of the same one's in training."""

CAR_PAINTS: tuple[RGB, ...] = (
    (200, 200, 204), (32, 34, 40), (150, 26, 30), (34, 62, 126),
    (120, 124, 128), (236, 236, 232), (40, 92, 66), (206, 160, 60),
)  # fmt: skip
TEST_CAR_PAINTS: tuple[RGB, ...] = (
    (96, 44, 96), (226, 112, 30), (60, 150, 170), (178, 176, 150),
    (20, 70, 40), (246, 214, 60), (90, 70, 56), (220, 130, 150),
)  # fmt: skip
CLOTHES: tuple[RGB, ...] = (
    (40, 46, 66), (150, 40, 44), (60, 100, 150), (210, 206, 198),
    (50, 50, 50), (90, 120, 70), (196, 150, 60), (120, 90, 130),
)  # fmt: skip
SKINS: tuple[RGB, ...] = ((224, 180, 150), (168, 120, 90), (104, 72, 54))
POSTERS: tuple[RGB, ...] = ((214, 90, 60), (70, 130, 190), (230, 200, 90))
FIXED: Mapping[int, RGB] = {
    paint.TRUNK: (86, 68, 52),
    paint.METAL: (118, 122, 126),
    paint.FENCE: (136, 108, 80),
    paint.GLASS: (52, 60, 68),
    paint.TYRE: (28, 28, 30),
    paint.HOUSING: (40, 44, 44),
    paint.LENS_OFF: (58, 54, 52),
    paint.LENS_RED: (255, 46, 36),
    paint.LENS_YELLOW: (255, 196, 40),
    paint.LENS_GREEN: (60, 255, 130),
    paint.TAILLIGHT: (190, 30, 28),
}


def paint_table(palette: Palette, car_paints: tuple[RGB, ...]) -> NDArray[np.float64]:
    """Colours (PAINTS, 3) of everything upright; lamps that depend on the light stay black."""
    table = np.zeros((paint.PAINTS, 3))
    groups = (
        (paint.WALL, palette.walls),
        (paint.ROOF, palette.roofs),
        (paint.LEAF, palette.leaves),
        (paint.HEDGE, palette.leaves[:1]),
        (paint.CAR, car_paints),
        (paint.CLOTH, CLOTHES),
        (paint.SKIN, SKINS),
        (paint.POSTER, POSTERS),
        (paint.KERB, (palette.ground["kerb"],)),
    )
    for slot, colours in groups:
        table[slot : slot + len(colours)] = colours
    for slot, colour in FIXED.items():
        table[slot] = colour
    return table
