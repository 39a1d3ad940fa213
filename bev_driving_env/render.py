"""Drawing with OpenCV, without a display: BEV in colour, town maps, the panel of ``render()``."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from .frames import CHANNELS, footprint
from .kernels.layout import (
    JUNCTION_BIT,
    LANE_BIT,
    LENGTH,
    ROAD_BIT,
    ROUTE_DONE,
    SIDEWALK_BIT,
    SIGNAL_GREEN,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
    WIDTH,
)
from .towns.compiled import CompiledTown
from .towns.raster import MARGIN_M

if TYPE_CHECKING:
    from .sensors import Sensors
    from .world.config import WorldConfig
    from .world.core import World

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]
Coordinates = Sequence[float] | NDArray[np.float64]

BEV_COLOURS: dict[str, Colour] = {
    "road": (70, 72, 80),
    "route": (70, 130, 230),
    "lane": (240, 240, 235),
    "vehicles": (240, 170, 40),
    "pedestrians": (220, 70, 160),
    "lights": (230, 50, 40),
}
SIGNAL_COLOURS: dict[int, Colour] = {
    SIGNAL_GREEN: (40, 200, 80),
    SIGNAL_YELLOW: (250, 190, 30),
    SIGNAL_RED: (230, 50, 40),
}
ON_MAP = 1.6
"""Vehicles on the panel's map are drawn this much larger."""
GROUND: Colour = (226, 232, 218)
SIDEWALK: Colour = (198, 196, 190)
ROAD: Colour = (128, 130, 136)
JUNCTION: Colour = (116, 118, 124)
LINE: Colour = (245, 245, 240)
INK: Colour = (20, 24, 32)
EGO: Colour = (40, 200, 90)
PANEL_PX = 420
CAPTION_PX = 28


def bev_image(bev: Image) -> Image:
    """A BEV (6, H, W) as an RGB image (H, W, 3); later channels are drawn over earlier ones."""
    image = np.full((*bev.shape[1:], 3), 24, np.float32)
    for name, plane in zip(CHANNELS, bev, strict=True):
        share = plane[..., None].astype(np.float32) / 255.0
        image += share * (np.array(BEV_COLOURS[name], np.float32) - image)
    return image.round().astype(np.uint8)


