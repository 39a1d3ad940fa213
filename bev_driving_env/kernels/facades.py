"""Colours of upright faces along one image row; see ``surfaces`` for how its loops are written."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .shapes import (
    ALONG_X,
    ALONG_Y,
    COLOUR,
    EMISSIVE,
    FACADE,
    FOLIAGE,
    GLASS,
    ORIGIN_X,
    ORIGIN_Y,
    ORIGIN_Z,
    PATTERN,
    POSTER,
    SLATS,
    TILES,
    VARIANT,
)
from .surfaces import GRAIN_BITS, GRAIN_SIZE, tile_index
from .view import Vector


@leaf_kernel
def pattern_scale(pattern: int) -> tuple[float, float, float, float]:
    """Texels per metre along and up a face, brightening per metre up, and average factor."""
    if pattern >= FACADE:
        return 32.0 / (2.6 + 0.35 * (pattern - FACADE)), 10.0, 0.0, 0.8
    if pattern == FOLIAGE:
        return 11.0, 11.0, 0.12, 1.0
    if pattern == TILES:
        return 24.0, 21.0, 0.0, 0.94
    if pattern == SLATS:
        return 40.0, 10.0, 0.0, 0.9
    if pattern == GLASS:
        return 4.0, 4.0, 0.0, 1.0
    if pattern == POSTER:
        return 40.0, 40.0, 0.0, 1.0
    return 32.0, 64.0, 0.0, 0.98


@leaf_kernel
def shade_faces(
    stop: int,
    ray: Vector,
    step: Vector,
    place: Vector,
    pixel: float,
    faces: NDArray,
    nearness: NDArray,
    table: NDArray,
    pages: NDArray,
    codes: NDArray,
    haze_table: NDArray,
    haze_rgb: Vector,
    texel: NDArray,
    scratch: NDArray,
    rgb: NDArray,
) -> None:
    """Upright faces along a row, run by run, with their textures and haze.

    Args:
        stop: Column after the last.
        ray: World direction at column 0, with depth 1.
        step: Its change per column.
        place: The camera.
        pixel: One over the focal length: size of a pixel at depth 1.
        faces: (W,) int32 face seen, 0 for none.
        nearness: (W,) float32 inverse depth.
        table: (M, 12) the faces, see ``Records``.
        pages: Texture pages.
        codes: (256,) int32 what each code does: red, green, blue to add, and a factor of 1/96.
        haze_table: (steps,) share of haze by inverse depth.
        haze_rgb: Its colour.
        texel: (W,) int32 scratch.
        scratch: (3, W) float32 scratch.
        rgb: (3, W + 3) output.
    """
    f32, i32 = np.float32, np.int32
    one = f32(1.0)
    top = f32(haze_table.shape[0] - 1)
    u = 0
    while u < stop:
        number = faces[np.uint64(u)]
        end = u + 1
        while end < stop and faces[np.uint64(end)] == number:
            end += 1
        if number == 0:
            u = end
            continue
        count = end - u
        pattern = int(table[number, PATTERN])
        haze0 = haze_table[np.int32(min(nearness[u], one) * top)]
        haze1 = haze_table[np.int32(min(nearness[end - 1], one) * top)]
        if pattern == EMISSIVE:
            haze0, haze1 = f32(0.0), f32(0.0)
        thicken = (haze1 - haze0) / f32(count)
        if pattern <= EMISSIVE:
            for channel in range(3):
                colour, air = f32(table[number, COLOUR + channel]), f32(haze_rgb[channel])
                row = rgb[channel, u:end]
                for k in range(count):
                    row[k] = colour + (haze0 + thicken * f32(i32(k))) * (air - colour)
            u = end
            continue
        along_x, along_y = f32(table[number, ALONG_X]), f32(table[number, ALONG_Y])
        variant = int(table[number, VARIANT])
        per_s, per_z, rising, average = pattern_scale(pattern)
        near_m = f32(pixel) / nearness[u]
        fade = one / (one + (near_m * f32(0.22 * per_z)) ** 2)
        # along the face and up, in texels; both are linear before the perspective division
        from_s = f32(per_s) * f32(
            (place[0] - table[number, ORIGIN_X]) * along_x
            + (place[1] - table[number, ORIGIN_Y]) * along_y
        ) + f32(16384.0 + 37.0 * (variant % 64))
        ray_s = f32(per_s * (ray[0] * along_x + ray[1] * along_y))
        step_s = f32(per_s * (step[0] * along_x + step[1] * along_y))
        from_z, ray_z, step_z = (
            f32(per_z) * f32(place[2] - table[number, ORIGIN_Z]) + f32(1024.0),
            f32(per_z * ray[2]),
            f32(per_z * step[2]),
        )
        index, depths, heights = texel[u:end], nearness[u:end], scratch[0, u:end]
        start = i32(u)
        for k in range(count):
            depth = one / depths[k]
            column = f32(i32(i32(k) + start))
            s = from_s + depth * (ray_s + column * step_s)
            z = from_z + depth * (ray_z + column * step_z)
            heights[k] = z
            index[k] = tile_index(z, s)
        page = pattern << (2 * GRAIN_BITS)
        leaf = pages[page : page + GRAIN_SIZE * GRAIN_SIZE]
        for k in range(count):
            index[k] = codes[leaf[np.uint32(index[k])]]
        factor = scratch[1, u:end]
        keep, lift = fade * f32(1.0 / 96.0), (one - fade) * f32(average)
        rise, base = f32(rising / per_z), f32(1.0 - 1024.0 * rising / per_z)
        low = np.int32(255)
        for k in range(count):
            share = f32(np.int32((index[k] >> np.int32(24)) & low))
            factor[k] = (keep * share + lift) * (base + rise * heights[k])
        for channel in range(3):
            colour, air = f32(table[number, COLOUR + channel]), f32(haze_rgb[channel])
            row = rgb[channel, u:end]
            shift = np.int32(8 * channel)
            for k in range(count):
                added = f32(np.int32((index[k] >> shift) & low))
                seen = colour * factor[k] + fade * added
                row[k] = seen + (haze0 + thicken * f32(i32(k))) * (air - seen)
        u = end
