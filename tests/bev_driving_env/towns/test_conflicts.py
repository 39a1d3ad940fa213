import math

import gymnasium as gym
import highway_env  # noqa: F401  registers the plain environments
import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.rails import (
    CLEAR_M,
    CROSSES,
    DIVERGES,
    MERGES,
    OTHER,
    RELATION,
    YIELDS,
)
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.conflicts import right_of_way
from bev_driving_env.towns.rails import build_rails

# the largest vehicle and 0.2 m around it
LENGTH, WIDTH = 7.8, 2.85
CROSS_PAIRS = {
    # in every T: left turns meet the opposing straight, and the stem's left turn meets both
    ("through L", "through S"),
    ("through L", "stem L"),
    ("through S", "stem L"),
    # long vehicles swing out: opposing right turns touch over the middle of their common arm
    ("through R", "stem R"),
}
# where right turns are as tight as 3.6 to 4.6 m the longest vehicles swing into the far lane
SWINGING = {("through S", "stem R"), ("through L", "stem R"), ("through R", "stem L")}
SWINGING |= {("through R", "through S")}


@pytest.fixture(scope="session")
def network(town):
    return build_rails(town)


@pytest.fixture(scope="session")
def ladder_network(ladder):
    return build_rails(ladder)


def conflicts(tables):
    """All conflicts as {(movement, other): (relation, clear station, yields)}."""
    table = {}
    for rail in range(len(tables.length)):
        for row in tables.conflicts[tables.conflict_first[rail] : tables.conflict_first[rail + 1]]:
            pair = rail, int(row[OTHER])
            assert pair not in table
            table[pair] = int(row[RELATION]), row[CLEAR_M], bool(row[YIELDS])
    return table


def leads_in(tables, rail):
    return set(np.flatnonzero((tables.following == rail).any(axis=1)))


def leads_out(tables, rail):
    return {k for k in tables.following[rail].tolist() if k >= 0}


def turn(tables, rail):
    """Heading change over a rail in degrees, positive to the right."""
    rows = tables.samples[tables.first[rail] : tables.first[rail + 1]]
    return math.degrees(rows[-1, 2] - rows[0, 2])


def kind(tables, rail):
    """``"through L"``, ``"stem R"`` and the like."""
    letters = {}
    for other in leads_out(tables, tables.approach[rail]):
        angle = turn(tables, other)
        letters[other] = "S" if abs(angle) < 30.0 else "R" if angle > 0.0 else "L"
    return f"{'through' if 'S' in letters.values() else 'stem'} {letters[rail]}"


def bodies(tables, rail, stations, grown_m):
    """Corners (S, 4, 2) of boxes along a rail, which goes on straight beyond its ends."""
    rows = tables.samples[tables.first[rail] : tables.first[rail + 1]]
    along = np.linspace(0.0, tables.length[rail], len(rows))
    x, y, heading = (np.interp(stations, along, rows[:, column]) for column in range(3))
    excess = np.minimum(stations, 0.0) + np.maximum(stations - along[-1], 0.0)
    x, y = x + excess * np.cos(heading), y + excess * np.sin(heading)
    poses = zip(x, y, heading, strict=True)
    return np.array([footprint(pose, LENGTH + grown_m, WIDTH + grown_m) for pose in poses])


def overlaps(ones, others):
    """Whether (S, T) convex polygons (S, 4, 2) and (T, 4, 2) overlap, by separating axes."""
    apart = np.zeros((len(ones), len(others)), dtype=bool)
    for polygons in (ones, others):
        edges = np.roll(polygons, -1, axis=1) - polygons
        axes = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
        for k in range(4):
            a = np.einsum("pd,scd->psc", axes[:, k], ones)
            b = np.einsum("pd,tcd->ptc", axes[:, k], others)
            gap = (a.max(2)[:, :, None] < b.min(2)[:, None]) | (
                b.max(2)[:, None] < a.min(2)[:, :, None]
            )  # (P, S, T), of which only the polygon that gives the axis counts
            index = np.arange(len(polygons))
            apart |= gap[index, index] if polygons is ones else gap[index, :, index].T
    return ~apart