class TownMap:
    """A town seen from above, to draw on, in world coordinates.

    Args:
        town: The town.
        px_per_m: Resolution.
        margin_m: Ground shown around the outermost lanes.
    """

    def __init__(self, town: CompiledTown, px_per_m: float = 2.0, margin_m: float = 14.0) -> None:
        self.px_per_m = px_per_m
        self.origin = np.array(town.bounds[:2]) - margin_m
        self.image: Image = _empty_map(town, px_per_m, margin_m).copy()

    def _pixels(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """World points (..., 2) as fixed-point pixels with 4 fractional bits."""
        pixels = (np.asarray(points)[..., :2] - self.origin) * self.px_per_m - 0.5
        return np.asarray((pixels * 16.0).round(), dtype=np.int32)

    def line(self, points: NDArray[np.float64], colour: Colour, width_px: int = 2) -> None:
        """Draw a polyline through world points (P, 2 or more columns)."""
        if len(points) > 1:
            cv2.polylines(
                self.image, [self._pixels(points)], False, colour, width_px, cv2.LINE_AA, 4
            )

    def polygon(self, points: NDArray[np.float64], colour: Colour) -> None:
        """Fill a polygon with corners at world points (P, 2)."""
        cv2.fillPoly(self.image, [self._pixels(points)], colour, cv2.LINE_AA, 4)

    def dot(
        self, point: Coordinates, colour: Colour, radius_px: float, border: Colour = INK
    ) -> None:
        """Draw a filled circle with a border at a world point."""
        x, y = self._pixels(np.array(point, dtype=np.float64)).tolist()
        radius = round(radius_px * 16)
        cv2.circle(self.image, (x, y), radius, colour, -1, cv2.LINE_AA, 4)
        cv2.circle(self.image, (x, y), radius, border, 1, cv2.LINE_AA, 4)

    def arrow(self, pose: Coordinates, colour: Colour, length_m: float = 9.0) -> None:
        """Draw an arrowhead at a world pose, pointing along its heading."""
        head = footprint(pose, length_m, length_m * 0.7)
        tip, back = head[:2].mean(axis=0), (head[2:].mean(axis=0) + np.array(pose[:2])) / 2.0
        corners = np.array([tip, head[2], back, head[3]])
        self.polygon(corners, colour)
        self.line(np.vstack([corners, corners[:1]]), INK, 1)

    def label(self, point: Coordinates, text: str, offset_px: tuple[int, int] = (7, -7)) -> None:
        """Write a short text beside a world point, on a light box so that it stays legible."""
        x, y = (self._pixels(np.array(point, dtype=np.float64)) // 16).tolist()
        write(self.image, text, (x + offset_px[0], y + offset_px[1]))


@functools.lru_cache(maxsize=8)
def _empty_map(town: CompiledTown, px_per_m: float, margin_m: float) -> Image:
    """A town without anything drawn on it."""
    x0, y0, x1, y1 = town.bounds
    raster = town.classes()
    scale = raster.grid.px_per_m
    inner_m = min(margin_m, MARGIN_M - 1.0)
    left = round((x0 - inner_m - raster.grid.x0_m) * scale)
    top = round((y0 - inner_m - raster.grid.y0_m) * scale)
    width = round((x1 - x0 + 2.0 * inner_m) * scale)
    height = round((y1 - y0 + 2.0 * inner_m) * scale)
    bits = raster.pixels[top : top + height, left : left + width]
    bits = np.pad(bits, round((margin_m - inner_m) * scale))
    image = np.empty((*bits.shape, 3), np.uint8)
    image[:] = GROUND
    for bit, colour in (
        (SIDEWALK_BIT, SIDEWALK),
        (ROAD_BIT, ROAD),
        (JUNCTION_BIT, JUNCTION),
        (LANE_BIT, LINE),
    ):
        image[bits & bit != 0] = colour
    height, width = bits.shape
    size = (round(width * px_per_m / scale), round(height * px_per_m / scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def write(image: Image, text: str, origin: tuple[int, int], scale: float = 0.45) -> None:
    """Write text with its lower left corner at a pixel, dark on a light box."""
    font = cv2.FONT_HERSHEY_SIMPLEX
    (width, height), below = cv2.getTextSize(text, font, scale, 1)
    x, y = origin
    box = image[max(0, y - height - 3) : y + below + 2, max(0, x - 3) : x + width + 3]
    box[:] = (box.astype(np.uint16) + 3 * 255) // 4
    cv2.putText(image, text, origin, font, scale, INK, 1, cv2.LINE_AA)


def draw_panel(sensors: Sensors, n: int, policy_bev: Image) -> Image:
    """The picture of one world: town map, what the policy sees, the truth, cameras, route map.

    Args:
        sensors: Sensors of the worlds.
        n: Which world.
        policy_bev: (6, size, size) what its policy saw last.

    Returns:
        RGB image (H, W, 3).
    """
    world, side = sensors.world, PANEL_PX
    selected = np.arange(len(world)) == n
    truth = np.zeros((len(world), *world.bev_shape), np.uint8)
    world.render(truth, selected)
    top = [
        _labelled(_map_panel(world, n, side), world.town.name),
        _labelled(bev_panel(world.config, policy_bev, side), "BEV, what the policy sees"),
        _labelled(bev_panel(world.config, truth[n], side), "BEV, truth"),
    ]
    size = side * 7 // 15, side
    tiles = [fit_tile(image, size, name) for name, image in _views(sensors, n)]
    route_map = sensors.route_maps(selected)[n]
    tiles.append(fit_tile(np.repeat(route_map[..., None], 3, axis=2), size, "route map"))
    tiles.append(_channels(policy_bev, size))
    tiles += [np.full((*size, 3), 24, np.uint8)] * (-len(tiles) % 3)
    rows = [np.hstack(tiles[k : k + 3]) for k in range(0, len(tiles), 3)]
    panels = np.vstack([np.hstack(top), *rows])
    return np.vstack([panels, _caption(world, n, panels.shape[1])])


def _labelled(image: Image, text: str) -> Image:
    image[:, -1:] = image[-1:] = 90
    write(image, text, (6, 16), 0.4)
    return image


def _views(sensors: Sensors, n: int) -> list[tuple[str, Image]]:
    """Names and images of the cameras, from the one that looks left round to the rear."""
    cameras = sensors.settings.rig.cameras
    order = sorted(range(len(cameras)), key=lambda k: (135.0 - cameras[k].yaw_deg) % 360.0)
    images = sensors.images(n)
    return [(cameras[k].name, images[k]) for k in order]


def fit_tile(image: Image, size: tuple[int, int], name: str) -> Image:
    """An RGB image scaled into a tile (height, width, 3), in the middle, with its name."""
    tile: Image = np.full((*size, 3), 24, np.uint8)
    scale = min(size[0] / image.shape[0], size[1] / image.shape[1])
    height, width = round(image.shape[0] * scale), round(image.shape[1] * scale)
    scaled = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)
    top, left = (size[0] - height) // 2, (size[1] - width) // 2
    tile[top : top + height, left : left + width] = scaled
    return _labelled(tile, name)


def bev_panel(config: WorldConfig, bev: Image, side: int) -> Image:
    """A BEV (6, H, W) in colour with the ego's footprint, as a square of a number of pixels."""
    shrinks = side < config.bev.size
    how = cv2.INTER_AREA if shrinks else cv2.INTER_NEAREST
    view: Image = np.asarray(cv2.resize(bev_image(bev), (side, side), interpolation=how), np.uint8)
    ego_px = config.bev.pixel_from_ego(
        footprint((0.0, 0.0, 0.0), config.vehicle.length_m, config.vehicle.width_m) * [1.0, -1.0]
    )
    corners = ((ego_px + 0.5) * side / config.bev.size * 16.0).round().astype(np.int32)
    cv2.fillPoly(view, [corners], EGO, cv2.LINE_AA, 4)
    return view


def _caption(world: World, n: int, width: int) -> Image:
    """A strip with the episode's name, time, speed, metres and infractions."""
    state = world.state
    strip: Image = np.full((CAPTION_PX, width, 3), 255, np.uint8)
    words = [
        world.episode_ids[n],
        f"{state.steps[n] * world.config.step_s:.1f} s",
        f"{state.ego[n, SPEED]:.2f} m/s",
        f"{state.progress[n, ROUTE_DONE]:.1f} of {state.route_length[n]:.1f} m",
        *(event.name for event in world.events[n][-3:]),
    ]
    for k, word in enumerate(words):
        write(strip, word, (10 + 170 * k, 19), 0.5)
    return strip


def _map_panel(world: World, n: int, side: int) -> Image:
    """The whole town with route and ego, scaled into a square."""
    x0, y0, x1, y1 = world.town.bounds
    town_map = TownMap(world.town, side / (max(x1 - x0, y1 - y0) + 28.0))
    state = world.state
    route = state.route_points[n, : state.route_size[n]]
    town_map.line(route, BEV_COLOURS["route"], 3)
    if len(route):
        town_map.dot(route[-1, :2], (255, 255, 255), 5.0)
    _draw_actors(town_map, world, n)
    for event in world.events[n]:
        town_map.dot((event.x, event.y), BEV_COLOURS["lights"], 5.0)
    town_map.arrow(state.ego[n, :3], EGO, 10.0)
    panel = np.empty((side, side, 3), np.uint8)
    panel[:] = GROUND
    height, width = town_map.image.shape[:2]
    top, left = max(0, (side - height) // 2), max(0, (side - width) // 2)
    panel[top : top + height, left : left + width] = town_map.image[:side, :side]
    return panel


def _draw_actors(town_map: TownMap, world: World, n: int) -> None:
    """Signals, pedestrians and vehicles, larger than they are so that they can be seen."""
    state = world.state
    for signal, shown in zip(world.town.signals, state.signals[n].tolist(), strict=True):
        if shown in SIGNAL_COLOURS:
            colour = SIGNAL_COLOURS[shown]
            town_map.dot((signal.x, signal.y), colour, 2.0, colour)
    colour = BEV_COLOURS["pedestrians"]
    for row in state.pedestrians[n]:
        if row[LENGTH] > 0.0:
            town_map.dot(row[:2], colour, 1.2, colour)
    for row in state.vehicles[n]:
        if row[LENGTH] > 0.0:
            box = footprint(row[:3], *(ON_MAP * row[[LENGTH, WIDTH]]))
            town_map.polygon(box, BEV_COLOURS["vehicles"])


def _channels(bev: Image, size: tuple[int, int]) -> Image:
    """The six channels as small pictures in two rows of three."""
    tile: Image = np.full((*size, 3), 24, np.uint8)
    side = min(size[0] // 2, size[1] // 3)
    for k, (name, plane) in enumerate(zip(CHANNELS, bev, strict=True)):
        grey = cv2.resize(plane, (side, side), interpolation=cv2.INTER_AREA)
        image: Image = np.repeat(np.asarray(grey, np.uint8)[..., None], 3, axis=2)
        top, left = k // 3 * side, k % 3 * side + (size[1] - 3 * side) // 2
        image[:, -1:] = image[-1:] = 90
        write(image, name, (4, 13), 0.34)
        tile[top : top + side, left : left + side] = image
    return tile
