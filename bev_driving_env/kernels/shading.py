"""From geometry to colour: one image, row by row."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .facades import shade_faces
from .jit import leaf_kernel
from .mesh import Canvas
from .shapes import Records
from .surfaces import (
    FARTHEST_M,
    GRAIN_PER_M,
    STAIN_PER_M,
    add_ground,
    expose_row,
    finish_ground,
    shade_sky,
)
from .view import Vector, View

HAZE_STEPS = 2048
"""Haze is tabulated by inverse depth, from 0 to 1 per metre."""
MOST_SAMPLES = 5
"""Ground rows near the horizon are the mean of up to this many rows in between."""
SHARP_GRAIN_M, SHARP_STAINS_M = 0.08, 0.6
"""A pixel may cover this much ground along the view before grain, and stains, average out."""
LEVEL_SHARE, PIECE_PX = 0.3, 60
"""A row along which the depth changes by more than this share is painted in pieces so long."""
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
        shadow: What is left of the ground's colour in a shadow.
        haze: (HAZE_STEPS,) share of haze by inverse depth.
        sheen: (HAZE_STEPS,) share of sky that wet ground mirrors, by inverse depth.
        haze_rgb: Colour of haze and horizon.
        zenith_rgb: Colour overhead.
        glow_rgb: What the sun adds to the sky around it.
        cloud_rgb: Colour of clouds.
        clouds: Share of the sky they cover.
        pages: Textures of upright faces (``cameras.textures``).
        codes: (256,) int32 what each of their codes does to a colour.
        sun: Direction towards the sun.
        beam: Strength of the headlights.
        grain: (16384,) float32 noise of 128 x 128 that repeats, about -1 to 1.
        smooth: (16384,) float32 noise that repeats, slowly varying, about -1 to 1.
    """

    ground: NDArray[np.int32]
    shadow: Vector
    haze: NDArray[np.float32]
    sheen: NDArray[np.float32]
    haze_rgb: Vector
    zenith_rgb: Vector
    glow_rgb: Vector
    cloud_rgb: Vector
    clouds: float
    pages: NDArray[np.uint8]
    codes: NDArray[np.int32]
    sun: Vector
    beam: float
    grain: NDArray[np.float32]
    smooth: NDArray[np.float32]


class Lens(NamedTuple):
    """What one camera does to the light, whatever it looks at.

    Attributes:
        gain: (H, W) uint8, 128 leaves the colour alone: exposure, vignette, dirt.
        veil: (H, W) uint8, how much of ``veil_rgb`` is added: dirt, glare.
        beam: (H, W) uint8, how much of the headlights' light each pixel gets.
        balance: White balance.
        veil_rgb: Colour of the veil.
    """

    gain: NDArray[np.uint8]
    veil: NDArray[np.uint8]
    beam: NDArray[np.uint8]
    balance: Vector
    veil_rgb: Vector


class RowScratch(NamedTuple):
    """Buffers of one image row."""

    where: NDArray[np.float32]  # (2, W)
    texel: NDArray[np.int32]  # (W,)
    sums: NDArray[np.int32]  # (2, W)
    parts: NDArray[np.float32]  # (3, W)
    rgb: NDArray[np.float32]  # (3, W + 3), see shade_sky


@leaf_kernel
def ground_sampling(view: View, ground: GroundTexture, depth: float) -> tuple[int, int, float]:
    """How to sample the ground that lies at some depth.

    Returns:
        Level of the pyramid, number of samples, and metres along the view that a pixel covers.
    """
    across_m = depth / view.focal_px
    along_m = depth * depth / (view.focal_px * view.place[2])
    level = math.floor(math.log2(max(across_m * ground.px_per_m, 1.0)) + 0.5)
    level = min(level, ground.shapes.shape[0] - 1)
    texel_m = 2.0**level / ground.px_per_m
    samples = int(along_m / (1.5 * texel_m)) + 1
    # beyond the most samples, blur more instead
    while samples > 2 * MOST_SAMPLES and level < ground.shapes.shape[0] - 1:
        level += 1
        samples = (samples + 1) // 2
    return level, min(samples, MOST_SAMPLES), along_m


@leaf_kernel
def ray_of(view: View, row: float) -> Vector:
    """World direction of the pixel at column 0 of a row, at depth 1."""
    ahead = (row - view.center_v) / view.focal_px
    start = -view.center_u / view.focal_px
    right, down, forward = view.axes
    return (
        down[0] * ahead + forward[0] + right[0] * start,
        down[1] * ahead + forward[1] + right[1] * start,
        down[2] * ahead + forward[2] + right[2] * start,
    )


@leaf_kernel
def along_row(table: NDArray, first: int, last: int, span: int) -> tuple[float, float]:
    """An entry of a table, and the change per column to another one that is ``span`` away."""
    return table[first], (table[last] - table[first]) / span


