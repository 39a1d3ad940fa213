import math

import highway_env  # noqa: F401
import numpy as np
import pytest
from highway_env.road.road import RoadNetwork

from bev_driving_env.kernels.detect import raster_value
from bev_driving_env.kernels.layout import ROAD_BIT, SIDEWALK_BIT
from bev_driving_env.kernels.walks import (
    FREE_FROM_M,
    FREE_TO_M,
    WALK_COS,
    WALK_SIN,
    WALK_X,
    WALK_Y,
    nearest_on_walk,
    walk_point,
)
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.sidewalks import build_sidewalks, lane_loops
from bev_driving_env.towns.solids import index_solids


def value_at(town, x, y):
    classes = town.classes()
    return raster_value(classes.pixels, classes.grid, x, y)


def loops(walks):
    for first, end in zip(walks.first[:-1], walks.first[1:], strict=True):
        yield walks.samples[first:end]


def box_distances(points, boxes):
    """Distance (n,) from points (n, 2) to the nearest of the boxes, by their corners' frame."""
    best = np.full(len(points), np.inf)
    for x, y, heading, length, width in boxes:
        turn = np.array(
            [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
        )
        local = (points - (x, y)) @ turn
        half = np.array([length, width]) / 2.0
        nearest = np.clip(local, -half, half)
        best = np.minimum(best, np.hypot(*(local - nearest).T))
    return best


@pytest.fixture(scope="module")
def sidewalks(town):
    return build_sidewalks(town, town.solids())


def test_the_ladder_has_a_walk_around_each_block_and_one_around_it_all(ladder):
    walks = build_sidewalks(ladder).walks
    # 6.3 m from the axes; bends of 2.7 m inside and 15.3 m outside, 2 m at the junctions
    saved = 2.0 - math.pi / 2.0  # by a bend, per metre of its radius
    block = 2.0 * (50.0 + 40.0 - 4 * 6.3) - saved * (2 * 2.7 + 2 * 2.0)
    around = 2.0 * (100.0 + 40.0 + 4 * 6.3) - saved * 4 * 15.3
    assert sorted(walks.length) == pytest.approx([block, block, around], abs=0.1)


def test_every_road_lane_belongs_to_one_loop(town):
    inside = [k for loop in lane_loops(town) for k in loop if not town.lanes[k].in_junction]
    assert sorted(inside) == [k for k, lane in enumerate(town.lanes) if not lane.in_junction]


def test_every_road_lane_has_a_walk_on_its_right(town, sidewalks):
    points = sidewalks.walks.samples[:, [WALK_X, WALK_Y]]
    ways = sidewalks.walks.samples[:, [WALK_COS, WALK_SIN]]
    for lane in town.lanes:
        if lane.in_junction:
            continue
        x, y, heading = lane.pose_at(lane.length_m / 2.0)
        wanted = np.array([x - 4.3 * math.sin(heading), y + 4.3 * math.cos(heading)])
        distance = np.hypot(*(points - wanted).T)
        near = int(distance.argmin())
        assert distance[near] < 0.4
        assert ways[near] @ [math.cos(heading), math.sin(heading)] > 0.95


def test_walks_run_on_the_sidewalk_and_their_bands_too(town, sidewalks):
    walks = sidewalks.walks
    for table in loops(walks):
        for column in (None, FREE_FROM_M, FREE_TO_M):
            right = 0.0 if column is None else table[:, column] - walks.half_width_m
            x = table[:, WALK_X] - right * table[:, WALK_SIN]
            y = table[:, WALK_Y] + right * table[:, WALK_COS]
            values = np.array([value_at(town, *spot) for spot in zip(x, y, strict=True)])
            assert not (values & ROAD_BIT).any()
            assert (values & SIDEWALK_BIT).all()


def test_walks_are_closed_and_evenly_sampled(sidewalks):
    walks = sidewalks.walks
    for k, table in enumerate(loops(walks)):
        assert (table[0] == table[-1]).all()
        steps = np.hypot(*np.diff(table[:, :2], axis=0).T)
        assert walks.step_m[k] <= 0.5
        assert steps.max() <= walks.step_m[k] + 1e-9
        assert steps.min() >= 0.9 * walks.step_m[k]
        assert walks.step_m[k] * (len(table) - 1) == pytest.approx(walks.length[k])
        np.testing.assert_allclose(np.hypot(table[:, WALK_COS], table[:, WALK_SIN]), 1.0)


def test_a_walker_beside_the_middle_never_jumps(sidewalks):
    walks = sidewalks.walks
    for k in range(len(walks.length)):
        stations = np.arange(0.0, walks.length[k], 0.15)
        for kerb_m in (0.4, 3.6):
            points = np.array([walk_point(walks, k, s, kerb_m) for s in stations])
            assert np.hypot(*np.diff(points, axis=0).T).max() < 0.35


def test_bands_are_free_of_solids(town, sidewalks):
    walks, boxes = sidewalks.walks, town.solids().boxes
    low, high = walks.samples[:, FREE_FROM_M], walks.samples[:, FREE_TO_M]
    assert (low >= 0.4 - 1e-9).all()
    assert (high <= 3.6 + 1e-9).all()
    assert (high > low).all()
    assert np.mean(high - low > 1.0) > 0.9
    for table in loops(walks):
        for share in (0.0, 0.5, 1.0):
            kerb_m = table[:, FREE_FROM_M] * (1.0 - share) + table[:, FREE_TO_M] * share
            right = kerb_m - walks.half_width_m
            offset = right[:, None] * np.column_stack([-table[:, WALK_SIN], table[:, WALK_COS]])
            assert box_distances(table[:, :2] + offset, boxes).min() > 0.45 - 1e-6


def test_bands_of_neighbouring_samples_overlap(sidewalks):
    for table in loops(sidewalks.walks):
        low, high = table[:, FREE_FROM_M], table[:, FREE_TO_M]
        assert (low[1:] <= high[:-1]).all()
        assert (low[:-1] <= high[1:]).all()


def test_the_band_goes_around_a_tree_on_the_wider_side_and_narrows_ahead_of_it(ring):
    # the walk along the northern side's inner edge, heading east at y = 6.3; kerb at 4.3
    tree = [100.0, 7.3, 0.0, 0.4, 0.4]
    walks = build_sidewalks(ring, index_solids([tree])).walks
    samples = walks.samples
    near = (np.abs(samples[:, WALK_Y] - 6.3) < 0.01) & (np.abs(samples[:, WALK_X] - 100.0) < 60.0)
    x, low, high = samples[near][:, [WALK_X, FREE_FROM_M, FREE_TO_M]].T
    assert low == pytest.approx(0.4)
    # 3 m from the kerb, less half of it and 0.45 m
    assert high[np.abs(x - 100.0) < 1.0].max() <= 2.35 + 1e-9
    assert high[np.abs(x - 100.0) < 1.0].min() >= 2.25
    assert high[np.abs(x - 100.0) > 8.0].min() == pytest.approx(3.6)
    ahead = high[(x > 90.0) & (x < 99.0)]
    assert (np.diff(ahead) <= 1e-9).all()
    assert np.diff(ahead).min() > -0.3


@pytest.mark.parametrize("kerb_m", [0.4, 2.0, 3.5])
def test_the_nearest_place_on_a_walk_is_found_again(ladder, kerb_m):
    walks = build_sidewalks(ladder).walks
    for k in range(len(walks.length)):
        for station in np.linspace(0.0, walks.length[k] - 0.01, 97):
            x, y = walk_point(walks, k, station, kerb_m)
            found, aside = nearest_on_walk(walks, k, station + 1.0, x, y)
            assert np.hypot(*(np.array(walk_point(walks, k, found, aside)) - (x, y))) < 0.03


def test_a_plain_network_has_no_sidewalks():
    from highway_env.road.lane import CircularLane

    network = RoadNetwork()
    for k in range(4):
        arc = CircularLane([0.0, 0.0], 20.0, k * math.pi / 2.0, (k + 1) * math.pi / 2.0)
        network.add_lane(str(k), str((k + 1) % 4), arc)
    sidewalks = build_sidewalks(compile_network("plain", network))
    assert len(sidewalks.walks.length) == 0
    assert sidewalks.walks.first.tolist() == [0]
    assert sidewalks.crossings.ends.shape == (0, 4)
    assert sidewalks.crossings.walk.shape == (0, 2)
