"""``IPM``: inverse perspective mapping, and what is found in it by colour."""

import functools
import itertools

import numpy as np
import pytest

from bev_driving_env.bev import BEVRenderer, bev_window
from bev_driving_env.cameras.renderer import CameraRenderer, CameraSettings
from bev_driving_env.cameras.rig import SURROUND, Camera, CameraRig, ground_points, project
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.kernels.route_map import render_route_maps
from bev_driving_env.sources import ipm, ipm_ground
from bev_driving_env.sources.ipm import IPM
from bev_driving_env.sources.ipm_ground import Gaps
from bev_driving_env.sources.protocol import BEVSource, SensorFrame
from bev_driving_env.towns.plan import sparse_plan
from bev_driving_env.towns.registry import compiled_town, route_book
from bev_driving_env.world.state import WorldState

GEOMETRY = BEVGeometry()
RIG = CameraRig()
ASPHALT, WALK, GRASS, PAINT, SKY = (
    (98, 100, 104),
    (180, 176, 170),
    (84, 118, 52),
    (235, 235, 230),
    (180, 200, 230),
)


def frame(images, rig=RIG, route_map=None):
    return SensorFrame(
        images,
        rig.intrinsics(),
        rig.extrinsics(),
        np.zeros((192, 192), np.uint8) if route_map is None else route_map,
        np.zeros(3, np.float32),
    )


def images_of(paint, rig=RIG):
    """What a rig sees of flat ground with colours paint(x, y) -> (..., 3), pixel by pixel."""
    height, width = rig.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    images = np.empty(rig.shape, np.uint8)
    for image, intrinsic, extrinsic in zip(images, rig.intrinsics(), rig.extrinsics(), strict=True):
        points = ground_points(intrinsic, extrinsic, pixels)
        seen = np.isfinite(points[..., 0])
        image[...] = np.where(
            seen[..., None], paint(*np.moveaxis(np.nan_to_num(points), -1, 0)), SKY
        )
    return images


def cells(geometry=GEOMETRY):
    """Ego-frame x and y of all BEV cells."""
    v, u = np.mgrid[: geometry.size, : geometry.size]
    return np.moveaxis(geometry.ego_from_pixel(np.stack([u, v], axis=-1)), -1, 0)


def street(x, y, half_width=4.0, line=True, gains=None):
    """A straight street, 2 m left of the ego, with sidewalks, lawns, and asphalted yards."""
    aside = np.abs(y - 2.0)
    bands = [(aside < 14.0, ASPHALT), (aside < 10.0, GRASS), (aside < 8.0, WALK)]
    bands.append((aside < half_width, ASPHALT))
    if line:
        bands.append((np.abs(aside - half_width + 0.3) < 0.07, PAINT))
    colours = np.broadcast_to(np.array(GRASS, np.float64), (*np.shape(x), 3))
    for where, colour in bands:
        colours = np.where(where[..., None], colour, colours)
    return colours


def iou(a, b, where=True):
    a, b = (a > 0) & where, (b > 0) & where
    return (a & b).sum() / max(1, (a | b).sum())


X, Y = cells()
WITHIN_15_M = np.hypot(X, Y) <= 15.0


@pytest.fixture(scope="module")
def source():
    return IPM()


# geometry


def test_it_is_a_bev_source(source):
    assert isinstance(source, BEVSource)
    assert source.channels == ("road", "route", "lane")
    source.reset()


@pytest.mark.parametrize(
    "rig", [RIG, CameraRig(SURROUND[:1]), CameraRig(SURROUND, (224, 480))], ids=["4", "1", "large"]
)
def test_a_checkerboard_on_the_ground_comes_back_on_its_cells(source, rig):
    def board(x, y):
        odd = (np.floor(x / 2.0) + np.floor(y / 2.0)) % 2
        return np.where(odd[..., None] > 0, (250, 20, 120), (10, 200, 60))

    rgb, seen = source.project(frame(images_of(board, rig), rig))
    # pictures are sampled between pixels: leave out the edges of the fields
    inner = (np.abs(X % 2.0 - 1.0) < 0.6) & (np.abs(Y % 2.0 - 1.0) < 0.6)
    inner &= seen & (np.hypot(X, Y) < 9.0)
    assert inner.sum() > 400
    np.testing.assert_array_equal(rgb[inner], board(X, Y)[inner])