@leaf_kernel
def free_span(faces: NDArray) -> tuple[int, int]:
    """First column of a row without a face, and the one after the last; equal if all have one."""
    first, stop = 0, faces.shape[0]
    while stop > 0 and faces[np.uint64(stop - 1)] != 0:
        stop -= 1
    while first < stop and faces[np.uint64(first)] != 0:
        first += 1
    return first, stop


@leaf_kernel
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
    right = view.axes[0]
    step = (right[0] / view.focal_px, right[1] / view.focal_px, right[2] / view.focal_px)
    # relative to the texture's corner, where 32 bits resolve a tenth of a millimetre
    place = (view.place[0] - ground.x0_m, view.place[1] - ground.y0_m, view.place[2])
    height_m, least = view.place[2], 1.0 / FARTHEST_M
    top = HAZE_STEPS - 1.0
    rgb = scratch.rgb
    for v in range(view.height):
        faces = canvas.face[v]
        first, stop = free_span(faces)
        ray = ray_of(view, v)
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
        while begin < end:
            # on a tilted row the depth changes: level and haze are those of a piece of it
            nearness0 = max(left + slope * begin, least)
            piece = end - begin
            if abs(slope) * piece > LEVEL_SHARE * nearness0:
                piece = min(piece, PIECE_PX)
            full_end, end = end, begin + piece
            nearness1 = max(left + slope * (end - 1), least)
            level, samples, along_m = ground_sampling(view, ground, 2.0 / (nearness0 + nearness1))
            rows, columns, offset = (
                ground.shapes[level, 0],
                ground.shapes[level, 1],
                ground.offsets[level],
            )
            texels = ground.texels[offset : offset + rows * columns]
            scratch.sums[:] = 0
            for k in range(samples):
                between = ray_of(view, v + (k + 0.5) / samples - 0.5)
                add_ground(
                    begin, end, between, step, place, ground.px_per_m / 2.0**level, rows, columns,
                    texels, atmosphere.ground, dither[(v + 3 * k) & 7], scratch.where,
                    scratch.texel, scratch.sums,
                )  # fmt: skip
            index0 = int(min(nearness0, 1.0) * top)
            index1 = int(min(nearness1, 1.0) * top)
            span = max(end - 1 - begin, 1)
            haze = along_row(atmosphere.haze, index0, index1, span)
            sheen = along_row(atmosphere.sheen, index0, index1, span)
            # grain that cannot be told apart any more would flicker: farther on there are only
            # stains, and they fade
            fine = along_m < 2.0 * SHARP_GRAIN_M
            strength = min(1.0, (SHARP_GRAIN_M if fine else SHARP_STAINS_M) / along_m)
            finish_ground(
                begin, end, 1.0 / samples, atmosphere.grain if fine else atmosphere.smooth,
                GRAIN_PER_M if fine else STAIN_PER_M, strength, scratch.where, scratch.texel,
                canvas.shadow[v], atmosphere.shadow, haze, sheen, atmosphere.haze_rgb,
                scratch.sums, scratch.parts, rgb,
            )  # fmt: skip
            begin, end = end, full_end
        shade_faces(
            view.width, ray, step, view.place, 1.0 / view.focal_px, faces, canvas.nearness[v],
            records.table, atmosphere.pages, atmosphere.codes, atmosphere.haze,
            atmosphere.haze_rgb, scratch.texel, scratch.parts, rgb,
        )  # fmt: skip
        if atmosphere.beam > 0.0:
            light_row(
                left, slope, atmosphere.beam, lens.beam[v], faces, canvas.nearness[v],
                scratch.parts[0], rgb,
            )  # fmt: skip
        expose_row(rgb, lens.gain[v], lens.veil[v], lens.balance, lens.veil_rgb, planes[:, v])


@leaf_kernel
def light_row(
    left: float,
    slope: float,
    beam: float,
    share: NDArray,
    faces: NDArray,
    nearness: NDArray,
    light: NDArray,
    rgb: NDArray,
) -> None:
    """Add the ego's headlights to a row: full up to 10 m, then falling with the square.

    Args:
        left: Inverse depth of the ground at column 0.
        slope: Its change per column.
        beam: Strength of the headlights.
        share: (W,) uint8, how much of them each pixel gets.
        faces: (W,) faces seen, 0 for none.
        nearness: (W,) their inverse depths.
        light: (W,) float32 scratch.
        rgb: (3, W + 3) colours, changed in place.
    """
    f32, i32 = np.float32, np.int32
    full, start, rise = f32(1.0 / BEAM_REACH_M), f32(left), f32(slope)
    strength = f32(beam / 255.0 * BEAM_REACH_M * BEAM_REACH_M)
    for u in range(faces.shape[0]):
        ground = max(start + rise * f32(i32(u)), f32(0.0))
        inverse = min(nearness[u] if faces[u] > i32(0) else ground, full)
        light[u] = f32(1.0) + strength * f32(i32(share[u])) * (inverse * inverse)
    for channel in range(3):
        row = rgb[channel]
        for u in range(faces.shape[0]):
            row[u] *= light[u]