def last_overlap(tables, mine, other, grown_m):
    """Greatest station on the other where its box meets one on mine; -inf if none does."""
    way, others = (np.arange(-2.0, tables.length[k] + 6.0, 0.3) for k in (mine, other))
    ones = bodies(tables, mine, way, grown_m)
    met = overlaps(ones, bodies(tables, other, others, grown_m)).any(axis=0)
    return others[met].max() if met.any() else -math.inf


def test_polygons_that_touch_and_miss():
    square = np.array([[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]])
    diamond = np.array([[[3.1, 0.0], [4.1, 1.0], [3.1, 2.0], [2.1, 1.0]]])
    near = np.concatenate([diamond, diamond - [0.2, 0.0], diamond - [0.8, -1.8]])
    assert overlaps(square, near).tolist() == [[False, True, False]]
    assert overlaps(near, square).tolist() == [[False], [True], [False]]


def check_against_polygons(network, number):
    """Compare the conflicts of one junction with polygons; returns how many there are.

    Corners that graze may go unnoticed between two places that are compared: conflicts must be
    right for bodies a little smaller or larger.
    """
    tables = network.tables
    listed = conflicts(tables)
    movements = np.flatnonzero(tables.movement & (network.junction == number)).tolist()
    pairs = [(mine, other) for mine in movements for other in movements if mine != other]
    for pair in pairs:
        smaller, larger = (last_overlap(tables, *pair, grown_m) for grown_m in (-0.15, 0.15))
        if pair not in listed:
            assert smaller == -math.inf
        elif listed[pair][0] == MERGES:
            assert listed[pair][1] == tables.length[pair[1]]
            assert math.isfinite(larger)
        else:
            assert smaller < listed[pair][1] < larger + 0.5
    return sum(pair in listed for pair in pairs)


def test_clear_stations_agree_with_polygons_on_the_ladder(ladder_network):
    assert check_against_polygons(ladder_network, 0) == 20


@pytest.mark.parametrize("index", [1, 3])
def test_clear_stations_agree_with_polygons_in_the_towns(network, index):
    assert check_against_polygons(network, index) >= 20


def test_conflicts_are_mutual(network):
    listed = conflicts(network.tables)
    for (mine, other), (relation, *_) in listed.items():
        assert listed[other, mine][0] == relation


def test_conflicts_are_between_movements_of_one_junction(network):
    tables = network.tables
    for mine, other in conflicts(tables):
        assert mine != other
        assert tables.movement[[mine, other]].all()
        assert network.junction[mine] == network.junction[other]


def test_others_are_listed_in_ascending_order(network):
    tables = network.tables
    assert tables.conflict_first[0] == 0
    assert tables.conflict_first[-1] == len(tables.conflicts)
    pairs = list(conflicts(tables))
    assert pairs == sorted(pairs)


def test_movements_that_start_or_end_together_are_always_listed(network):
    tables = network.tables
    listed = conflicts(tables)
    movements = np.flatnonzero(tables.movement)
    together = {DIVERGES: 0, MERGES: 0}
    for mine in movements:
        for other in movements[movements != mine]:
            if leads_in(tables, mine) & leads_in(tables, other):
                together[DIVERGES] += 1
                assert listed[mine, other][0] == DIVERGES
            elif leads_out(tables, mine) & leads_out(tables, other):
                together[MERGES] += 1
                assert listed[mine, other][0] == MERGES
            else:
                assert listed.get((mine, other), (CROSSES,))[0] == CROSSES
    # each T has three approaches and three exits with two movements each
    assert together == {kind: 6 * len(network.junctions) for kind in (DIVERGES, MERGES)}


def crossing_kinds(network):
    """For each junction the kinds of movements that cross, as sorted pairs, through first."""
    tables = network.tables
    found = {name: set() for name in network.junctions}
    for (mine, other), (relation, *_) in conflicts(tables).items():
        if relation == CROSSES:
            pair = kind(tables, mine), kind(tables, other)
            found[network.junctions[network.junction[mine]]].add(tuple(sorted(pair)[::-1]))
    return found


