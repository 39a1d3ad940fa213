import itertools
import math

import numpy as np
import pytest
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.route import (
    Route,
    locate,
    random_route,
    route_by_turns,
    shortest_route,
)


def lanes_between(town, start, end):
    return next(k for k, lane in enumerate(town.lanes) if lane.index[:2] == (start, end))


def test_a_route_starts_and_ends_at_its_stations_and_is_as_long_as_its_lanes(ring):
    # east along the north, the corner B1 (right turn of radius 8), then south
    lanes = [lanes_between(ring, "A1.E.out", "B1.W.in")]
    for _ in range(2):
        lanes += ring.successors[lanes[-1]]
    route = Route(ring, tuple(lanes), start_m=30.0, end_m=15.0)
    assert route.length_m == pytest.approx(150.0 + 8.0 * math.pi / 2.0 + 15.0)
    assert route.points[0] == pytest.approx([40.0, 2.0, 1.0, 0.0])
    assert route.points[-1] == pytest.approx([198.0, 25.0, 0.0, 1.0])


def test_route_points_are_even_and_point_along_the_route(ladder):
    rng = np.random.default_rng(0)
    for _ in range(10):
        route = random_route(ladder, rng, 60.0, 300.0)
        steps = np.diff(route.points[:, :2], axis=0)
        gaps = np.linalg.norm(steps, axis=1)
        assert 0.4 < route.spacing_m <= 0.5
        np.testing.assert_allclose(gaps, route.spacing_m, rtol=0.005)
        assert route.spacing_m * len(gaps) == pytest.approx(route.length_m)
        np.testing.assert_allclose(np.linalg.norm(route.points[:, 2:], axis=1), 1.0)
        along = (steps / gaps[:, None] * route.points[:-1, 2:]).sum(axis=1)
        assert np.arccos(np.clip(along, -1.0, 1.0)).max() < 0.5 / 6.0


def test_lanes_that_do_not_lead_on_are_no_route(ring):
    lane = lanes_between(ring, "A1.E.out", "B1.W.in")
    with pytest.raises(ValueError, match="does not lead on"):
        Route(ring, (lane, lane), 0.0, 10.0)


@pytest.mark.parametrize("end_m", [10.5, 10.0, 3.0])
def test_a_route_shorter_than_a_metre_is_refused_with_its_length(ring, end_m):
    with pytest.raises(ValueError, match=f"at least 1 m.*{end_m - 10.0:.2f} m"):
        Route(ring, (0,), 10.0, end_m)


def test_decisions_are_named_by_junction_and_direction(ladder):
    # heading east along the north side of a ladder whose rung goes south at B1
    right = route_by_turns(ladder, (20.0, 2.0), "B1R", (48.0, 20.0))
    straight = route_by_turns(ladder, (20.0, 2.0), "B1S", (80.0, 2.0))
    left = route_by_turns(ladder, (20.0, 2.0), "B1R B2L", (80.0, 42.0))
    assert [route.turns for route in (right, straight, left)] == ["B1R", "B1S", "B1R B2L"]
    assert right.points[-1] == pytest.approx([48.0, 20.0, 0.0, 1.0])
    assert left.points[-1] == pytest.approx([80.0, 42.0, 1.0, 0.0])


def test_an_impossible_decision_is_refused_with_the_possible_ones(ladder):
    with pytest.raises(ValueError, match=r"'B1L' is not possible.*(B1R.*B1S|B1S.*B1R)"):
        route_by_turns(ladder, (20.0, 2.0), "B1L", (80.0, 2.0))


def test_a_missing_decision_is_asked_for(ladder):
    with pytest.raises(ValueError, match=r"where to go: .*B1"):
        route_by_turns(ladder, (20.0, 2.0), "", (80.0, 2.0))


def test_an_end_on_the_other_side_of_the_road_is_never_reached(ring):
    with pytest.raises(ValueError, match="never comes to its end"):
        route_by_turns(ring, (20.0, 2.0), "", (80.0, -2.0))


def test_a_lap_of_the_ring_may_end_before_it_starts(ring):
    lap = route_by_turns(ring, (60.0, 2.0), "", (50.0, 2.0))
    inner = 2 * (180.0 + 40.0) + 2.0 * math.pi * 8.0
    assert lap.length_m == pytest.approx(inner - 10.0)


def cheapest_by_force(town, start, goal):
    """Length of the shortest of all lane sequences of up to eight lanes."""
    (lane, start_m), (goal_lane, end_m) = start, goal
    best, paths = math.inf, [[lane]]
    for _ in range(8):
        paths = [[*path, k] for path in paths for k in town.successors[path[-1]]]
        for path in paths:
            if path[-1] == goal_lane:
                between = sum(town.lanes[k].length_m for k in path[:-1])
                best = min(best, between - start_m + end_m)
    return best


