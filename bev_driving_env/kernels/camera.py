"""Rendering all camera images of one world."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import paints as paint
from .actors import draw_person, draw_signal, draw_vehicle, vehicle_height
from .jit import kernel
from .layout import HEADING, LENGTH, WIDTH, X, Y
from .mesh import Canvas, fill_faces, new_canvas
from .occlusion import Skyline, is_hidden, nearest_first, raise_skyline, within_reach
from .shading import Atmosphere, GroundTexture, Lens, RowScratch, shade_image
from .shadows import cast_box, cast_crown, cast_vehicle
from .shapes import (
    BRICKS,
    FOLIAGE,
    TWO_SIDED,
    Lighting,
    Records,
    draw_box,
    draw_gable,
    draw_sprite,
    draw_wall,
    new_records,
)
from .view import Vector, View, may_see

SIGHT_M = 150.0
TREES_M = 90.0
CARS_M = 70.0
KERBS_M = 28.0
SHADOWS_M = 35.0
PEOPLE_M = 60.0
DETAIL = 60.0
"""Boxes are drawn up to this many times their size away."""
BOXES, GABLES, SPRITES, CARS, KERBS = range(5)
KERB_HEIGHT_M = 0.12


class Scenery(NamedTuple):
    """Everything upright that does not move, as tables; built by ``cameras.scenery``.

    Attributes:
        boxes: (B, 12) x, y, cos, sin, half length, half width, low, high, slot, pattern, slot of
            the top, variant.
        gables: (G, 11) x, y, cos, sin, half length, half width, eaves, ridge, slot, slot of the
            roof, variant.
        sprites: (S, 9) x, y, z, half width, half height, round, slot, pattern, variant.
        cars: (K, 7) x, y, heading, length, width, height, variant.
        kerbs: (E, 4) end points x0, y0, x1, y1.
        signals: (S, 4) x, y and the direction that the head faces; in the order of the town's.
    """

    boxes: NDArray[np.float64]
    gables: NDArray[np.float64]
    sprites: NDArray[np.float64]
    cars: NDArray[np.float64]
    kerbs: NDArray[np.float64]
    signals: NDArray[np.float64]


class Nearby(NamedTuple):
    """Rows of the scenery's tables that are near enough to be seen, the nearest first."""

    counts: NDArray[np.int64]
    boxes: NDArray[np.int64]
    gables: NDArray[np.int64]
    sprites: NDArray[np.int64]
    cars: NDArray[np.int64]
    kerbs: NDArray[np.int64]


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


class Ego(NamedTuple):
    """The car that carries the cameras: it casts a shadow, but is not in its own pictures."""

    x: float
    y: float
    heading: float
    length_m: float
    width_m: float