def ordered(pairs):
    return {tuple(sorted(pair)[::-1]) for pair in pairs}


def test_movements_cross_as_in_a_t_junction(network, ladder_network):
    for tables in (network, ladder_network):
        for found in crossing_kinds(tables).values():
            assert found >= ordered(CROSS_PAIRS - {("through R", "stem R")})
            assert found <= ordered(CROSS_PAIRS | SWINGING)


def test_opposing_straights_pass_each_other(network, ladder_network):
    for tables in (network, ladder_network):
        for found in crossing_kinds(tables).values():
            assert ("through S", "through S") not in found


def test_right_turns_of_six_metres_stay_clear_of_the_far_lane(ladder_network):
    # the ladder's right turns have a radius of 6 m
    for found in crossing_kinds(ladder_network).values():
        assert found == ordered(CROSS_PAIRS)


def test_the_stem_waits_for_the_through_road_and_left_turns_for_who_comes_towards_them(network):
    tables = network.tables
    order = ["stem L", "stem R", "through L", "through S"]
    for (mine, other), (relation, _, waits) in conflicts(tables).items():
        ranks = [
            order.index(kind(tables, rail).replace("through R", "through S"))
            for rail in (mine, other)
        ]
        assert waits == (relation != DIVERGES and ranks[1] > ranks[0])


def test_nobody_waits_for_each_other(network):
    listed = conflicts(network.tables)
    for (mine, other), (_, _, waits) in listed.items():
        assert not (waits and listed.get((other, mine), (0, 0.0, False))[2])


def test_ranks_follow_the_kind_of_movement(network):
    tables = network.tables
    rank = right_of_way(tables)
    expected = {"through S": 3, "through R": 3, "through L": 2, "stem R": 1, "stem L": 0}
    for rail in range(len(tables.length)):
        if tables.movement[rail]:
            assert rank[rail] == expected[kind(tables, rail)]
        else:
            assert rank[rail] == -1


def cross(*, overpass_m=0.0):
    """Two one-way roads that cross at right angles, each with lanes of 20 m in the middle.

    Each road parts at its junction into two movements, straight on and a turn to the right.
    """
    network = RoadNetwork()

    def add(start, end, a, b):
        network.add_lane(start, end, StraightLane(np.array(a, float), np.array(b, float)))

    x = overpass_m
    add("w", "w_in", (-110.0, 0.0), (-10.0, 0.0))
    add("w_in", "e_out", (-10.0, 0.0), (10.0, 0.0))
    add("e_out", "e", (10.0, 0.0), (110.0, 0.0))
    add("n", "n_in", (x, -110.0), (x, -10.0))
    add("n_in", "s_out", (x, -10.0), (x, 10.0))
    add("s_out", "s", (x, 10.0), (x, 110.0))
    arc = CircularLane([-10.0, 10.0], 10.0, -math.pi / 2.0, 0.0)
    network.add_lane("w_in", "r_out", arc)
    add("r_out", "r", (0.0, 10.0), (0.0, 90.0))
    arc = CircularLane([x - 10.0, -10.0], 10.0, 0.0, math.pi / 2.0)
    network.add_lane("n_in", "l_out", arc)
    add("l_out", "l", (x - 10.0, 0.0), (x - 90.0, 0.0))
    return compile_network("cross", network, allow_dead_ends=True)


def named(town, network):
    """Rail by the nodes it starts and ends at."""
    ends = [(town.lanes[c[0]].index[0], town.lanes[c[-1]].index[1]) for c in network.lanes]
    return {pair: rail for rail, pair in enumerate(ends)}