def grid_of_one_way_streets():
    network = RoadNetwork()
    places = {"a": (0, 0), "b": (40, 0), "c": (40, 30), "d": (0, 30), "e": (80, 10)}
    for start, end in ["ab", "bc", "cd", "da", "ac", "be", "ec", "ca", "db"]:
        network.add_lane(start, end, StraightLane(list(places[start]), list(places[end])))
    return compile_network("streets", network)


def test_the_shortest_route_is_the_shortest_of_all_routes():
    town = grid_of_one_way_streets()
    places = [(lane, part * town.lanes[lane].length_m) for lane in range(9) for part in (0.2, 0.7)]
    for start, goal in itertools.product(places, places):
        if start[0] == goal[0] and goal[1] > start[1]:
            expected = goal[1] - start[1]
        else:
            expected = cheapest_by_force(town, start, goal)
        route = shortest_route(town, start, goal)
        assert route.length_m == pytest.approx(expected)
        assert (route.lanes[0], route.start_m) == start
        assert (route.lanes[-1], route.end_m) == goal


def test_shortest_routes_of_the_towns_agree_with_networkx(town):
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph()
    for lane, following in enumerate(town.successors):
        graph.add_weighted_edges_from((lane, k, town.lanes[lane].length_m) for k in following)
    rng = np.random.default_rng(0)
    for lane, goal in rng.integers(0, len(town.lanes), (30, 2)):
        if lane != goal:
            route = shortest_route(town, (int(lane), 0.3), (int(goal), 1.0))
            length = networkx.dijkstra_path_length(graph, lane, goal)
            assert route.length_m == pytest.approx(length - 0.3 + 1.0)


def test_a_goal_that_no_way_leads_to_is_refused():
    network = RoadNetwork()
    for start, end, y in [("a", "b", 0.0), ("c", "d", 50.0)]:
        network.add_lane(start, end, StraightLane([0.0, y], [30.0, y]))
        network.add_lane(end, start, StraightLane([30.0, y], [0.0, y]))
    town = compile_network("islands", network)
    with pytest.raises(ValueError, match="no way leads"):
        shortest_route(town, (0, 5.0), (2, 5.0))


def test_random_routes_keep_their_bounds_and_end_outside_junctions(town):
    rng = np.random.default_rng(3)
    for _ in range(100):
        route = random_route(town, rng, 90.0, 250.0)
        assert 90.0 - 1e-9 <= route.length_m <= 250.0 + 1e-9
        assert not town.lanes[route.lanes[0]].in_junction
        assert not town.lanes[route.lanes[-1]].in_junction


def test_the_same_seed_draws_the_same_routes(town):
    first, again, other = (
        [random_route(town, np.random.default_rng(seed), 100.0, 400.0) for _ in range(3)]
        for seed in (5, 5, 6)
    )
    assert [(r.lanes, r.start_m, r.end_m) for r in first] == [
        (r.lanes, r.start_m, r.end_m) for r in again
    ]
    assert first[0].start_m != other[0].start_m


def test_in_a_town_that_is_all_junctions_random_routes_start_and_end_anywhere():
    town = grid_of_one_way_streets()
    assert all(lane.in_junction for lane in town.lanes)
    route = random_route(town, np.random.default_rng(0), 50.0, 80.0)
    assert 50.0 <= route.length_m <= 80.0


def test_every_place_on_a_road_is_located_by_its_heading(town):
    rng = np.random.default_rng(1)
    for number, lane in enumerate(town.lanes):
        if not lane.in_junction:
            station = rng.uniform(0.05, 0.95) * lane.length_m
            x, y, heading = lane.pose_at(station)
            right = rng.uniform(-1.5, 1.5)
            x, y = x - right * math.sin(heading), y + right * math.cos(heading)
            found, at_m = locate(town, x, y, heading + rng.uniform(-0.2, 0.2))
            assert found == number
            assert at_m == pytest.approx(station, abs=0.3)


def test_without_a_heading_the_nearest_lane_is_found_and_with_one_the_lane_that_goes_that_way(ring):
    east = lanes_between(ring, "A1.E.out", "B1.W.in")
    west = lanes_between(ring, "B1.W.out", "A1.E.in")
    assert locate(ring, 50.0, 0.5) == (east, pytest.approx(40.0))
    assert locate(ring, 50.0, -0.5) == (west, pytest.approx(140.0))
    assert locate(ring, 50.0, 0.5, math.pi) == (west, pytest.approx(140.0))
    assert locate(ring, 50.0, -0.5, 0.0) == (east, pytest.approx(40.0))


def test_a_road_is_preferred_to_a_junction_lane_at_the_same_place(ladder):
    x, y = 40.1, 2.0  # on the stop line of B1's western arm, just inside the junction
    assert not ladder.lanes[locate(ladder, x, y, 0.0)[0]].in_junction
    assert ladder.lanes[locate(ladder, 50.0, 2.0, 0.0)[0]].in_junction
