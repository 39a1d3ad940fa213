import itertools
import math

import gymnasium as gym
import highway_env  # noqa: F401  registers the plain environments
import numpy as np
import pytest
from highway_env.road.lane import CircularLane, SineLane, StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env.kernels.rails import (
    CROSSING,
    CROSSING_M,
    CROSSING_SIDE,
    RAIL_HEADING,
    RAIL_TOP_MPS,
    RAIL_X,
    RAIL_Y,
    rail_pose,
)
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.rails import build_rails, chain_lanes, route_rails
from bev_driving_env.towns.route import Route, random_route

PLAIN = ["intersection-v2", "roundabout-v1", "merge-v1", "highway-v0", "racetrack-v1"]


@pytest.fixture(scope="session")
def network(town):
    return build_rails(town)


def plain_town(name):
    env = gym.make(name).unwrapped
    env.reset(seed=0)
    return compile_network(name, env.road.network, allow_dead_ends=True)


def town_of(*pieces, allow_dead_ends=True):
    """A town of lanes given as (from node, to node, lane)."""
    network = RoadNetwork()
    for start, end, lane in pieces:
        network.add_lane(start, end, lane)
    return compile_network("toy", network, allow_dead_ends=allow_dead_ends)


def straight(start, end, limit=11.0):
    return StraightLane(np.array(start, float), np.array(end, float), speed_limit=limit)


def samples(tables, rail):
    return tables.samples[tables.first[rail] : tables.first[rail + 1]]


def crossings(tables, rail):
    return tables.crossings[tables.crossing_first[rail] : tables.crossing_first[rail + 1]]


def onward(tables, rail):
    return [k for k in tables.following[rail].tolist() if k >= 0]


def test_a_ring_without_a_junction_is_one_rail_in_each_direction_that_leads_on_to_itself(ring):
    network = build_rails(ring)
    assert len(network.lanes) == 2
    # corners of the axis have 10 m, so the two directions drive arcs of 8 and of 12 m
    straights = 2.0 * (180.0 + 40.0)
    expected = [straights + 2.0 * math.pi * radius for radius in (8.0, 12.0)]
    np.testing.assert_allclose(sorted(network.tables.length), expected, atol=1e-6)
    for rail in range(2):
        assert onward(network.tables, rail) == [rail]
    assert network.junctions == ()
    assert network.junction.tolist() == [-1, -1]


def test_a_rail_ends_where_a_way_is_chosen(ladder):
    network = build_rails(ladder)
    # three two-way roads between the junctions, two of them over two corners; 2 x 6 movements
    assert sorted(network.tables.movement.tolist()) == [False] * 6 + [True] * 12
    for rail in range(18):
        assert len(onward(network.tables, rail)) == (1 if network.tables.movement[rail] else 2)
    lanes = sorted(
        len(chain)
        for chain, inside in zip(network.lanes, network.tables.movement, strict=True)
        if not inside
    )
    assert lanes == [1, 1, 5, 5, 5, 5]
    assert max(len(chain) for chain in network.lanes if ladder.lanes[chain[0]].in_junction) == 3


def test_no_chain_of_lanes_could_be_longer(town):
    chains = chain_lanes(town)
    assert sorted(number for chain in chains for number in chain) == list(range(len(town.lanes)))
    firsts = {chain[0]: chain for chain in chains}
    ways_in = [sum(k in onward for onward in town.successors) for k in range(len(town.lanes))]
    for chain in chains:
        inside = {town.lanes[number].in_junction for number in chain}
        assert len(inside) == 1
        for number, following in itertools.pairwise(chain):
            assert town.successors[number] == (following,)
            assert ways_in[following] == 1
        for following in town.successors[chain[-1]]:
            assert following in firsts
            if len(town.successors[chain[-1]]) == 1 and ways_in[following] == 1:
                assert town.lanes[following].in_junction not in inside


