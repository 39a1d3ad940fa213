"""Rendering all camera images of one world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import leaf_kernel
from .mesh import Canvas, fill_faces, new_canvas
from .occlusion import Skyline
from .scene_shadows import cast_shadows
from .scenery import (
    Nearby,
    Scenery,
    draw_actors,
    draw_buildings,
    draw_street,
    find_nearby,
)
from .shading import Atmosphere, GroundTexture, Lens, RowScratch, shade_image
from .shapes import Lighting, Records, new_records
from .view import Ego, Vector, camera_view


class Workspace(NamedTuple):
    """Buffers for images of one size; those of camera c list their faces from ``starts[c]`` on."""

    nearby: Nearby
    skyline: Skyline
    canvas: Canvas
    records: Records
    starts: NDArray[np.int64]
    scratch: RowScratch
    dither: NDArray[np.float32]
    hull: NDArray[np.float64]


def new_workspace(scenery: Scenery, cameras: int, height: int, width: int) -> Workspace:
    """Buffers for images of height by width in some scenery."""
    rng = np.random.default_rng(0)
    tables = (scenery.boxes, scenery.gables, scenery.sprites, scenery.cars, scenery.kerbs)
    return Workspace(
        nearby=Nearby(
            np.zeros(len(tables), np.int64),
            np.zeros(max(len(table) for table in tables)),
            *(np.zeros(len(table), np.int64) for table in tables),
        ),
        skyline=Skyline(np.zeros(width), np.zeros(width)),
        canvas=new_canvas(height, width),
        records=new_records(cameras),
        starts=np.zeros(cameras + 1, np.int64),
        scratch=RowScratch(
            np.zeros((2, width), np.float32),
            np.zeros(width, np.int32),
            np.zeros((2, width), np.int32),
            np.zeros((3, width), np.float32),
            np.zeros((3, width + 3), np.float32),
        ),
        dither=(rng.random((8, 2, width)) - 0.5).astype(np.float32),
        hull=np.zeros((8, 2)),
    )


@leaf_kernel
def list_faces(
    scenery: Scenery,
    lighting: Lighting,
    ego: Ego,
    pitch_rad: float,
    roll_rad: float,
    axes: NDArray,
    places: NDArray,
    intrinsics: NDArray,
    height: int,
    width: int,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
    sunny: bool,
    looks: int,
    nearby: Nearby,
    skyline: Skyline,
    hull: NDArray,
    records: Records,
    starts: NDArray,
) -> None:
    """List the faces and shadows that each camera sees, for ``paint_images``.

    Two kernels, not one: each is optimised together with all that it calls, which takes long.

    Args:
        scenery: What does not move.
        lighting: Sun, sky and paints.
        ego: The car.
        pitch_rad: Its nose down.
        roll_rad: Its right side down.
        axes: (C, 3, 3) right, down, forward of each camera as it is mounted, in the body frame.
        places: (C, 3) positions in the body frame.
        intrinsics: (C, 3, 3).
        height: Rows of the images.
        width: Columns.
        vehicles: (V, 6).
        pedestrians: (P, 6).
        signals: (S,) states.
        sunny: Whether things cast shadows.
        looks: Random number of the episode, see ``actor_variant``.
        nearby: Buffer.
        skyline: Buffer.
        hull: See ``cast_box``.
        records: Gets the faces.
        starts: (C + 1,) output, where each camera's begin.
    """
    find_nearby(scenery, ego, nearby)
    records.used[0] = 1
    for c in range(axes.shape[0]):
        view = camera_view(
            ego, pitch_rad, roll_rad, axes[c], places[c], intrinsics[c], height, width
        )
        starts[c] = records.used[0]
        skyline.row[:] = np.inf
        skyline.nearness[:] = 0.0
        draw_buildings(view, records, lighting, scenery, nearby, skyline)
        draw_street(view, records, lighting, scenery, nearby, skyline)
        draw_actors(
            view, records, lighting, scenery, skyline, vehicles, pedestrians, signals, looks
        )
        cast_shadows(
            view, records, lighting, scenery, nearby, ego, vehicles, pedestrians, sunny,
            looks, hull,
        )  # fmt: skip
    starts[axes.shape[0]] = records.used[0]


@leaf_kernel
def paint_images(
    ground: GroundTexture,
    atmosphere: Atmosphere,
    gain: NDArray,
    veil: NDArray,
    beam: NDArray,
    balance: NDArray,
    veil_rgb: Vector,
    ego: Ego,
    pitch_rad: float,
    roll_rad: float,
    axes: NDArray,
    places: NDArray,
    intrinsics: NDArray,
    canvas: Canvas,
    records: Records,
    starts: NDArray,
    scratch: RowScratch,
    dither: NDArray,
    planes: NDArray,
) -> None:
    """Render the images of one world, colour by colour, without blur and sensor noise.

    Args:
        ground: Ground texture.
        atmosphere: Weather.
        gain: (C, H, W) uint8, see ``Lens``.
        veil: (C, H, W) uint8.
        beam: (C, H, W) uint8.
        balance: (C, 3).
        veil_rgb: See ``Lens``.
        ego: As for ``list_faces``, likewise the next five.
        pitch_rad: See above.
        roll_rad: See above.
        axes: See above.
        places: See above.
        intrinsics: See above.
        canvas: Buffers.
        records: The faces.
        starts: (C + 1,) where each camera's begin.
        scratch: Buffers of a row.
        dither: See ``shade_image``.
        planes: (C, 3, H, W) uint8 output.
    """
    for c in range(planes.shape[0]):
        view = camera_view(
            ego, pitch_rad, roll_rad, axes[c], places[c], intrinsics[c], planes.shape[2],
            planes.shape[3],
        )  # fmt: skip
        fill_faces(view, canvas, records, starts[c], starts[c + 1])
        white = (balance[c, 0], balance[c, 1], balance[c, 2])
        lens = Lens(gain[c], veil[c], beam[c], white, veil_rgb)
        shade_image(
            view, canvas, ground, atmosphere, records, lens, scratch, dither,
            planes[c],
        )  # fmt: skip


@leaf_kernel
def add_noise(images: NDArray, tile: NDArray, start: int) -> None:
    """Add sensor noise to images (C, H, W, 3) uint8, in place.

    Args:
        images: The images.
        tile: (T,) int16 noise, T a power of two.
        start: Where in the tile this frame begins; each row begins somewhere else.
    """
    mask = tile.shape[0] - 1
    width = images.shape[2] * 3
    flat = images.reshape(-1, width)
    darkest, brightest = np.int16(0), np.int16(255)
    for row in range(flat.shape[0]):
        begin = (start + row * 7919) & mask
        if begin + width > tile.shape[0]:
            begin &= mask >> 1
        line, noise = flat[row], tile[begin : begin + width]
        for k in range(width):
            value = np.int16(np.int16(line[k]) + noise[k])
            line[k] = np.uint8(min(max(value, darkest), brightest))