def test_straights_at_right_angles_clear_each_other_by_half_a_length_and_half_a_width():
    town = cross()
    network = build_rails(town)
    rails = named(town, network)
    east, south = rails["w_in", "e_out"], rails["n_in", "s_out"]
    listed = conflicts(network.tables)
    for pair in ((east, south), (south, east)):
        relation, clear, waits = listed[pair]
        assert relation == CROSSES
        # past the middle, at station 10, by half a length and half a width
        assert clear == pytest.approx(10.0 + LENGTH / 2.0 + WIDTH / 2.0, abs=0.3)
        assert not waits
    assert len(network.junctions) == 1


def test_roads_that_are_far_apart_have_no_conflict():
    town = cross(overpass_m=60.0)
    network = build_rails(town)
    rails = named(town, network)
    listed = conflicts(network.tables)
    assert (rails["w_in", "e_out"], rails["n_in", "s_out"]) not in listed
    assert {relation for relation, *_ in listed.values()} == {DIVERGES}
    assert len(network.junctions) == 2
    assert network.junctions == ("w_in", "n_in")


def test_a_body_that_stays_in_the_way_counts_until_six_metres_beyond_its_end():
    # the right turn ends on the very place where the road from the north goes on
    town = cross()
    network = build_rails(town)
    rails = named(town, network)
    turning, south = rails["w_in", "r_out"], rails["n_in", "s_out"]
    relation, clear, _ = conflicts(network.tables)[south, turning]
    assert relation == CROSSES
    assert clear == pytest.approx(network.tables.length[turning] + 6.0, abs=0.2)


@pytest.mark.parametrize("step", [1, -1])
def test_movements_one_after_the_other_do_not_conflict(step):
    # both lanes between the parting and the meeting of roads count as inside
    network = RoadNetwork()
    ways = {
        ("a", "b"): ((0, 0), (100, 0)),
        ("b", "c"): ((100, 0), (130, 0)),
        ("b", "x"): ((100, 0), (125, 40)),
        ("c", "d"): ((130, 0), (160, 0)),
        ("c", "y"): ((130, 0), (150, -40)),
        ("d", "e"): ((160, 0), (300, 0)),
    }
    for (start, end), (a, b) in list(ways.items())[::step]:
        network.add_lane(start, end, StraightLane(np.array(a, float), np.array(b, float)))
    town = compile_network("row", network, allow_dead_ends=True)
    rails = build_rails(town)
    by_ends = named(town, rails)
    first, second = by_ends["b", "c"], by_ends["c", "d"]
    assert rails.tables.movement[[first, second]].all()
    listed = conflicts(rails.tables)
    assert (first, second) not in listed
    assert (second, first) not in listed
    assert rails.tables.approach[second] == first
    assert len(rails.junctions) == 1


def test_a_plain_intersection_is_one_junction_where_everybody_meets():
    env = gym.make("intersection-v2").unwrapped
    env.reset(seed=0)
    town = compile_network("intersection", env.road.network, allow_dead_ends=True)
    network = build_rails(town)
    tables = network.tables
    listed = conflicts(tables)
    assert tables.movement.sum() == 12
    assert len(network.junctions) == 1
    relations = [relation for relation, *_ in listed.values()]
    # four approaches and four exits with three movements each
    assert relations.count(DIVERGES) == relations.count(MERGES) == 24
    straights = [k for k in np.flatnonzero(tables.movement) if abs(turn(tables, k)) < 1.0]
    assert len(straights) == 4
    for mine in straights:
        crossed = [other for other in straights if (mine, other) in listed]
        assert len(crossed) == 2
        assert all(abs(math.sin(headings(tables, mine, other))) > 0.9 for other in crossed)


def headings(tables, mine, other):
    """Angle between the directions in which two rails start."""
    return tables.samples[tables.first[mine], 2] - tables.samples[tables.first[other], 2]


@pytest.mark.parametrize("name", ["roundabout-v1", "highway-v0"])
def test_a_plain_network_without_movements_has_no_conflicts(name):
    env = gym.make(name).unwrapped
    env.reset(seed=0)
    network = build_rails(compile_network(name, env.road.network, allow_dead_ends=True))
    assert not network.tables.movement.any()
    assert network.tables.conflicts.shape == (0, 4)
    assert set(network.tables.conflict_first.tolist()) == {0}
