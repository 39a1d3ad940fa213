import math

import numpy as np
import pytest

from bev_driving_env.kernels.detect import (
    is_against_traffic,
    is_deviating,
    is_off_road,
    is_standing,
    raster_value,
)
from bev_driving_env.kernels.layout import NO_LANE, ROAD_BIT, SIDEWALK_BIT, RasterGrid

GRID = RasterGrid(-10.0, -10.0, 40.0)
LENGTH_M, WIDTH_M = 5.0, 2.0
ROW, COLUMN = np.mgrid[:800, :800]
WORLD_X, WORLD_Y = COLUMN / 40.0 - 10.0 + 0.0125, ROW / 40.0 - 10.0 + 0.0125


def off_road(classes, x, y, heading):
    ego = np.array([x, y, heading, 0.0])
    return is_off_road(classes, GRID, ego, LENGTH_M / 2.0, WIDTH_M / 2.0)


def upper_quartile_m(heading):
    """How far south of a car's centre the line lies that cuts a quarter off its footprint."""
    ahead, right = np.meshgrid(
        (np.arange(1000) + 0.5) / 1000 * LENGTH_M - LENGTH_M / 2.0,
        (np.arange(400) + 0.5) / 400 * WIDTH_M - WIDTH_M / 2.0,
    )
    return float(np.quantile(ahead * math.sin(heading) + right * math.cos(heading), 0.75))


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 90, 135, 180, 250, 270, 330])
def test_a_car_sliding_over_the_kerb_is_off_road_when_a_quarter_of_its_footprint_is(degrees):
    classes = np.where(WORLD_Y <= 3.0, ROAD_BIT, SIDEWALK_BIT).astype(np.uint8)
    heading = math.radians(degrees)
    expected = 3.0 - upper_quartile_m(heading)
    slide = np.arange(0.0, 3.0, 0.01)
    actual = next(y for y in slide if off_road(classes, 0.0, y, heading))
    assert actual == pytest.approx(expected, abs=0.12)


def test_a_car_beside_the_kerb_is_off_road_when_half_a_metre_hangs_over():
    classes = np.where(WORLD_Y <= 3.0, ROAD_BIT, 0).astype(np.uint8)
    assert not off_road(classes, 0.0, 2.40, 0.0)
    assert off_road(classes, 0.0, 2.60, 0.0)


def test_a_car_facing_the_kerb_is_off_road_when_a_quarter_of_its_length_hangs_over():
    classes = np.where(WORLD_Y <= 3.0, ROAD_BIT, 0).astype(np.uint8)
    assert not off_road(classes, 0.0, 3.0 - 1.35, math.pi / 2.0)
    assert off_road(classes, 0.0, 3.0 - 1.15, math.pi / 2.0)


def test_a_center_over_a_narrow_trench_is_off_road_though_the_footprint_is_not():
    classes = np.where(np.abs(WORLD_X - 1.0) < 0.1, 0, ROAD_BIT).astype(np.uint8)
    assert [off_road(classes, 1.0 + d, 0.0, 0.0) for d in (-0.15, -0.05, 0.05, 0.15)] == [
        False,
        True,
        True,
        False,
    ]


def test_outside_the_raster_is_off_road():
    everywhere = np.full((800, 800), ROAD_BIT, np.uint8)
    assert not off_road(everywhere, 0.0, 0.0, 0.3)
    for x, y in [(-11.0, 0.0), (11.0, 0.0), (0.0, -11.0), (0.0, 11.0), (1e6, -1e6)]:
        assert off_road(everywhere, x, y, 0.3)


def test_a_raster_pixel_covers_its_half_open_square():
    raster = np.arange(6, dtype=np.uint8).reshape(2, 3)
    grid = RasterGrid(100.0, -50.0, 2.0)
    assert raster_value(raster, grid, 100.0, -50.0) == 0
    assert raster_value(raster, grid, 100.49, -49.51) == 0
    assert raster_value(raster, grid, 100.5, -49.5) == 4
    assert raster_value(raster, grid, 101.49, -49.01) == 5
    assert raster_value(raster, grid, 101.5, -49.5) == 0  # right of the raster
    assert raster_value(raster, grid, 99.99, -49.5) == 0  # left of it, not the last column


@pytest.mark.parametrize("degrees", range(-360, 361, 24))
@pytest.mark.parametrize(
    ("turned", "against"), [(0, False), (118.5, False), (121.5, True), (180, True), (238.5, True)]
)
def test_against_traffic_means_more_than_120_degrees_from_the_lane(degrees, turned, against):
    # lane directions are stored in steps of 1.4 degrees
    code = 1 + round(degrees / 360.0 * 255) % 255
    directions = np.full((800, 800), code, np.uint8)
    for sign in (-1.0, 1.0):
        ego = np.array([0.0, 0.0, math.radians(degrees + sign * turned), 5.0])
        assert is_against_traffic(directions, GRID, ego) == against


@pytest.mark.parametrize("heading", np.linspace(-math.pi, math.pi, 9))
def test_where_no_lane_has_a_direction_nobody_drives_against_traffic(heading):
    ego = np.array([0.0, 0.0, heading, 5.0])
    assert not is_against_traffic(np.full((800, 800), NO_LANE, np.uint8), GRID, ego)
    ego[0] = 1000.0
    assert not is_against_traffic(np.full((800, 800), 1, np.uint8), GRID, ego)


def test_only_the_center_decides_which_lane_the_car_is_in():
    directions = np.where(WORLD_Y < 0.0, 1 + 128, 1).astype(np.uint8)  # north: west, south: east
    assert not is_against_traffic(directions, GRID, np.array([0.0, 0.02, 0.0, 5.0]))
    assert is_against_traffic(directions, GRID, np.array([0.0, -0.02, 0.0, 5.0]))


def test_deviation_and_standing_begin_beyond_their_thresholds():
    assert not is_deviating(3.49, 3.5)
    assert is_deviating(3.51, 3.5)
    assert is_standing(np.array([0.0, 0.0, 0.0, 0.09]), 0.1)
    assert not is_standing(np.array([0.0, 0.0, 0.0, 0.11]), 0.1)