def new_workspace(scenery: Scenery, cameras: int, height: int, width: int) -> Workspace:
    """Buffers for images of height by width in some scenery."""
    rng = np.random.default_rng(0)
    tables = (scenery.boxes, scenery.gables, scenery.sprites, scenery.cars, scenery.kerbs)
    return Workspace(
        nearby=Nearby(
            np.zeros(len(tables), np.int64), *(np.zeros(len(table), np.int64) for table in tables)
        ),
        skyline=Skyline(np.zeros(width), np.zeros(width)),
        canvas=new_canvas(height, width),
        records=new_records(),
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


@kernel
def camera_view(
    ego: Ego,
    pitch_rad: float,
    roll_rad: float,
    axes: NDArray,
    place: NDArray,
    intrinsics: NDArray,
    height: int,
    width: int,
) -> View:
    """Where a camera is and looks, given the body's pitch and roll about the ego's origin.

    Args:
        ego: The car.
        pitch_rad: Nose down.
        roll_rad: Right side down.
        axes: (3, 3) the camera's right, down, forward in the body frame.
        place: (3,) its position in the body frame.
        intrinsics: (3, 3).
        height: Rows.
        width: Columns.
    """
    cos_p, sin_p = math.cos(pitch_rad), math.sin(pitch_rad)
    cos_r, sin_r = math.cos(roll_rad), math.sin(roll_rad)
    cos_h, sin_h = math.cos(ego.heading), math.sin(ego.heading)
    turned = np.empty((4, 3))
    for k in range(4):
        if k < 3:
            x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        else:
            x, y, z = place[0], place[1], place[2]
        y, z = cos_r * y - sin_r * z, sin_r * y + cos_r * z
        x, z = cos_p * x + sin_p * z, -sin_p * x + cos_p * z
        # ego x is forward, y left; the world has y south, so left is (sin, -cos)
        turned[k, 0] = cos_h * x + sin_h * y
        turned[k, 1] = sin_h * x - cos_h * y
        turned[k, 2] = z
    turned[3, 0] += ego.x
    turned[3, 1] += ego.y
    return View(
        height,
        width,
        intrinsics[0, 0],
        intrinsics[0, 2],
        intrinsics[1, 2],
        (
            (turned[0, 0], turned[0, 1], turned[0, 2]),
            (turned[1, 0], turned[1, 1], turned[1, 2]),
            (turned[2, 0], turned[2, 1], turned[2, 2]),
        ),
        (turned[3, 0], turned[3, 1], turned[3, 2]),
    )


@kernel
def find_nearby(scenery: Scenery, ego: Ego, nearby: Nearby) -> None:
    """List what is near enough to be seen, the nearest first, once for all cameras."""
    x, y = ego.x, ego.y
    counts = nearby.counts
    counts[BOXES] = nearest_first(scenery.boxes, scenery.boxes[:, 4], x, y, SIGHT_M, nearby.boxes)
    counts[GABLES] = nearest_first(
        scenery.gables, scenery.gables[:, 4], x, y, SIGHT_M, nearby.gables
    )
    counts[SPRITES] = within_reach(scenery.sprites, x, y, TREES_M, nearby.sprites)
    counts[CARS] = within_reach(scenery.cars, x, y, CARS_M, nearby.cars)
    counts[KERBS] = within_reach(scenery.kerbs, x, y, KERBS_M, nearby.kerbs)


@kernel
def draw_buildings(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    skyline: Skyline,
) -> None:
    """Boxes and gables, front to back, leaving out what nearer buildings hide."""
    boxes = scenery.boxes
    for i in range(nearby.counts[BOXES]):
        box = boxes[nearby.boxes[i]]
        radius = math.sqrt(box[4] ** 2 + box[5] ** 2)
        size = radius + box[7] - box[6]
        if not may_see(view, box[0], box[1], radius, DETAIL * size):
            continue
        if is_hidden(view, skyline, box[0], box[1], radius, box[7]):
            continue
        draw_box(
            view, records, lighting, box[0], box[1], box[2], box[3], box[4], box[5],
            box[6], box[7], int(box[8]), int(box[9]), int(box[10]), int(box[11]),
        )  # fmt: skip
        if box[6] == 0.0 and box[7] > view.place[2]:
            hide_behind(view, skyline, box)
    gables = scenery.gables
    for i in range(nearby.counts[GABLES]):
        row = gables[nearby.gables[i]]
        radius = math.sqrt(row[4] ** 2 + row[5] ** 2) + 1.0
        if may_see(view, row[0], row[1], radius, SIGHT_M) and not is_hidden(
            view, skyline, row[0], row[1], radius, row[7]
        ):
            draw_gable(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4], row[5],
                row[6], row[7], int(row[8]), int(row[9]), int(row[10]),
            )  # fmt: skip


@kernel
def hide_behind(view: View, skyline: Skyline, box: NDArray) -> None:
    """Raise the skyline by the two diagonals of a box: each hides what is behind the box."""
    ax, ay = box[2] * box[4], box[3] * box[4]
    bx, by = -box[3] * box[5], box[2] * box[5]
    x, y = box[0], box[1]
    raise_skyline(view, skyline, x + ax + bx, y + ay + by, x - ax - bx, y - ay - by, box[7])
    raise_skyline(view, skyline, x + ax - bx, y + ay - by, x - ax + bx, y - ay + by, box[7])


@kernel
def draw_street(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    skyline: Skyline,
) -> None:
    """Trees, poles, parked cars and kerbs, after the buildings that may hide them."""
    for i in range(nearby.counts[SPRITES]):
        row = scenery.sprites[nearby.sprites[i]]
        if may_see(view, row[0], row[1], row[3], TREES_M) and not is_hidden(
            view, skyline, row[0], row[1], row[3], row[2] + row[4]
        ):
            draw_sprite(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4],
                row[5] > 0.0, int(row[6]), int(row[7]), int(row[8]),
            )  # fmt: skip
    for i in range(nearby.counts[CARS]):
        car = scenery.cars[nearby.cars[i]]
        if may_see(view, car[0], car[1], car[3], CARS_M) and not is_hidden(
            view, skyline, car[0], car[1], car[3], car[5]
        ):
            draw_vehicle(
                view, records, lighting, car[0], car[1], car[2], car[3], car[4], car[5],
                int(car[6]),
            )  # fmt: skip
    for i in range(nearby.counts[KERBS]):
        kerb = scenery.kerbs[nearby.kerbs[i]]
        x, y = (kerb[0] + kerb[2]) / 2.0, (kerb[1] + kerb[3]) / 2.0
        if may_see(view, x, y, 5.0, KERBS_M):
            draw_wall(
                view, records, lighting, kerb[0], kerb[1], kerb[2], kerb[3], 0.0,
                KERB_HEIGHT_M, paint.KERB, BRICKS, nearby.kerbs[i], TWO_SIDED,
            )  # fmt: skip


