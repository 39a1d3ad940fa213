"""Textures of upright faces: small pages of codes that repeat, made once."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.shapes import (
    BRICKS,
    FACADE,
    FACADES,
    FOLIAGE,
    GLASS,
    PATTERNS,
    POSTER,
    SLATS,
    TILES,
)
from ..kernels.surfaces import GRAIN_SIZE

NEUTRAL = 96
"""Codes up to 191 multiply a colour by code / 96; those above are windows."""
WINDOW = 192
CELL_PX = 32
"""A floor and a window's share of the wall are this many texels."""

Page = NDArray[np.uint8]


@functools.lru_cache(maxsize=1)
def grain_tile() -> NDArray[np.float32]:
    """Noise (128 * 128,) that repeats, the texture of asphalt and grass."""
    tile = np.random.default_rng(11).normal(0.0, 0.6, (GRAIN_SIZE, GRAIN_SIZE))
    return np.asarray(np.clip(tile, -1.5, 1.5).ravel(), np.float32)


@functools.lru_cache(maxsize=1)
def smooth_tile() -> NDArray[np.float32]:
    """Slowly varying noise (128 * 128,) that repeats: stains, clumps, clouds."""
    rng = np.random.default_rng(12)
    total = np.zeros((GRAIN_SIZE, GRAIN_SIZE), np.float32)
    for sigma, weight in ((10.0, 1.0), (4.0, 0.6), (1.6, 0.35)):
        noise = np.pad(rng.normal(0.0, 1.0, total.shape).astype(np.float32), 48, "wrap")
        layer = np.asarray(cv2.GaussianBlur(noise, (0, 0), sigma), np.float32)[48:-48, 48:-48]
        total += weight * layer / layer.std()
    total -= total.mean()
    return np.asarray(np.clip(total / (2.0 * total.std()), -1.0, 1.0).ravel(), np.float32)


def _page(shade: NDArray[np.float64] | NDArray[np.float32]) -> Page:
    """Codes (128, 128) of factors that colours are multiplied by."""
    return np.asarray(np.clip(np.round(shade * NEUTRAL), 0.0, WINDOW - 1.0), np.uint8)


def _grain(rows_per: int = 1, columns_per: int = 1) -> NDArray[np.float32]:
    """Noise (128, 128) in blocks of rows by columns."""
    tile = grain_tile().reshape(GRAIN_SIZE, GRAIN_SIZE)
    index = np.arange(GRAIN_SIZE)
    return np.asarray(tile[index // rows_per][:, index // columns_per])


def _facade(style: int) -> Page:
    """Four floors by four windows: row 0 is the foot of the wall."""
    rng = np.random.default_rng([21, style])
    smooth = smooth_tile().reshape(GRAIN_SIZE, GRAIN_SIZE)
    page = _page(1.0 + 0.06 * _grain() + 0.08 * smooth)
    low, high = 9 + style, 24
    left, right = 8 - style % 2, 23 + style % 2
    for floor in range(4):
        for cell in range(4):
            row, column = CELL_PX * floor, CELL_PX * cell
            frame = page[row + low - 1 : row + high + 2, column + left - 1 : column + right + 2]
            frame[:] = np.minimum(frame * 1.14, WINDOW - 1).astype(np.uint8)
            pane = page[row + low : row + high + 1, column + left : column + right + 1]
            pane[:] = WINDOW + rng.integers(64)
            if style in (1, 3):  # a bar across the pane
                pane[len(pane) // 2] = NEUTRAL
    door = page[0:22, CELL_PX * style + 10 : CELL_PX * style + 21]
    page[0:26, CELL_PX * style + 6 : CELL_PX * style + 26] = NEUTRAL
    door[:] = round(0.45 * NEUTRAL)
    page[:2] = (page[:2] * 0.8).astype(np.uint8)
    return page


@functools.lru_cache(maxsize=1)
def texture_pages() -> NDArray[np.uint8]:
    """All pages (PATTERNS * 128 * 128,): one for each pattern of ``kernels.shapes``."""
    smooth = smooth_tile().reshape(GRAIN_SIZE, GRAIN_SIZE)
    rows = np.arange(GRAIN_SIZE)[:, None]
    columns = np.arange(GRAIN_SIZE)[None, :]
    pages = np.full((PATTERNS, GRAIN_SIZE, GRAIN_SIZE), NEUTRAL, np.uint8)
    for style in range(FACADES):
        pages[FACADE + style] = _facade(style)
    course = (rows % 8 < 1) | ((columns + 8 * (rows // 8 % 2)) % 16 < 1)
    pages[BRICKS] = _page(1.0 + 0.10 * _grain(8, 16) - 0.08 * course)
    pages[SLATS] = _page(1.0 + 0.05 * _grain(128, 8) - 0.4 * (columns % 8 < 2))
    pages[FOLIAGE] = _page(1.0 + 0.26 * _grain(2, 2) + 0.34 * np.roll(smooth, 17) * 1.2)
    pages[TILES] = _page(1.0 + 0.12 * _grain(6, 8) - 0.18 * (rows % 6 < 2))
    pages[GLASS] = WINDOW + 32 + (12.0 * smooth).astype(np.int64)
    pages[POSTER] = _page(1.0 + 0.45 * _grain(16, 16))
    pages.setflags(write=False)
    return pages.ravel()


def code_table(
    glass_rgb: NDArray[np.float64], lit_rgb: NDArray[np.float64], lit_share: float
) -> NDArray[np.int32]:
    """What each code does to a colour (256,): red, green, blue to add, and a factor of 1 / 96.

    Args:
        glass_rgb: (3,) what windows mirror.
        lit_rgb: (3,) windows with light behind them.
        lit_share: How many are lit.
    """
    table = np.zeros((256, 4))
    table[:WINDOW, 3] = np.arange(WINDOW)
    dice = np.arange(256 - WINDOW)
    table[WINDOW:, 3] = 0.3 * NEUTRAL
    table[WINDOW:, :3] = glass_rgb * (0.8 + 0.006 * dice[:, None])
    lit = WINDOW + np.flatnonzero(dice * 37 % 64 < 64.0 * lit_share)
    table[lit] = (*lit_rgb, 0.0)
    return pack(table)


def pack(table: NDArray[np.float64]) -> NDArray[np.int32]:
    """Rows (N, 4) of numbers from 0 to 255 as (N,) int32, a byte each, the first lowest."""
    bytes_ = np.clip(np.round(table), 0.0, 255.0).astype(np.uint8)
    return np.ascontiguousarray(bytes_).view("<i4")[:, 0]
