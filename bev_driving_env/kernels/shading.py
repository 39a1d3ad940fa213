"""From geometry to colour: one image, row by row."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import kernel
from .mesh import Canvas
from .shapes import Records
from .surfaces import (
    GRAIN_PER_M,
    STAIN_PER_M,
    add_ground,
    expose_row,
    finish_ground,
    shade_faces,
    shade_sky,
)
from .view import View

FARTHEST_M = 400.0
HAZE_STEPS = 2048
"""Haze is tabulated by inverse depth, from 0 to 1 per metre."""
MOST_SAMPLES = 5
"""Ground rows near the horizon are the mean of up to this many rows in between."""
FINE_LEVEL = 1
BEAM_REACH_M = 10.0


class GroundTexture(NamedTuple):
    """The texture pyramid of the ground (``towns.ground``) as the kernels take it."""

    x0_m: float
    y0_m: float
    px_per_m: float
    texels: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    shapes: NDArray[np.int64]


class Atmosphere(NamedTuple):
    """Light, weather and surface textures of a scene.

    Attributes:
        ground: (256,) int32 lit colour of each texel code, and how grainy it is: a byte each.
        shadow: (3,) what is left of the ground's colour in a shadow.
        haze: (HAZE_STEPS,) share of haze by inverse depth.
        sheen: (HAZE_STEPS,) share of sky that wet ground mirrors, by inverse depth.
        haze_rgb: (3,) colour of haze and horizon.
        zenith_rgb: (3,) colour overhead.
        glow_rgb: (3,) what the sun adds to the sky around it.
        cloud_rgb: (3,) colour of clouds.
        clouds: Share of the sky they cover.
        pages: Textures of upright faces (``cameras.textures``).
        codes: (256,) int32 what each of their codes does to a colour.
        sun: (3,) direction towards the sun.
        beam: Strength of the headlights.
        grain: (16384,) float32 noise of 128 x 128 that repeats, about -1 to 1.
        smooth: (16384,) float32 noise that repeats, slowly varying, about -1 to 1.
    """

    ground: NDArray[np.int32]
    shadow: NDArray[np.float32]
    haze: NDArray[np.float32]
    sheen: NDArray[np.float32]
    haze_rgb: NDArray[np.float32]
    zenith_rgb: NDArray[np.float32]
    glow_rgb: NDArray[np.float32]
    cloud_rgb: NDArray[np.float32]
    clouds: float
    pages: NDArray[np.uint8]
    codes: NDArray[np.int32]
    sun: NDArray[np.float32]
    beam: float
    grain: NDArray[np.float32]
    smooth: NDArray[np.float32]


class Lens(NamedTuple):
    """What one camera does to the light, whatever it looks at.

    Attributes:
        gain: (H, W) uint8, 128 leaves the colour alone: exposure, vignette, dirt.
        veil: (H, W) uint8, how much of ``veil_rgb`` is added: dirt, glare.
        beam: (H, W) uint8, how much of the headlights' light each pixel gets.
        balance: (3,) white balance.
        veil_rgb: (3,) colour of the veil.
    """

    gain: NDArray[np.uint8]
    veil: NDArray[np.uint8]
    beam: NDArray[np.uint8]
    balance: NDArray[np.float32]
    veil_rgb: NDArray[np.float32]


class RowScratch(NamedTuple):
    """Buffers of one image row."""

    where: NDArray[np.float32]  # (2, W)
    texel: NDArray[np.int32]  # (W,)
    sums: NDArray[np.int32]  # (2, W)
    parts: NDArray[np.float32]  # (3, W)
    rgb: NDArray[np.float32]  # (3, W + 3), see shade_sky


@kernel
def row_sampling(view: View, ground: GroundTexture, row: float) -> tuple[int, int]:
    """Level of the ground pyramid and number of samples that suit an image row."""
    axes = view.axes
    slope = axes[1, 2] * (row - view.center_v) / view.focal_px + axes[2, 2]
    depth = view.place[2] / max(-slope, view.place[2] / FARTHEST_M)
    across_m = depth / view.focal_px
    along_m = depth * depth / (view.focal_px * view.place[2])
    level = int(math.floor(math.log2(max(across_m * ground.px_per_m, 1.0)) + 0.5))
    level = min(level, ground.shapes.shape[0] - 1)
    texel_m = 2.0**level / ground.px_per_m
    samples = int(along_m / (1.5 * texel_m)) + 1
    # beyond the most samples, blur more instead
    while samples > 2 * MOST_SAMPLES and level < ground.shapes.shape[0] - 1:
        level += 1
        samples = (samples + 1) // 2
    return level, min(samples, MOST_SAMPLES)


@kernel
def set_ray(view: View, row: float, ray: NDArray) -> None:
    """World direction (3,) of the pixel at column 0 of a row, at depth 1."""
    ahead = (row - view.center_v) / view.focal_px
    start = -view.center_u / view.focal_px
    for k in range(3):
        ray[k] = view.axes[1, k] * ahead + view.axes[2, k] + view.axes[0, k] * start


@kernel
def shade_image(
    view: View,
    canvas: Canvas,
    ground: GroundTexture,
    atmosphere: Atmosphere,
    records: Records,
    lens: Lens,
    scratch: RowScratch,
    dither: NDArray,
    planes: NDArray,
) -> None:
    """Colour every pixel of an image whose faces and shadows have been drawn.

    Args:
        view: The camera.
        canvas: What was drawn.
        ground: Ground texture.
        atmosphere: Light and weather.
        records: The faces.
        lens: The camera's own effects.
        scratch: Buffers of a row.
        dither: (8, 2, W) float32 in [-0.5, 0.5).
        planes: (3, H, W) uint8 output: red, green, blue.
    """
    ray, step, place = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    haze, sheen = np.empty(2, np.float32), np.empty(2, np.float32)
    for k in range(3):
        step[k] = view.axes[0, k] / view.focal_px
    # relative to the texture's corner, where 32 bits resolve a tenth of a millimetre
    place[0], place[1] = view.place[0] - ground.x0_m, view.place[1] - ground.y0_m
    place[2] = view.place[2]
    height_m, least = view.place[2], 1.0 / FARTHEST_M
    top = HAZE_STEPS - 1.0
    rgb = scratch.rgb
    for v in range(view.height):
        faces = canvas.face[v]
        first, stop = view.width, 0
        for u in range(view.width):
            if faces[u] == 0:
                first = min(first, u)
                stop = u + 1
        set_ray(view, v, ray)
        left, slope = -ray[2] / height_m, -step[2] / height_m
        nearness0, nearness1 = left + slope * first, left + slope * (stop - 1)
        begin, end = first, stop
        if first < stop and min(nearness0, nearness1) <= least:
            # on a tilted row, sky and ground share it
            if nearness0 > least:
                begin = max(first, int((least - left) / slope) + 1)
            if nearness1 > least:
                end = min(stop, int((least - left) / slope) + 1)
            shade_sky(
                begin, end, ray, step, atmosphere.sun, atmosphere.haze_rgb,
                atmosphere.zenith_rgb, atmosphere.cloud_rgb, atmosphere.glow_rgb,
                atmosphere.clouds, atmosphere.smooth, scratch.texel, scratch.parts, rgb,
            )  # fmt: skip
            # what is left for the ground
            begin, end = (first, begin) if nearness0 > least else (end, stop)
        if begin < end:
            level, samples = row_sampling(view, ground, v)
            rows, columns, offset = (
                ground.shapes[level, 0],
                ground.shapes[level, 1],
                ground.offsets[level],
            )
            texels = ground.texels[offset : offset + rows * columns]
            scratch.sums[:] = 0
            for k in range(samples):
                set_ray(view, v + (k + 0.5) / samples - 0.5, ray)
                add_ground(
                    begin, end, ray, step, place, ground.px_per_m / 2.0**level, rows, columns,
                    texels, atmosphere.ground, dither[(v + 3 * k) & 7], scratch.where,
                    scratch.texel, scratch.sums,
                )  # fmt: skip
            set_ray(view, v, ray)
            nearness0, nearness1 = left + slope * begin, left + slope * (end - 1)
            index0 = int(min(max(nearness0, least), 1.0) * top)
            index1 = int(min(max(nearness1, least), 1.0) * top)
            span = max(end - 1 - begin, 1)
            haze[0], sheen[0] = atmosphere.haze[index0], atmosphere.sheen[index0]
            haze[1] = (atmosphere.haze[index1] - haze[0]) / span
            sheen[1] = (atmosphere.sheen[index1] - sheen[0]) / span
            # far away, only stains can be told apart
            fine = level <= FINE_LEVEL
            finish_ground(
                begin, end, 1.0 / samples, atmosphere.grain if fine else atmosphere.smooth,
                GRAIN_PER_M if fine else STAIN_PER_M, scratch.where, scratch.texel,
                canvas.shadow[v], atmosphere.shadow, haze, sheen, atmosphere.haze_rgb,
                scratch.sums, scratch.parts, rgb,
            )  # fmt: skip
        if stop - first < view.width or faces[first:stop].any():
            shade_faces(
                view.width, ray, step, view.place, 1.0 / view.focal_px, faces,
                canvas.nearness[v], records.colour, records.pattern, records.frame,
                records.variant, atmosphere.pages, atmosphere.codes, atmosphere.haze,
                atmosphere.haze_rgb, scratch.texel, scratch.parts, rgb,
            )  # fmt: skip
        if atmosphere.beam > 0.0:
            light_row(
                view.width, left, slope, atmosphere.beam, lens.beam[v], faces,
                canvas.nearness[v], rgb,
            )  # fmt: skip
        expose_row(rgb, lens.gain[v], lens.veil[v], lens.balance, lens.veil_rgb, planes[:, v])


@kernel
def light_row(
    width: int,
    left: float,
    slope: float,
    beam: float,
    share: NDArray,
    faces: NDArray,
    nearness: NDArray,
    rgb: NDArray,
) -> None:
    """Add the ego's headlights to a row: full up to 10 m, then falling with the square."""
    full = 1.0 / (BEAM_REACH_M * BEAM_REACH_M)
    for u in range(width):
        inverse = nearness[u] if faces[u] > 0 else max(left + slope * u, 0.0)
        light = 1.0 + beam * share[u] / 255.0 * min(inverse * inverse, full) / full
        for channel in range(3):
            rgb[channel, u] *= light
