import math

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, LineType, StraightLane

from bev_driving_env.kernels.bev import LANE, ROAD
from bev_driving_env.kernels.layout import LANE_BIT, ROAD_BIT, RasterGrid
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.network import CrossSection, TownNetwork

SLACK_M = 0.15
LINES = [LineType.STRIPED, LineType.CONTINUOUS]


def raster_of(network, px_per_m=10.0):
    raster = compile_network("toy", network, allow_dead_ends=True).classes(px_per_m)
    return raster.pixels, raster.grid


@pytest.fixture(scope="module")
def straight_road():
    """Two lanes of 4 m along y = 0 from x = -100 to 100, with shoulders of 0.3 m."""
    network = TownNetwork(CrossSection(shoulder_m=0.3, sidewalk_m=2.0))
    east = StraightLane([-100.0, 2.0], [100.0, 2.0], width=4.0, line_types=LINES)
    west = StraightLane([100.0, -2.0], [-100.0, -2.0], width=4.0, line_types=LINES)
    network.add_lane("a", "b", east)
    network.add_lane("b", "a", west)
    return network


@pytest.fixture(scope="module")
def roundabout():
    """One lane of 5 m around (20, -10) with radius 15, in four quarters."""
    network = TownNetwork()
    for k in range(4):
        phases = k * math.pi / 2.0, (k + 1) * math.pi / 2.0
        lane = CircularLane([20.0, -10.0], 15.0, *phases, width=5.0, line_types=LINES)
        network.add_lane(f"n{k}", f"n{(k + 1) % 4}", lane)
    return network


def assert_shape(plane, depth_m):
    """Pixels are set where depth is positive, but for those near the shape's border."""
    clear = np.abs(depth_m) > SLACK_M
    np.testing.assert_array_equal(plane[clear] == 255, (depth_m > 0.0)[clear])


def poses(count, x_range, y_range, seed=0):
    rng = np.random.default_rng(seed)
    low, high = zip(x_range, y_range, (-math.pi, math.pi), strict=True)
    return [tuple(pose) for pose in rng.uniform(low, high, (count, 3))]


@pytest.mark.parametrize("pose", poses(8, (-40.0, 40.0), (-9.0, 9.0)))
def test_a_straight_road_is_8_6_m_wide_from_any_pose(draw, straight_road, pose):
    picture = draw(pose, raster=raster_of(straight_road))
    assert_shape(picture.bev[ROAD], 4.3 - np.abs(picture.y))


@pytest.mark.parametrize("pose", poses(8, (-40.0, 40.0), (-9.0, 9.0), seed=1))
def test_lane_boundaries_are_the_center_line_and_both_edges(draw, straight_road, pose):
    picture = draw(pose, raster=raster_of(straight_road))
    off_line = np.abs(np.abs(np.abs(picture.y) - 2.0) - 2.0)  # distance to y = -4, 0 or 4
    near = np.abs(off_line - 0.2) < 0.1
    np.testing.assert_array_equal((picture.bev[LANE] == 255)[~near], (off_line < 0.2)[~near])


@pytest.mark.parametrize("degrees", [0, 30, 45, 80, 200])
def test_lane_boundaries_are_2_px_wide_and_unbroken(draw, straight_road, degrees):
    heading = math.radians(degrees)
    picture = draw((0.0, 2.0, heading), raster=raster_of(straight_road))
    line = (picture.bev[LANE] == 255) & (np.abs(picture.y) < 1.0)
    along = picture.x[np.abs(picture.y) < 0.1]
    length_px = 5.0 * (along.max() - along.min())
    assert line.sum() / length_px == pytest.approx(2.0, abs=0.15)
    middle = np.abs(picture.y) <= 0.1
    assert line[middle].all()


@pytest.mark.parametrize("pose", poses(6, (0.0, 40.0), (-30.0, 10.0), seed=2))
def test_a_curved_road_and_its_boundaries_follow_their_circle(draw, roundabout, pose):
    picture = draw(pose, raster=raster_of(roundabout))
    off_center = np.abs(np.hypot(picture.x - 20.0, picture.y + 10.0) - 15.0)
    assert_shape(picture.bev[ROAD], 2.5 - off_center)
    off_line = np.abs(off_center - 2.5)
    near = np.abs(off_line - 0.2) < 0.1
    np.testing.assert_array_equal((picture.bev[LANE] == 255)[~near], (off_line < 0.2)[~near])


@pytest.mark.parametrize(
    "geometry",
    [
        {"size": 64, "px_per_m": 2.0, "ego_row": 40},
        {"size": 400, "px_per_m": 10.0, "ego_row": 0},
        {"size": 96, "px_per_m": 4.0, "ego_row": 95},
        {"size": 50, "px_per_m": 0.5, "ego_row": 25},
    ],
)
def test_other_windows_show_the_same_road(draw, straight_road, geometry):
    picture = draw((-7.3, 1.1, 0.6), raster=raster_of(straight_road, 20.0), **geometry)
    on_road = np.minimum(4.3 - np.abs(picture.y), 100.0 - np.abs(picture.x))
    assert_shape(picture.bev[ROAD], on_road)


GRID = RasterGrid(-20.0, -30.0, 10.0)
PAVED = np.full((500, 400), ROAD_BIT | LANE_BIT, np.uint8)  # covers x -20..20, y -30..20


@pytest.mark.parametrize("pose", [(-19.0, 0.0, 2.0), (18.0, 19.0, 0.4), (0.0, -29.9, -1.5)])
def test_beyond_the_raster_there_is_nothing(draw, pose):
    picture = draw(pose, raster=(PAVED, GRID))
    depth = np.minimum(20.0 - np.abs(picture.x), 25.0 - np.abs(picture.y + 5.0))
    clear = np.abs(depth) > 0.01
    for channel in (ROAD, LANE):
        plane = picture.bev[channel] == 255
        np.testing.assert_array_equal(plane[clear], (depth > 0.0)[clear])
        assert plane.any()
        assert not plane.all()


@pytest.mark.parametrize("pose", [(500.0, 0.0, 0.3), (-1e5, 1e5, 0.0), (0.0, -400.0, 3.0)])
def test_far_from_the_raster_everything_is_black(draw, pose):
    assert not draw(pose, raster=(PAVED, GRID)).bev.any()


def test_road_and_lane_come_from_their_own_bits(draw):
    pixels = np.zeros((500, 400), np.uint8)
    pixels[:, 200:] = ROAD_BIT | 128  # other bits mean nothing here
    pixels[250:] |= LANE_BIT
    picture = draw((0.3, -5.2, 0.0), raster=(pixels, GRID), size=64, px_per_m=5.0, ego_row=32)
    np.testing.assert_array_equal(picture.bev[ROAD] == 255, picture.x >= 0.0)
    np.testing.assert_array_equal(picture.bev[LANE] == 255, picture.y >= -5.0)