def test_a_gradient_on_the_ground_is_exact_to_a_grey_level(source):
    def ramp(x, y):
        return np.stack([128 + 4 * x, 128 + 4 * y, 128 - 2 * x - 2 * y], axis=-1).clip(0, 255)

    rgb, seen = source.project(frame(images_of(ramp)))
    near = seen & (np.hypot(X, Y) < 15.0)
    assert np.abs(rgb[near].astype(float) - ramp(X, Y)[near]).max() <= 4.0
    assert np.abs(rgb[near].astype(float) - ramp(X, Y)[near]).mean() < 0.7


@pytest.mark.parametrize("cameras", [SURROUND, SURROUND[:1], SURROUND[1:3]])
def test_a_cell_is_seen_if_it_lies_in_a_picture_and_is_black_if_not(source, cameras):
    rig = CameraRig(cameras)
    rgb, seen = source.project(frame(np.full(rig.shape, 255, np.uint8), rig))
    expected = np.zeros_like(seen)
    for intrinsic, extrinsic in zip(rig.intrinsics(), rig.extrinsics(), strict=True):
        (u, v), _ = (
            np.moveaxis(project(intrinsic, extrinsic, np.stack([X, Y, 0 * X], -1))[0], -1, 0),
            0,
        )
        expected |= (u > -0.5) & (u < 239.5) & (v > -0.5) & (v < 111.5)
    np.testing.assert_array_equal(seen, expected)
    for channel in np.moveaxis(rgb, -1, 0):
        np.testing.assert_array_equal(channel, np.where(seen, np.uint8(255), np.uint8(0)))


def test_of_several_cameras_the_one_with_the_sharper_picture_is_asked(source):
    wide, narrow = Camera("wide", fov_deg=120.0), Camera("narrow", fov_deg=40.0)
    for cameras in ((wide, narrow), (narrow, wide)):
        rig = CameraRig(cameras)
        images = np.zeros(rig.shape, np.uint8)
        images[cameras.index(narrow)] = 200
        rgb, _ = source.project(frame(images, rig))
        _, alone = source.project(frame(images[:1], CameraRig((narrow,))))
        np.testing.assert_array_equal(rgb[..., 0] > 0, alone)


def test_more_pictures_than_opencv_takes_at_once_are_seen_alike(monkeypatch):
    images = np.random.default_rng(0).integers(0, 256, RIG.shape, np.uint8)
    together, _ = IPM().project(frame(images))
    monkeypatch.setattr(ipm_ground, "OPENCV_MOST_ROWS", 0)
    apart, _ = IPM().project(frame(images))
    assert np.abs(together.astype(int) - apart).max() <= 8  # another rounding of positions
    assert np.abs(together.astype(int) - apart).mean() < 1.0


def test_tables_are_made_once_for_each_rig(monkeypatch):
    made = []

    class Counted(ipm.GroundView):
        def __init__(self, *arguments):
            made.append(1)
            super().__init__(*arguments)

    monkeypatch.setattr(ipm, "GroundView", Counted)
    source = IPM()
    images = images_of(street)
    for _ in range(3):
        source(frame(images.copy()))
        source.reset()
    assert len(made) == 1
    other = CameraRig(
        (SURROUND[0], *(Camera(c.name, c.x_m, c.y_m, 1.6, c.yaw_deg) for c in SURROUND[1:]))
    )
    for rig in (other, RIG, CameraRig(SURROUND, (64, 128))):
        here = frame(images_of(street, rig), rig)
        np.testing.assert_array_equal(source(here), IPM()(here))
    assert len(made) == 1 + 2 * 3


@pytest.mark.parametrize(
    "geometry",
    [
        BEVGeometry(size=16, px_per_m=20.0, ego_row=15),
        BEVGeometry(size=64, px_per_m=0.5, ego_row=0),
        BEVGeometry(size=130, px_per_m=3.3, ego_row=100),
        BEVGeometry(size=384, px_per_m=10.0, ego_row=304),
    ],
)
@pytest.mark.parametrize(
    "cameras", [SURROUND, SURROUND[:1], (*SURROUND, Camera("up", pitch_deg=-80.0))]
)
def test_any_window_and_any_cameras_will_do(geometry, cameras):
    rig = CameraRig(cameras, (40, 90))
    empty = np.zeros((geometry.size, geometry.size), np.uint8)
    for images in (images_of(street, rig), np.zeros(rig.shape, np.uint8)):
        planes = IPM(geometry)(frame(images, rig, empty))
        assert planes.shape == (3, geometry.size, geometry.size)
        assert planes.dtype == np.uint8
        assert set(np.unique(planes)) <= {0, 255}


# road and lines