@kernel
def draw_actors(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    vehicles: NDArray,
    pedestrians: NDArray,
    signals: NDArray,
) -> None:
    """Vehicles, people and signal heads; a row's number decides its colours."""
    for k in range(vehicles.shape[0]):
        length = vehicles[k, LENGTH]
        if length > 0.0 and may_see(view, vehicles[k, X], vehicles[k, Y], length, SIGHT_M):
            draw_vehicle(
                view, records, lighting, vehicles[k, X], vehicles[k, Y],
                vehicles[k, HEADING], length, vehicles[k, WIDTH], vehicle_height(length), 37 * k,
            )  # fmt: skip
    for k in range(pedestrians.shape[0]):
        size = pedestrians[k, LENGTH]
        if size > 0.0 and may_see(view, pedestrians[k, X], pedestrians[k, Y], 1.0, PEOPLE_M):
            # children have smaller footprints
            height = min(max(1.1, 3.2 * pedestrians[k, WIDTH]), 1.65) + 0.03 * (k % 7)
            draw_person(
                view, records, lighting, pedestrians[k, X], pedestrians[k, Y],
                pedestrians[k, WIDTH], height, 11 * k,
            )  # fmt: skip
    heads = scenery.signals
    for k in range(heads.shape[0]):
        if may_see(view, heads[k, 0], heads[k, 1], 1.0, TREES_M):
            draw_signal(
                view, records, lighting, heads[k, 0], heads[k, 1], heads[k, 2],
                heads[k, 3], signals[k],
            )  # fmt: skip


@kernel
def is_near(ego: Ego, x: float, y: float, reach_m: float) -> bool:
    """Whether a shadow that reaches so far can fall where shadows are drawn."""
    reach = SHADOWS_M + min(reach_m, SHADOWS_M)
    return (x - ego.x) ** 2 + (y - ego.y) ** 2 < reach * reach


@kernel
def cast_shadows(
    view: View,
    records: Records,
    lighting: Lighting,
    scenery: Scenery,
    nearby: Nearby,
    ego: Ego,
    vehicles: NDArray,
    pedestrians: NDArray,
    sunny: bool,
    hull: NDArray,
) -> None:
    """All shadows on the ground that a camera may see."""
    for k in range(vehicles.shape[0]):
        if vehicles[k, LENGTH] > 0.0:
            cast_vehicle(
                view, records, lighting, vehicles[k, X], vehicles[k, Y], vehicles[k, HEADING],
                vehicles[k, LENGTH], vehicles[k, WIDTH], vehicle_height(vehicles[k, LENGTH]),
                sunny, hull,
            )  # fmt: skip
    for i in range(nearby.counts[CARS]):
        car = scenery.cars[nearby.cars[i]]
        cast_vehicle(
            view, records, lighting, car[0], car[1], car[2], car[3], car[4], car[5], sunny, hull
        )
    if not sunny:
        return
    cast_box(
        view, records, lighting, ego.x, ego.y, math.cos(ego.heading), math.sin(ego.heading),
        ego.length_m / 2.0, ego.width_m / 2.0, 0.02, 1.4, hull,
    )  # fmt: skip
    for i in range(nearby.counts[BOXES]):
        box = scenery.boxes[nearby.boxes[i]]
        if box[7] - box[6] > 0.6 and is_near(ego, box[0], box[1], box[4] + 5.0 * box[7]):
            cast_box(
                view, records, lighting, box[0], box[1], box[2], box[3], box[4], box[5], box[6],
                box[7], hull,
            )  # fmt: skip
    for i in range(nearby.counts[GABLES]):
        row = scenery.gables[nearby.gables[i]]
        if is_near(ego, row[0], row[1], row[4] + 5.0 * row[7]):
            cast_box(
                view, records, lighting, row[0], row[1], row[2], row[3], row[4], 0.3, 0.0, row[7],
                hull,
            )  # fmt: skip
    for i in range(nearby.counts[SPRITES]):
        row = scenery.sprites[nearby.sprites[i]]
        if not is_near(ego, row[0], row[1], 5.0 * row[2]):
            continue
        if int(row[7]) == FOLIAGE:
            cast_crown(view, records, lighting, row[0], row[1], row[2], row[3], row[4])
        else:
            cast_box(
                view, records, lighting, row[0], row[1], 1.0, 0.0, row[3], row[3],
                row[2] - row[4], row[2] + row[4], hull,
            )  # fmt: skip
    for k in range(pedestrians.shape[0]):
        if pedestrians[k, LENGTH] > 0.0:
            cast_box(
                view, records, lighting, pedestrians[k, X], pedestrians[k, Y], 1.0, 0.0, 0.22, 0.22,
                0.0, 1.7, hull,
            )  # fmt: skip


@kernel
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
        draw_actors(view, records, lighting, scenery, vehicles, pedestrians, signals)
        cast_shadows(
            view, records, lighting, scenery, nearby, ego, vehicles, pedestrians, sunny,
            hull,
        )  # fmt: skip
    starts[axes.shape[0]] = records.used[0]


@kernel
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


@kernel
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
