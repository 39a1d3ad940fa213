"""Colours along one image row: ground, sky, and what the lens makes of them.

Half of an image's time goes into these loops, so each takes plain arrays and numbers (a tuple of
arrays costs a reference count per array and call), and those over many pixels are written so that
they vectorise.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .view import Vector

FARTHEST_M = 400.0
GRAIN_SIZE = 128
GRAIN_BITS = 7
GRAIN_PER_M, STAIN_PER_M = 13.0, 1.3


@leaf_kernel
def tile_index(row: float, column: float) -> int:
    """Index into a tile of noise that repeats every 128 steps."""
    mask = np.int32(GRAIN_SIZE - 1)
    r, c = np.int32(np.int32(row) & mask), np.int32(np.int32(column) & mask)
    return np.int32(np.int32(r << np.int32(GRAIN_BITS)) | c)


@leaf_kernel
def add_ground(
    first: int,
    stop: int,
    ray: Vector,
    step: Vector,
    place: Vector,
    scale: float,
    rows: int,
    columns: int,
    texels: NDArray,
    table: NDArray,
    dither: NDArray,
    where: NDArray,
    texel: NDArray,
    sums: NDArray,
) -> None:
    """Add the ground's colours along a row to sums.

    Args:
        first: First column.
        stop: Column after the last.
        ray: World direction at column 0, with depth 1.
        step: Its change per column.
        place: The camera's place relative to the texture's corner, and its height.
        scale: Texels per metre.
        rows: Size of the pyramid level.
        columns: See above.
        texels: The level.
        table: (256,) int32 colour of each code: red, green, blue, graininess, a byte each.
        dither: (2, W) float32 offsets in texels, in place of bilinear sampling.
        where: (2, W) float32 output, ground points relative to the texture's corner.
        texel: (W,) int32 scratch.
        sums: (2, W) int32 sums in halves of 16 bits: red and blue, green and graininess.
    """
    f32, i32 = np.float32, np.int32
    zero, one = f32(0.0), f32(1.0)
    least = f32(1.0 / FARTHEST_M)
    ray_x, ray_y, ray_z = f32(ray[0]), f32(ray[1]), f32(ray[2])
    step_x, step_y, step_z = f32(step[0]), f32(step[1]), f32(step[2])
    from_x, from_y, height = f32(place[0]), f32(place[1]), f32(place[2])
    per_height = -one / height
    per_m, start = f32(scale), i32(first)
    last_row, last_column, stride = f32(rows - 1), f32(columns - 1), i32(columns)
    # slices from 0 on: an index that cannot be negative is needed for the loops to vectorise
    count = stop - first
    xs, ys, texel = where[0, first:stop], where[1, first:stop], texel[first:stop]
    across, along = dither[0, first:stop], dither[1, first:stop]
    for u in range(count):
        column = f32(i32(i32(u) + start))
        inverse = max((ray_z + column * step_z) * per_height, least)
        reach = one / inverse
        xs[u] = from_x + reach * (ray_x + column * step_x)
        ys[u] = from_y + reach * (ray_y + column * step_y)
    for u in range(count):
        c = min(max(xs[u] * per_m + across[u], zero), last_column)
        r = min(max(ys[u] * per_m + along[u], zero), last_row)
        texel[u] = i32(i32(i32(r) * stride) + i32(c))
    for u in range(count):
        texel[u] = table[texels[np.uint32(texel[u])]]
    even, odd = sums[0, first:stop], sums[1, first:stop]
    bytes_ = i32(0x00FF00FF)
    for u in range(count):
        even[u] += i32(texel[u] & bytes_)
        odd[u] += i32(i32(texel[u] >> i32(8)) & bytes_)


@leaf_kernel
def finish_ground(
    first: int,
    stop: int,
    share: float,
    noise: NDArray,
    noise_per_m: float,
    strength: float,
    where: NDArray,
    texel: NDArray,
    shadow: NDArray,
    shadow_rgb: Vector,
    haze: tuple[float, float],
    sheen: tuple[float, float],
    haze_rgb: Vector,
    sums: NDArray,
    scratch: NDArray,
    rgb: NDArray,
) -> None:
    """Turn sums of ground colours into what is seen: grain, shadows, wetness, haze.

    Args:
        first: First column.
        stop: Column after the last.
        share: One over the number of samples in the sums.
        noise: (16384,) float32 tile of grain or stains.
        noise_per_m: Its pixels per metre.
        strength: How much of it is seen.
        where: (2, W) ground points.
        texel: (W,) int32 scratch.
        shadow: (W,) uint8 shadow mask: 1 in shadow, 2 under a vehicle.
        shadow_rgb: What is left in shadow.
        haze: Share of haze at the first column, and its change per column.
        sheen: Share of mirrored sky, likewise.
        haze_rgb: Colour of haze.
        sums: (2, W) int32, see ``add_ground``.
        scratch: (3, W) float32 scratch.
        rgb: (3, W) output.
    """
    f32, i32 = np.float32, np.int32
    zero, one = f32(0.0), f32(1.0)
    count = stop - first
    xs, ys, texel = where[0, first:stop], where[1, first:stop], texel[first:stop]
    # in turn: noise, then what the air adds; brightness; share of the sun that is blocked
    added, factor = scratch[0, first:stop], scratch[1, first:stop]
    blocked, shadow = scratch[2, first:stop], shadow[first:stop]
    part, per_m = f32(share), f32(noise_per_m)
    to_grain = part * f32(1.0 / 255.0)
    for u in range(count):
        texel[u] = tile_index(ys[u] * per_m, xs[u] * per_m)
    contrast = f32(strength)
    for u in range(count):
        added[u] = contrast * noise[np.uint32(texel[u])]
    odd = sums[1, first:stop]
    haze0, haze_step = f32(haze[0]), f32(haze[1])
    sheen0, sheen_step = f32(sheen[0]), f32(sheen[1])
    for u in range(count):
        column, speck = f32(i32(u)), added[u]
        mirrored = max((sheen0 + sheen_step * column) * (f32(0.7) + f32(0.6) * speck), zero)
        kept = (one - mirrored) * (one - (haze0 + haze_step * column))
        factor[u] = part * kept * (one + to_grain * f32(i32(odd[u] >> i32(16))) * speck)
        added[u] = one - kept
    for u in range(count):
        mark = i32(shadow[u])
        factor[u] *= one - f32(0.4) * f32(i32(mark >> i32(1)))
        blocked[u] = f32(i32(mark & i32(1)))
    for channel in range(3):
        row, pair = rgb[channel, first:stop], sums[channel & 1, first:stop]
        left, air = one - f32(shadow_rgb[channel]), f32(haze_rgb[channel])
        shift, half = i32(8 * (channel & 2)), i32(0xFFFF)
        for u in range(count):
            colour = f32(i32(i32(pair[u] >> shift) & half)) * factor[u]
            row[u] = colour * (one - left * blocked[u]) + air * added[u]


@leaf_kernel
def shade_sky(
    first: int,
    stop: int,
    ray: Vector,
    step: Vector,
    sun: Vector,
    haze_rgb: Vector,
    zenith_rgb: Vector,
    cloud_rgb: Vector,
    glow_rgb: Vector,
    clouds: float,
    smooth: NDArray,
    texel: NDArray,
    scratch: NDArray,
    rgb: NDArray,
) -> None:
    """The sky along a row: haze below, zenith above, clouds, and the sun's glow.

    Args:
        first: First column.
        stop: Column after the last; up to three more are written.
        ray: World direction at column 0.
        step: Its change per column.
        sun: Direction towards the sun.
        haze_rgb: Colour at the horizon.
        zenith_rgb: Colour overhead.
        cloud_rgb: Colour of clouds.
        glow_rgb: What the sun adds around it.
        clouds: Share of the sky they cover.
        smooth: (16384,) float32 tile.
        texel: (W,) int32 scratch.
        scratch: (3, W) float32 scratch.
        rgb: (3, W + 3) output.
    """
    f32, i32 = np.float32, np.int32
    zero, one = f32(0.0), f32(1.0)
    # the sky is smooth: every fourth column will do
    count = (stop - first + 3) // 4
    ups, covers, glows = scratch[0, :count], scratch[1, :count], scratch[2, :count]
    cover, texel, start = f32(2.0 * clouds - 1.0), texel[:count], i32(first)
    ray_x, ray_y, ray_z = f32(ray[0]), f32(ray[1]), f32(ray[2])
    step_x, step_y, step_z = f32(step[0]), f32(step[1]), f32(step[2])
    sun_x, sun_y, sun_z = f32(sun[0]), f32(sun[1]), f32(sun[2])
    for u in range(count):
        column = f32(i32(i32(i32(u) << i32(2)) + start))
        x, y, z = ray_x + column * step_x, ray_y + column * step_y, ray_z + column * step_z
        norm = one / math.sqrt(x * x + y * y + z * z)
        x *= norm
        y *= norm
        z = max(z * norm, zero)
        reach = f32(26.0) / (z + f32(0.08))
        texel[u] = tile_index(y * reach, x * reach)
        # not down to zero: numbers too small for 32 bits are slow
        glow = max(x * sun_x + y * sun_y + z * sun_z, f32(0.1))
        glow *= glow
        glow *= glow
        sharp = glow * glow
        sharp *= sharp
        sharp *= sharp
        glows[u] = f32(0.25) * glow + sharp
        ups[u] = z
    for u in range(count):
        covers[u] = smooth[np.uint32(texel[u])]
    for u in range(count):
        z = ups[u]
        covers[u] = min(max(covers[u] + cover, zero), one) * min(one, f32(4.0) * z)
        ups[u] = math.sqrt(z)
    for channel in range(3):
        row = rgb[channel, first : first + 4 * count]
        air, top = f32(haze_rgb[channel]), f32(zenith_rgb[channel])
        white, light = f32(cloud_rgb[channel]), f32(glow_rgb[channel])
        for u in range(count):
            colour = air + ups[u] * (top - air)
            colour += covers[u] * (white - colour) + glows[u] * light
            k = np.uint64(4 * u)
            row[k] = colour
            row[k + np.uint64(1)] = colour
            row[k + np.uint64(2)] = colour
            row[k + np.uint64(3)] = colour


@leaf_kernel
def expose_row(
    rgb: NDArray,
    gain: NDArray,
    veil: NDArray,
    balance: Vector,
    veil_rgb: Vector,
    planes: NDArray,
) -> None:
    """What the lens and the sensor make of a row of colours.

    Args:
        rgb: (3, W + 3) colours.
        gain: (W,) uint8, 128 leaves the colour alone.
        veil: (W,) uint8.
        balance: White balance.
        veil_rgb: Colour of the veil.
        planes: (3, W) uint8 output.
    """
    f32, i32 = np.float32, np.int32
    zero, most = f32(0.0), f32(255.0)
    for channel in range(3):
        row, out = rgb[channel], planes[channel]
        factor, haze = f32(balance[channel] / 128.0), f32(veil_rgb[channel] / 255.0)
        for u in range(gain.shape[0]):
            colour = row[u] * f32(i32(gain[u])) * factor + f32(i32(veil[u])) * haze
            out[u] = np.uint8(i32(min(max(colour, zero), most)))