def test_a_closed_chain_starts_with_its_lowest_lane():
    corners = [(0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (0.0, 30.0)]
    sides = zip("cabd", "abdc", corners, corners[1:] + corners[:1], strict=True)
    town = town_of(*((a, b, straight(start, end)) for a, b, start, end in sides))
    assert chain_lanes(town) == ((0, 1, 2, 3),)
    town = town_of(("a", "a", CircularLane([0.0, 0.0], 20.0, 0.0, 2.0 * math.pi)))
    assert chain_lanes(town) == ((0,),)
    assert build_rails(town).tables.following.tolist() == [[0]]


def test_every_lane_lies_on_its_rail_where_the_lookup_says(town, network):
    for number, lane in enumerate(town.lanes):
        rail, offset = int(network.lane_rail[number]), network.lane_offset[number]
        assert number in network.lanes[rail]
        for part in (0.0, 0.3, 0.71, 1.0):
            station = part * lane.length_m
            x, y, heading = rail_pose(network.tables, rail, offset + station)
            expected = lane.pose_at(station)
            # chords of 0.5 m cut the tightest arcs by up to 1 cm
            assert math.hypot(x - expected[0], y - expected[1]) < 0.02
            assert abs(math.remainder(heading - expected[2], 2.0 * math.pi)) < 0.08


def test_samples_are_even_close_and_turn_without_jumps(town, network):
    tables = network.tables
    assert tables.first[0] == 0
    assert tables.first[-1] == len(tables.samples)
    assert tables.step_m.max() <= 0.5
    for rail in range(len(network.lanes)):
        rows = samples(tables, rail)
        assert len(rows) >= 2
        assert tables.step_m[rail] * (len(rows) - 1) == pytest.approx(tables.length[rail])
        steps = np.hypot(*np.diff(rows[:, :2], axis=0).T)
        # a chord is shorter than its arc, by 1 % where one cuts the corner between two lanes
        assert steps.max() <= tables.step_m[rail] + 1e-9
        assert steps.min() >= 0.99 * tables.step_m[rail]
        assert np.abs(np.diff(rows[:, RAIL_HEADING])).max() < 0.2


def test_a_rail_knows_all_its_turns():
    town = town_of(("a", "b", CircularLane([0.0, 0.0], 10.0, 0.0, 3.5 * math.pi)))
    rows = samples(build_rails(town).tables, 0)
    assert rows[-1, RAIL_HEADING] - rows[0, RAIL_HEADING] == pytest.approx(3.5 * math.pi)


def test_rails_lead_on_where_their_last_lanes_do(town, network):
    for rail, chain in enumerate(network.lanes):
        expected = [network.lane_rail[number] for number in town.successors[chain[-1]]]
        assert onward(network.tables, rail) == expected
        for following in expected:
            end = samples(network.tables, rail)[-1, :2]
            np.testing.assert_allclose(samples(network.tables, following)[0, :2], end, atol=1e-6)


def test_every_signal_stands_at_the_end_of_the_road_it_governs(town, network):
    tables = network.tables
    assert sorted(tables.signal[tables.signal >= 0]) == list(range(len(town.signals)))
    assert (tables.signal[tables.movement] == -1).all()
    for rail in np.flatnonzero(tables.signal >= 0):
        number = tables.signal[rail]
        middle = town.stop_lines[number].reshape(2, 2).mean(axis=0)
        np.testing.assert_allclose(samples(tables, rail)[-1, :2], middle, atol=1e-6)
        assert network.junctions[network.junction[rail]] == town.signals[number].junction


def test_every_movement_knows_its_approach_and_its_junction(town, network):
    tables = network.tables
    assert list(network.junctions) == list(dict.fromkeys(s.junction for s in town.signals))
    for rail in np.flatnonzero(tables.movement):
        approach = tables.approach[rail]
        assert rail in onward(tables, approach)
        assert not tables.movement[approach]
        name = town.lanes[network.lanes[rail][0]].junction
        assert network.junctions[network.junction[rail]] == name
    assert (tables.approach[~tables.movement] == -1).all()
    assert np.bincount(network.junction[tables.movement]).tolist() == [6] * len(network.junctions)


def test_of_several_approaches_a_movement_takes_the_first_that_is_a_road():
    # two roads meet where two short lanes part: those two are the junction
    town = town_of(
        ("m", "c", straight((60.0, 30.0), (80.0, 30.0))),
        ("m", "d", straight((60.0, 30.0), (80.0, 40.0))),
        ("a", "m", straight((0.0, 30.0), (60.0, 30.0))),
        ("b", "m", straight((0.0, 0.0), (60.0, 30.0))),
        ("c", "e", straight((80.0, 30.0), (180.0, 30.0))),
    )
    network = build_rails(town)
    assert network.lanes == ((0,), (1,), (2,), (3,), (4,))
    assert network.tables.movement.tolist() == [True, True, False, False, False]
    assert network.tables.approach.tolist() == [2, 2, -1, -1, -1]
    assert network.junctions == ("m",)
    assert network.junction.tolist() == [0, 0, 0, 0, -1]


def test_an_approach_is_a_road_rather_than_a_movement_before_it():
    # from k a short lane leads to m, where a road arrives too and two short lanes part
    town = town_of(
        ("k", "m", straight((60.0, 0.0), (60.0, 30.0))),
        ("k", "z", straight((60.0, 0.0), (80.0, 0.0))),
        ("m", "c", straight((60.0, 30.0), (80.0, 30.0))),
        ("m", "d", straight((60.0, 30.0), (80.0, 40.0))),
        ("j", "k", straight((60.0, -90.0), (60.0, 0.0))),
        ("a", "m", straight((0.0, 30.0), (60.0, 30.0))),
    )
    tables = build_rails(town).tables
    assert tables.movement.tolist() == [True] * 4 + [False] * 2
    assert tables.approach.tolist() == [4, 4, 5, 5, -1, -1]


def test_a_movement_after_a_movement_is_approached_from_there():
    town = town_of(
        ("j", "k", straight((0.0, 0.0), (90.0, 0.0))),
        ("k", "m", straight((90.0, 0.0), (110.0, 0.0))),
        ("k", "z", straight((90.0, 0.0), (110.0, 20.0))),
        ("m", "c", straight((110.0, 0.0), (130.0, 0.0))),
        ("m", "d", straight((110.0, 0.0), (130.0, -20.0))),
    )
    assert build_rails(town).tables.approach.tolist() == [-1, 0, 0, 1, 1]


def test_a_rail_ends_where_another_joins_it():
    town = town_of(
        ("a", "m", straight((0.0, 0.0), (60.0, 0.0))),
        ("m", "c", straight((60.0, 0.0), (160.0, 0.0))),
        ("b", "m", straight((0.0, 30.0), (60.0, 0.0))),
    )
    network = build_rails(town)
    assert network.lanes == ((0,), (1,), (2,))
    assert network.tables.following.tolist() == [[1], [-1], [1]]


def test_a_straight_may_be_driven_at_its_limit_and_an_arc_as_fast_as_grip_allows(ring):
    network = build_rails(ring)
    limit = ring.lanes[0].speed_limit_mps
    for rail in range(2):
        top = samples(network.tables, rail)[:, RAIL_TOP_MPS]
        radius = (network.tables.length[rail] - 440.0) / (2.0 * math.pi)
        assert top.max() == limit
        assert top.min() == pytest.approx(math.sqrt(2.0 * radius), rel=0.02)


def test_traffic_can_slow_down_in_time_with_two_metres_per_second_squared(town, network):
    for rail in range(len(network.lanes)):
        rows = samples(network.tables, rail)
        step = network.tables.step_m[rail]
        top = rows[:, RAIL_TOP_MPS]
        limit = 11.18
        bend = np.abs(np.gradient(rows[:, RAIL_HEADING], step))
        allowed = [min(limit, math.sqrt(2.0 / b) if b > 0.0 else limit) for b in bend]
        # from the last sample backwards, one step at a time
        speed = allowed[-1]
        for i in reversed(range(len(top))):
            speed = min(allowed[i], math.sqrt(speed**2 + 2.0 * 2.0 * step * (i < len(top) - 1)))
            assert top[i] == pytest.approx(speed, abs=1e-6)


def test_a_lower_limit_ahead_is_braked_for():
    town = town_of(
        ("a", "b", straight((0.0, 0.0), (50.0, 0.0), limit=12.0)),
        ("b", "c", straight((50.0, 0.0), (90.0, 0.0), limit=8.0)),
    )
    top = samples(build_rails(town).tables, 0)[:, RAIL_TOP_MPS]
    assert top[0] == 12.0
    assert (top[100:] == 8.0).all()
    assert top[80] == pytest.approx(math.sqrt(64.0 + 40.0))  # 10 m before


def test_a_small_gap_between_lanes_counts_as_length():
    town = town_of(
        ("a", "b", straight((0.0, 0.0), (40.0, 0.0))),
        ("b", "c", straight((41.0, 0.0), (60.0, 0.0))),
    )
    network = build_rails(town)
    assert network.lanes == ((0, 1),)
    assert network.tables.length.tolist() == [60.0]
    assert network.lane_offset.tolist() == [0.0, 41.0]
    np.testing.assert_allclose(rail_pose(network.tables, 0, 40.7), [40.7, 0.0, 0.0], atol=1e-9)


def test_a_dead_end_leads_nowhere():
    town = town_of(("a", "b", straight((0.0, 0.0), (40.0, 0.0))))
    assert build_rails(town).tables.following.tolist() == [[-1]]


def test_lanes_side_by_side_are_rails_of_their_own():
    pieces = []
    for y in (0.0, 4.0, 8.0):
        pieces.append(("a", "b", straight((0.0, y), (100.0, y))))
        pieces.append(("b", "c", straight((100.0, y), (200.0, y))))
    network = build_rails(town_of(*pieces))
    assert [len(chain) for chain in network.lanes] == [2, 2, 2]
    assert network.tables.length.tolist() == [200.0] * 3
    assert not network.tables.movement.any()


@pytest.mark.parametrize("name", PLAIN)
def test_plain_networks_have_rails_too(name):
    town = plain_town(name)
    network = build_rails(town)
    tables = network.tables
    assert sorted(k for chain in network.lanes for k in chain) == list(range(len(town.lanes)))
    assert np.isfinite(tables.samples).all()
    assert (tables.step_m > 0.0).all()
    assert tables.step_m.max() <= 0.5
    assert (samples(tables, 0)[:, RAIL_TOP_MPS] > 0.0).all()
    for rail, chain in enumerate(network.lanes):
        assert len(onward(tables, rail)) == len(town.successors[chain[-1]])
    assert (network.junction[tables.movement] >= 0).all()


def test_a_curve_measured_along_its_chord_has_its_true_length():
    lane = SineLane([0.0, 0.0], [60.0, 0.0], 4.0, 2.0 * math.pi / 30.0, 0.0)
    tables = build_rails(town_of(("a", "b", lane))).tables
    x = np.linspace(0.0, 60.0, 100_001)
    y = 4.0 * np.sin(2.0 * math.pi / 30.0 * x)
    assert tables.length[0] == pytest.approx(np.hypot(np.diff(x), np.diff(y)).sum(), rel=1e-3)


def test_crossings_lie_where_a_rail_crosses_their_lines(ladder):
    # the upper road runs along y = 0 with its lanes at -2 (west) and 2 (east), the lower along 40
    lines = [
        [20.0, -4.3, 20.0, 4.3],
        [30.0, 4.3, 30.0, -4.3],
        [25.0, 35.7, 25.0, 44.3],
        [25.0, 60.0, 25.0, 70.0],
    ]
    network = build_rails(ladder, lines)
    tables = network.tables
    found = {}
    for rail in range(len(network.lanes)):
        rows = crossings(tables, rail)
        assert (np.diff(rows[:, CROSSING_M]) > 0.0).all()
        for number, station, side in rows:
            x, y, heading = rail_pose(tables, rail, station)
            found[int(number), round(math.cos(heading))] = x, y, side
    assert len(tables.crossings) == len(found) == 6
    expected = {
        (0, 1): (20.0, 2.0, 1.0),
        (0, -1): (20.0, -2.0, 0.0),
        (1, 1): (30.0, 2.0, 0.0),
        (1, -1): (30.0, -2.0, 1.0),
        (2, 1): (25.0, 42.0, 1.0),
        (2, -1): (25.0, 38.0, 0.0),
    }
    assert set(found) == set(expected)
    for key, place in expected.items():
        np.testing.assert_allclose(found[key], place, atol=1e-9)


def test_crossings_are_in_driving_order_whatever_their_numbers():
    town = town_of(("a", "b", straight((0.0, 0.0), (40.0, 0.0))))
    lines = [[x, -4.0, x, 6.0] for x in (31.0, 7.25, 19.0)]
    rows = build_rails(town, lines).tables.crossings
    assert rows[:, CROSSING].tolist() == [1.0, 2.0, 0.0]
    np.testing.assert_allclose(rows[:, CROSSING_M], [7.25, 19.0, 31.0])
    assert rows[:, CROSSING_SIDE].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("x", [0.0, 40.0, 12.5, 12.75])
def test_a_crossing_at_a_sample_or_an_end_is_found_once(x):
    town = town_of(("a", "b", straight((0.0, 0.0), (40.0, 0.0))))
    rows = build_rails(town, [[x, -4.0, x, 4.0]]).tables.crossings
    np.testing.assert_allclose(rows, [[0.0, x, 1.0]])


def test_between_two_rails_there_is_nothing_to_cross():
    town = town_of(
        ("a", "b", straight((0.0, 0.0), (40.0, 0.0))),
        ("c", "d", straight((0.0, 50.0), (40.0, 50.0))),
    )
    # across the way from the end of the one to the start of the other
    assert len(build_rails(town, [[20.0, 10.0, 20.0, 40.0]]).tables.crossings) == 0


def test_a_line_that_ends_before_the_lane_centre_crosses_nothing():
    town = town_of(("a", "b", straight((0.0, 0.0), (40.0, 0.0))))
    lines = [[10.0, 0.1, 10.0, 4.0], [10.0, 0.0, 30.0, 0.0], [50.0, -4.0, 50.0, 4.0]]
    assert build_rails(town, lines).tables.crossings.shape == (0, 3)


@pytest.mark.parametrize("lines", [[1.0, 2.0, 3.0, 4.0], [[1.0, 2.0]], [[0.0, 0.0, math.nan, 1.0]]])
def test_crossings_must_be_finite_lines(ladder, lines):
    with pytest.raises(ValueError, match=r"crossing_lines must be finite and of shape \(C, 4\)"):
        build_rails(ladder, lines)


def test_a_lane_without_length_is_refused_by_name(ladder):
    town = town_of(("a", "b", CircularLane([0.0, 0.0], 10.0, 1.0, 1.0)))
    with pytest.raises(ValueError, match=r"\('a', 'b', 0\).*longer than 0 m"):
        build_rails(town)


def test_a_route_finds_itself_on_its_rails(town, network):
    rng = np.random.default_rng(4)
    for _ in range(5):
        route = random_route(town, rng, 300.0, 600.0)
        rails, positions = route_rails(network, route)
        assert positions[0] <= 0.0
        assert (np.diff(positions) > 0.0).all()
        np.testing.assert_allclose(np.diff(positions), network.tables.length[rails[:-1]], atol=1e-6)
        for i in range(0, len(route.points), 7):
            position = i * route.spacing_m
            k = np.searchsorted(positions, position, side="right") - 1
            x, y, _ = rail_pose(network.tables, rails[k], position - positions[k])
            assert math.hypot(x - route.points[i, 0], y - route.points[i, 1]) < 0.02


def test_a_route_that_goes_round_a_ring_enters_its_rail_again(ring):
    network = build_rails(ring)
    chain = network.lanes[0]
    first, last = chain[2], chain[3]
    lanes = (*chain[2:], *chain, *chain[:4])
    rails, positions = route_rails(network, Route(ring, lanes, 1.5, 1.0))
    assert rails.tolist() == [0, 0, 0]
    begins = -1.5 - network.lane_offset[first]
    length = network.tables.length[0]
    np.testing.assert_allclose(positions, begins + length * np.arange(3))
    assert last in lanes


def test_rails_of_another_town_are_refused(ring, ladder):
    route = random_route(ladder, np.random.default_rng(0), 30.0, 60.0)
    with pytest.raises(ValueError, match=r"'ladder' with \d+ lanes"):
        route_rails(build_rails(ring), route)


def test_the_tables_have_the_types_kernels_are_compiled_for(ladder, ring):
    for network in (build_rails(ladder, [[20.0, -4.3, 20.0, 4.3]]), build_rails(ring)):
        tables = network.tables
        whole = {"first", "following", "approach", "signal", "conflict_first", "crossing_first"}
        for name, table in tables._asdict().items():
            expected = np.bool_ if name == "movement" else np.int64 if name in whole else np.float64
            assert table.dtype == expected, name
            assert table.flags.c_contiguous, name
        assert tables.samples.shape[1] == 4
        assert tables.conflicts.shape[1] == 4
        assert tables.crossings.shape[1] == 3
        assert (RAIL_X, RAIL_Y, RAIL_HEADING, RAIL_TOP_MPS) == (0, 1, 2, 3)