@pytest.mark.parametrize(
    "geometry", [GEOMETRY, BEVGeometry(384, 10.0, 304), BEVGeometry(96, 2.5, 76)]
)
def test_a_street_is_found_and_the_yards_of_its_colour_are_not(geometry):
    x, y = cells(geometry)
    empty = np.zeros(x.shape, np.uint8)
    road = IPM(geometry)(frame(images_of(street), route_map=empty))[0]
    near = np.hypot(x, y) <= 15.0
    assert iou(road, np.abs(y - 2.0) < 4.0, near) > 0.92
    assert not road[(np.abs(y - 2.0) > 5.5) & near].any()


@pytest.mark.parametrize(
    "gains", [(0.92, 0.92, 0.92), (1.08, 0.92, 1.0), (0.92, 1.08, 1.08), (1.08, 1.08, 0.92)]
)
def test_cameras_of_different_exposure_find_the_same_street(source, gains):
    images = images_of(street).astype(np.float64)
    images[1:] *= np.array(gains)[:, None, None, None]
    road = source(frame(images.astype(np.uint8)))[0]
    assert iou(road, np.abs(Y - 2.0) < 4.0, WITHIN_15_M) > 0.92


def test_patches_and_shadows_on_the_road_belong_to_it(source):
    def patched(x, y):
        colours = street(x, y)
        on_road = np.abs(y - 2.0) < 4.0
        patch = on_road & (np.abs(x - 12.0) < 1.5) & (np.abs(y - 3.0) < 1.0)
        colours = np.where(patch[..., None], (76, 78, 82), colours)
        shadow = on_road & (np.abs(x - 7.0) < 0.6)
        return np.where(shadow[..., None], 0.5 * colours, colours)

    road = source(frame(images_of(patched)))[0]
    assert iou(road, np.abs(Y - 2.0) < 4.0, WITHIN_15_M) > 0.92


def test_straight_edges_go_on_where_nothing_is_seen():
    seen = np.ones((60, 60), np.bool_)
    seen[20:40, 20:40] = False
    rows, columns = np.mgrid[:60, :60]
    for edge in (columns < 27, columns + rows < 55, rows > 33, columns - rows / 2.0 > 12.0):
        plane = (edge & seen).astype(np.uint8)
        Gaps(seen, 30).fill(plane)
        assert (plane != edge).sum() <= 12  # of 400
        np.testing.assert_array_equal(plane[seen], edge[seen])


def test_painted_lines_are_found_and_plain_asphalt_has_none(source):
    lane = source(frame(images_of(street)))[2] > 0
    aside = np.abs(Y - 2.0)
    assert lane.sum() > 100
    assert (np.abs(aside[lane] - 3.7) < 0.9).all()
    plain = source(frame(images_of(functools.partial(street, line=False))))
    assert plain[0].any()
    assert not plain[2][aside < 3.0].any()  # the bright edge of the sidewalk may be one


def test_dark_cameras_show_neither_road_nor_line(source):
    route_map = np.zeros((192, 192), np.uint8)
    route_map[0:10, 90:102] = 128
    planes = source(frame(np.zeros(RIG.shape, np.uint8), route_map=route_map))
    assert not planes[[0, 2]].any()
    assert planes[1].any()  # a map needs no light


def test_one_dark_camera_blinds_one_side_only(source):
    images = images_of(street)
    images[1] = 0
    road = source(frame(images))[0] > 0
    straight_left = (np.abs(X) < 1.0) & (Y > 4.0) & (Y < 5.5)
    assert not road[straight_left].any()
    assert road[(np.abs(Y) < 1.0) & (np.abs(X) < 15.0)].all()


# route


def route_map_of(*points, marker=None):
    """A map with discs at ego-frame points, and a marker."""
    plane = np.zeros((192, 192), np.uint8)
    if marker is not None:
        plane[np.hypot(X - marker[0], Y - marker[1]) <= 2.0] = 128
    for x, y in points:
        plane[np.hypot(X - x, Y - y) <= 2.0] = 255
    return plane


def route_of(source, route_map):
    return source(frame(np.zeros(RIG.shape, np.uint8), route_map=route_map))[1] > 0


