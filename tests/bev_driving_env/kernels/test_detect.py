import itertools
import math

import numpy as np
import pytest

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.detect import (
    NONE,
    actor_hit,
    is_against_traffic,
    is_deviating,
    is_off_road,
    is_standing,
    raster_value,
    red_line_crossed,
)
from bev_driving_env.kernels.layout import (
    NO_LANE,
    ROAD_BIT,
    SIDEWALK_BIT,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    RasterGrid,
)

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


def clearance(one, other):
    """Widest gap between two convex polygons (4, 2) on any side's axis; negative: they overlap."""
    widest = -math.inf
    for corners in (one, other):
        for x, y in np.roll(corners, -1, axis=0) - corners:
            axis = np.array([-y, x]) / math.hypot(x, y)
            a, b = one @ axis, other @ axis
            widest = max(widest, a.min() - b.max(), b.min() - a.max())
    return widest


def random_actors(rng, count):
    """Rows (count, 6) around the origin, of any size, heading and speed."""
    rows = np.empty((count, 6))
    rows[:, :2] = rng.uniform(-6.0, 6.0, (count, 2))
    rows[:, 2], rows[:, 3] = rng.uniform(-7.0, 7.0, count), rng.uniform(0.0, 9.0, count)
    rows[:, 4:] = rng.uniform(0.3, 7.0, (count, 2))
    return rows


def hit(ego, actors):
    return actor_hit(np.array([*ego, 3.0]), LENGTH_M / 2.0, WIDTH_M / 2.0, actors)


def test_actors_are_hit_where_no_axis_separates_their_footprint_from_the_egos():
    rng = np.random.default_rng(0)
    seen = []
    for row in random_actors(rng, 3000):
        ego = *rng.uniform(-3.0, 3.0, 2), rng.uniform(-7.0, 7.0)
        gap = clearance(footprint(ego, LENGTH_M, WIDTH_M), footprint(row[:3], row[4], row[5]))
        if abs(gap) > 1e-9:
            assert hit(ego, row[None]) == (0 if gap < 0.0 else NONE)
            seen.append(gap < 0.0)
    assert 0.2 < np.mean(seen) < 0.8


def test_the_first_actor_that_is_hit_is_named_and_empty_slots_are_skipped():
    rng = np.random.default_rng(1)
    numbers = []
    for _ in range(400):
        actors = random_actors(rng, 6) * [3.0, 3.0, 1.0, 1.0, 1.0, 1.0]
        actors[rng.random(6) < 0.3, 4] = 0.0
        car = footprint((0.0, 0.0, 0.4), LENGTH_M, WIDTH_M)
        touched = [
            k
            for k, row in enumerate(actors)
            if row[4] > 0.0 and clearance(car, footprint(row[:3], row[4], row[5])) < 0.0
        ]
        assert hit((0.0, 0.0, 0.4), actors) == (touched[0] if touched else NONE)
        numbers.append(touched[0] if touched else NONE)
    assert set(numbers) == set(range(-1, 6))


def test_nobody_is_hit_where_nobody_is():
    assert hit((0.0, 0.0, 0.0), np.zeros((0, 6))) == NONE
    assert hit((0.0, 0.0, 0.0), np.zeros((4, 6))) == NONE


def test_the_gap_between_bumpers_decides():
    # a car of 4 m ahead: bumpers touch at 2.5 + 2 m between the centres
    for gap, number in [(0.01, NONE), (-0.01, 0)]:
        ahead = np.array([[4.5 + gap, 0.0, math.pi, 0.0, 4.0, 1.8]])
        beside = np.array([[0.0, 1.9 + gap, 0.0, 0.0, 4.0, 1.8]])
        assert hit((0.0, 0.0, 0.0), ahead) == number
        assert hit((0.0, 0.0, 0.0), beside) == number


