import math

import highway_env  # noqa: F401
import numpy as np
import pytest

from bev_driving_env.kernels.detect import raster_value
from bev_driving_env.kernels.layout import ROAD_BIT, SIDEWALK_BIT
from bev_driving_env.kernels.walks import walk_pose
from bev_driving_env.towns.sidewalks import build_sidewalks
from bev_driving_env.towns.solids import index_solids


def value_at(town, x, y):
    classes = town.classes()
    return raster_value(classes.pixels, classes.grid, x, y)


@pytest.fixture(scope="module")
def sidewalks(town):
    return build_sidewalks(town, town.solids())


def test_crossings_go_square_from_kerb_to_kerb(town, sidewalks):
    crossings = sidewalks.crossings
    for (ax, ay, bx, by), length in zip(crossings.ends, crossings.length, strict=True):
        way = np.array([bx - ax, by - ay]) / length
        assert length == pytest.approx(8.6, abs=0.3)
        assert np.abs(way).max() > math.cos(math.radians(0.5))  # the towns' roads follow the axes
        inside = np.linspace(0.1, length - 0.1, 40)
        for where in inside:
            assert value_at(town, ax + where * way[0], ay + where * way[1]) & ROAD_BIT
        for where in (-0.15, length + 0.15):
            beyond = value_at(town, ax + where * way[0], ay + where * way[1])
            assert beyond & (SIDEWALK_BIT | ROAD_BIT) == SIDEWALK_BIT


def test_every_approach_has_a_crossing_just_beyond_its_stop_line(town, sidewalks):
    crossings = sidewalks.crossings
    assert np.count_nonzero(crossings.mouth) == len(town.signals)
    for k, signal in enumerate(town.signals):
        (c,) = np.flatnonzero(crossings.signal == k)
        assert crossings.mouth[c]
        lane = next(lane for lane in town.lanes if lane.index == signal.lane)
        x, y, heading = lane.pose_at(lane.length_m)
        cos, sin = math.cos(heading), math.sin(heading)
        for end, right in ((0, 2.3), (2, -6.3)):
            dx, dy = crossings.ends[c, end] - x, crossings.ends[c, end + 1] - y
            assert dx * cos + dy * sin == pytest.approx(1.3)
            assert dy * cos - dx * sin == pytest.approx(right, abs=0.3)


def test_crossings_between_junctions_are_on_long_roads_only(town, sidewalks):
    crossings = sidewalks.crossings
    between = np.flatnonzero(~crossings.mouth)
    assert len(between) > 5
    assert (crossings.signal[between] == -1).all()
    for c in between:
        middle = (crossings.ends[c, :2] + crossings.ends[c, 2:]) / 2.0
        found = [lane for lane in town.lanes if not lane.in_junction and lane.length_m > 45.0]
        beside = [lane.nearest(*middle) for lane in found]
        best = min(range(len(found)), key=lambda k: beside[k][1])
        station, distance = beside[best]
        assert distance == pytest.approx(2.0, abs=0.2)
        assert 14.9 < station < found[best].length_m - 14.9


def test_both_ends_of_a_crossing_know_their_place_on_a_walk(sidewalks):
    walks, crossings = sidewalks.walks, sidewalks.crossings
    for c in range(len(crossings.length)):
        assert crossings.walk[c, 0] != crossings.walk[c, 1]
        for end in (0, 1):
            x, y, _ = walk_pose(walks, crossings.walk[c, end], crossings.station[c, end])
            kerb = crossings.ends[c, 2 * end : 2 * end + 2]
            assert 1.9 < np.hypot(*(kerb - (x, y))) < 3.0
    listed = crossings.stop_at[crossings.stop_at >= 0]
    assert sorted(listed) == list(range(2 * len(crossings.length)))


def test_a_midblock_crossing_gives_way_to_what_stands_on_the_sidewalk(ring):
    lines = build_sidewalks(ring).crossings.ends
    x, y = lines[0, :2]
    blocked = [x, y + 1.0, 0.0, 2.0, 2.0]
    moved = build_sidewalks(ring, index_solids([blocked])).crossings.ends
    assert len(moved) == len(lines)
    shift = np.hypot(*(moved[0, :2] - lines[0, :2]))
    assert 1.0 < shift <= 5.0
    np.testing.assert_array_equal(moved[1:], lines[1:])
