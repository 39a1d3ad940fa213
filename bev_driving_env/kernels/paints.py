"""Slots of the table of paints: which colour a thing has is decided by its slot."""

from __future__ import annotations

WALL, WALLS = 0, 8
ROOF, ROOFS = 8, 4
LEAF, LEAVES = 12, 4
TRUNK, METAL, FENCE, HEDGE, GLASS, TYRE = range(16, 22)
CAR, CARS = 22, 8
SKIN, SKINS = 30, 3
CLOTH, CLOTHES = 33, 8
LAMP, HOUSING, LENS_OFF, LENS_RED, LENS_YELLOW, LENS_GREEN = range(41, 47)
POSTER, POSTERS = 47, 3
HEADLIGHT, TAILLIGHT, KERB = range(50, 53)
PAINTS = 53