@pytest.mark.parametrize(
    "route_map",
    [
        route_map_of(marker=(30.4, 0.0)),
        route_map_of((12.0, 0.0), marker=(30.4, 0.0)),
        route_map_of((22.0, 0.0), (10.0, 0.0), (13.0, 0.0), marker=(30.4, 0.0)),
        route_map_of((1.0, 0.4), marker=(30.4, 0.0)),
    ],
)
def test_straight_ahead_is_a_band_of_the_width_of_the_route(source, route_map):
    truth = (X >= 0.0) & (np.abs(Y) <= 1.6)
    route = route_of(source, route_map)
    assert iou(route, truth) > 0.93
    assert not route[X < -0.1].any()


def test_it_ends_at_the_last_point_if_there_is_no_marker(source):
    route = route_of(source, route_map_of((12.0, 0.0)))
    assert iou(route, (X >= 0.0) & (X <= 12.0) & (np.abs(Y) <= 1.6)) > 0.85


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_is_an_arc_from_its_entry_to_its_exit(source, side):
    route = route_of(
        source,
        route_map_of((8.0, 0.0), (18.0, 10.0 * side), marker=(18.0 * 19.2 / 50.0, 19.2 * side)),
    )
    arc = np.abs(np.hypot(X - 8.0, Y - 10.0 * side) - 10.0) <= 1.6
    arc &= (X >= 8.0) & (Y * side <= 10.0)
    truth = arc | ((np.abs(Y) <= 1.6) & (X >= 0.0) & (X < 8.0))
    truth |= (np.abs(X - 18.0) <= 1.6) & (Y * side > 10.0)
    assert iou(route, truth) > 0.85


def test_without_a_map_there_is_no_route(source):
    assert not route_of(source, route_map_of()).any()


# rendered images


@functools.lru_cache(maxsize=2)
def drives(name, count=10):
    """Frames of evaluation episodes of a town without traffic, and their true BEVs."""
    town, book = compiled_town(name), route_book(name)
    cameras = CameraRenderer(town, CameraSettings(RIG, "train", motion=False), (5.0, 2.0))
    bevs, everyone = BEVRenderer(town, GEOMETRY), np.ones(1, np.bool_)
    state = WorldState.empty(1, signals=len(town.signals))
    result = []
    for k in range(count):
        route = book.route("episode", k % 5, town)
        state.set_route(0, route.points, route.length_m, sparse_plan(route))
        row = int((0.08 + 0.083 * k) * len(route.points))
        x, y, dx, dy = route.points[row]
        state.ego[0] = x, y, np.arctan2(dy, dx), 5.0
        state.progress[0, 0] = row * route.spacing_m
        state.episode_seed[0] = 100 + k
        bev = np.zeros((1, 6, 192, 192), np.uint8)
        bevs.render(state, everyone, bev)
        maps = np.zeros((1, 192, 192), np.uint8)
        render_route_maps(
            bev_window(GEOMETRY),
            everyone,
            state.ego,
            state.progress,
            state.plan_points,
            state.plan_size,
            state.episode_seed,
            state.steps,
            False,
            maps,
        )
        result.append((frame(cameras.render(state, 0), route_map=maps[0]), bev[0]))
    return result


def test_it_finds_the_road_nearby_in_rendered_images(source):
    overlaps = [
        iou(source(here)[0], truth[0], WITHIN_15_M)
        for name in ("Town01", "Town02")
        for here, truth in drives(name)
    ]
    assert np.mean(overlaps) > 0.9
    assert np.median(overlaps) > 0.92


def test_the_route_is_that_of_the_map_whatever_the_images_show(source):
    frames = drives("Town01") + drives("Town02")
    right, wrong = [], []
    for (here, truth), (elsewhere, other) in itertools.permutations(frames, 2):
        if iou(truth[1], other[1]) < 0.3:
            right.append(iou(source(here)[1], truth[1]))
            swapped = SensorFrame(
                here.images,
                here.intrinsics,
                here.extrinsics,
                elsewhere.route_map,
                here.measurements,
            )
            wrong.append(iou(source(swapped)[1], truth[1]))
        if len(wrong) >= 20:
            break
    assert len(wrong) >= 5
    assert np.mean(right) > 0.6
    assert np.mean(wrong) < 0.35


def test_the_same_frame_gives_the_same_bits_and_is_left_alone(source):
    here, _ = drives("Town01")[3]
    before = here.copy()
    first = source(here)
    assert first.shape == (3, 192, 192)
    assert first.dtype == np.uint8
    assert set(np.unique(first)) == {0, 255}
    source(drives("Town01")[4][0])
    np.testing.assert_array_equal(source(here), first)
    np.testing.assert_array_equal(IPM()(here), first)
    np.testing.assert_array_equal(here.images, before.images)
    np.testing.assert_array_equal(here.route_map, before.route_map)
