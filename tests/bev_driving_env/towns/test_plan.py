import itertools
import math

import numpy as np
import pytest
from highway_env.road.lane import StraightLane

from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.network import TownNetwork
from bev_driving_env.towns.plan import PLAN_SPACING_M, sparse_plan
from bev_driving_env.towns.route import Route, random_route, route_by_turns


def test_without_a_decision_points_are_spread_evenly_up_to_the_end(ring):
    plan = sparse_plan(route_by_turns(ring, (20.0, 2.0), "", (180.0, 2.0)))
    expected = [[60.0, 2.0, 40.0], [100.0, 2.0, 80.0], [140.0, 2.0, 120.0], [180.0, 2.0, 160.0]]
    np.testing.assert_allclose(plan, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("length_m", "stations"),
    [
        (20.0, [20.0]),
        (50.0, [50.0]),
        (100.0, [50.0, 100.0]),
        (100.1, [100.1 / 3, 200.2 / 3, 100.1]),
    ],
)
def test_no_more_points_are_made_than_50_m_gaps_need(ring, length_m, stations):
    plan = sparse_plan(route_by_turns(ring, (20.0, 2.0), "", (20.0 + length_m, 2.0)))
    np.testing.assert_allclose(plan[:, 2], stations, atol=1e-9)


def test_a_corner_without_a_choice_is_no_decision(ring):
    route = route_by_turns(ring, (175.0, 2.0), "", (198.0, 30.0))
    np.testing.assert_allclose(sparse_plan(route), [[198.0, 30.0, route.length_m]])


def test_a_turn_has_a_point_where_the_junction_is_entered_and_where_it_is_left(ladder):
    # entry at x = 40; straight 2 m, a quarter circle of radius 6, straight 2 m
    plan = sparse_plan(route_by_turns(ladder, (20.0, 2.0), "B1R", (48.0, 20.0)))
    through = 4.0 + 3.0 * math.pi
    expected = [[40.0, 2.0, 20.0], [48.0, 10.0, 20.0 + through], [48.0, 20.0, 30.0 + through]]
    np.testing.assert_allclose(plan, expected, atol=1e-3)


def test_going_straight_on_is_a_decision_too(ladder):
    plan = sparse_plan(route_by_turns(ladder, (20.0, 2.0), "B1S", (80.0, 2.0)))
    expected = [[40.0, 2.0, 20.0], [60.0, 2.0, 40.0], [80.0, 2.0, 60.0]]
    np.testing.assert_allclose(plan, expected, atol=1e-9)


def decision_places(route):
    """Ends of the lanes before each decision and of the last junction lane behind it."""
    lanes, successors = route.town.lanes, route.town.successors
    for before, first in itertools.pairwise(range(len(route.lanes))):
        if len(successors[route.lanes[before]]) > 1:
            yield lanes[route.lanes[before]].points[-1, :2]
            behind = next(k for k in route.lanes[first:] if not lanes[k].in_junction)
            yield lanes[behind].points[0, :2]


def test_random_routes_of_the_towns_have_points_at_all_decisions_and_no_gap_over_50_m(town):
    rng = np.random.default_rng(6)
    for _ in range(60):
        route = random_route(town, rng, 80.0, 800.0)
        plan = sparse_plan(route)
        gaps = np.diff(plan[:, 2], prepend=0.0)
        assert gaps.min() > 0.0
        assert gaps.max() <= PLAN_SPACING_M + 1e-6
        np.testing.assert_allclose(plan[-1], [*route.points[-1, :2], route.length_m])
        nearest = (plan[:, 2] / route.spacing_m).round().astype(int)
        assert np.abs(route.points[nearest, :2] - plan[:, :2]).max() <= route.spacing_m / 2 + 1e-6
        places = list(decision_places(route))
        assert len(places) == 2 * len(route.turns.split())
        for place in places:
            assert np.linalg.norm(plan[:, :2] - place, axis=1).min() < 0.01
        # as few as possible: never two neighbours that neither is a decision nor needed
        fixed = np.array([*places, route.points[-1, :2]])
        distances = np.linalg.norm(plan[:, None, :2] - fixed, axis=2).min(axis=1)
        for k in np.flatnonzero(distances[:-1] > 0.01):
            assert plan[k + 1, 2] - plan[k - 1, 2] * (k > 0) > PLAN_SPACING_M - 1e-6


def fork(*junction_lanes):
    """A road from a (40 m) to b that parts to c (30 m) or x; beyond c it goes on to d and e."""
    network = TownNetwork()
    places = {"a": (0, 0), "b": (40, 0), "c": (70, 0), "d": (90, 0), "e": (120, 0), "x": (70, 20)}
    for start, end in ["ab", "bc", "bx", "cd", "de"]:
        network.add_lane(start, end, StraightLane(list(places[start]), list(places[end])))
    network.junction_lanes = {(start, end, 0) for start, end in junction_lanes}
    return compile_network("fork", network, allow_dead_ends=True)


def along(town, names, start_m, end_m):
    numbers = {"".join(lane.index[:2]): k for k, lane in enumerate(town.lanes)}
    return Route(town, tuple(numbers[name] for name in names.split()), start_m, end_m)


@pytest.mark.parametrize(
    ("junction_lanes", "stations"),
    [
        ((), [35.0, 75.0, 115.0]),  # a fork without a junction has nothing to leave
        (("bc", "bx"), [35.0, 65.0, 115.0]),
        (("bc", "bx", "cd"), [35.0, 85.0, 115.0]),  # left at the end of the chain
        (("bc", "bx", "cd", "de"), [35.0, 75.0, 115.0]),  # not left before the route ends
        (("cd",), [35.0, 75.0, 115.0]),  # the later junction offers no choice
    ],
)
def test_the_exit_is_where_the_chain_of_junction_lanes_ends(junction_lanes, stations):
    plan = sparse_plan(along(fork(*junction_lanes), "ab bc cd de", 5.0, 30.0))
    np.testing.assert_allclose(plan[:, 2], stations)
    np.testing.assert_allclose(plan[:, 0], np.array(stations) + 5.0)


def test_a_junction_that_parts_again_inside_is_two_decisions():
    network = TownNetwork()
    places = {"a": (0, 0), "b": (20, 0), "c": (30, 0), "d": (40, 0), "e": (60, 0), "x": (30, 9)}
    for start, end in ["ab", "bc", "bx", "cd", "cx", "de"]:
        network.add_lane(start, end, StraightLane(list(places[start]), list(places[end])))
    network.junction_lanes = {(*pair, 0) for pair in ["bc", "bx", "cd", "cx"]}
    town = compile_network("double", network, allow_dead_ends=True)
    plan = sparse_plan(along(town, "ab bc cd de", 0.0, 20.0))
    np.testing.assert_allclose(plan[:, 2], [20.0, 30.0, 40.0, 60.0])


def test_a_route_that_starts_or_ends_at_a_junction_has_no_point_twice():
    town = fork("bc", "bx")
    from_entry = sparse_plan(along(town, "ab bc cd", 40.0, 10.0))
    to_exit = sparse_plan(along(town, "ab bc", 10.0, 30.0))
    to_entry = sparse_plan(along(town, "ab bc", 10.0, 0.0))
    assert [plan[:, 2].tolist() for plan in (from_entry, to_exit, to_entry)] == [
        [30.0, 40.0],
        [30.0, 60.0],
        [30.0],
    ]