def segments_cross(a, b, c, d):
    """Whether the segments a-b and c-d cross, and how near their ends that was decided."""

    def side(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    sides = side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b)
    crosses = sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0
    return crosses, min(abs(value) for value in sides)


def test_a_red_line_is_crossed_where_the_way_of_the_bumper_cuts_it_in_driving_direction():
    rng = np.random.default_rng(2)
    seen = []
    for _ in range(3000):
        middle, heading = rng.uniform(-2.0, 2.0, 2), rng.uniform(-math.pi, math.pi)
        right = np.array([-math.sin(heading), math.cos(heading)])
        half = 1.6 * right
        line = np.concatenate([middle - half, middle + half])[None]
        before, after = rng.uniform(-3.0, 3.0, (2, 2))
        # all of the lane counts, which is a quarter wider than its line
        crosses, margin = segments_cross(before, after, middle - 1.25 * half, middle + 1.25 * half)
        if margin < 1e-9:
            continue
        forwards = (after - before) @ [math.cos(heading), math.sin(heading)] > 0.0
        signals = np.array([SIGNAL_RED], np.uint8)
        found = red_line_crossed(line, signals, *before, *after)
        assert found == (0 if crosses and forwards else NONE)
        seen.append((bool(crosses), bool(forwards)))
    assert set(seen) == {(a, b) for a in (True, False) for b in (True, False)}


LINE = np.array([[10.0, 0.4, 10.0, 3.6]])
"""The stop line of a lane of 4 m that leads east along y = 2."""


@pytest.mark.parametrize("light", [SIGNAL_OFF, SIGNAL_GREEN, SIGNAL_YELLOW])
def test_only_red_forbids_to_cross_a_line(light):
    assert red_line_crossed(LINE, np.array([SIGNAL_RED], np.uint8), 9.9, 2.0, 10.2, 2.0) == 0
    assert red_line_crossed(LINE, np.array([light], np.uint8), 9.9, 2.0, 10.2, 2.0) == NONE


@pytest.mark.parametrize(("y", "number"), [(-0.05, NONE), (0.05, 0), (3.95, 0), (4.05, NONE)])
def test_all_of_the_lane_is_behind_its_line_and_nothing_of_the_next_lane(y, number):
    red = np.array([SIGNAL_RED], np.uint8)
    assert red_line_crossed(LINE, red, 9.9, y, 10.2, y) == number


@pytest.mark.parametrize("step_m", [0.05, 0.25, 0.3, 2.0])
def test_a_drive_crosses_a_line_once_however_its_steps_fall(step_m):
    red = np.array([SIGNAL_RED], np.uint8)
    # 10 is a multiple of some of the steps: a bumper right on the line has crossed it
    xs = np.arange(0.0, 20.0, step_m)
    found = [red_line_crossed(LINE, red, a, 2.0, b, 2.0) for a, b in itertools.pairwise(xs)]
    assert found.count(0) == 1
    assert abs(xs[found.index(0) + 1] - 10.0) <= step_m


def test_standing_before_or_on_a_red_line_does_not_cross_it():
    red = np.array([SIGNAL_RED], np.uint8)
    for x in (9.99, 10.0, 10.01):
        assert red_line_crossed(LINE, red, x, 2.0, x, 2.0) == NONE


def test_of_several_lines_the_red_one_that_is_crossed_is_named():
    lines = np.array([[10.0, 3.6, 10.0, 0.4], [30.0, 0.4, 30.0, 3.6], [10.0, 0.4, 10.0, 3.6]])
    signals = np.array([SIGNAL_RED] * 3, np.uint8)
    assert red_line_crossed(lines, signals, 9.9, 2.0, 10.2, 2.0) == 2
    assert red_line_crossed(lines, signals, 10.2, 2.0, 9.9, 2.0) == 0
    assert red_line_crossed(lines, signals, 29.9, 2.0, 30.2, 2.0) == 1
    assert red_line_crossed(lines[:0], signals[:0], 29.9, 2.0, 30.2, 2.0) == NONE
