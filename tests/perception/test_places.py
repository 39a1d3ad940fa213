"""Places along routes in toy towns, where closed forms say what lies ahead."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from bev_driving_env.kernels.layout import ROUTE_POSITION
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.towns.build import build_grid_town
from bev_driving_env.towns.compiled import Lane, compile_network
from bev_driving_env.towns.grid import GridTown
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.towns.route import random_route, route_by_turns
from perception.places import log_places, places_along, stretches


@pytest.fixture(scope="module")
def town():
    """A T junction B1 between two corners; traffic heading east keeps to y = +2.

    At x = 40 the eastbound lane enters the junction: a right turn is a straight of 2 m, an arc of
    6 m and a straight of 2 m. At x = 191 it enters a corner, an arc of 9 - 2 m.
    """
    table = GridTown(
        columns={"A": 0.0, "B": 50.0, "C": 200.0},
        rows={"1": 0.0, "2": 100.0},
        links="A1-B1 B1-C1 A2-B2 B2-C2 A1-A2 B1-B2 C1-C2",
        junctions="""
            B1 8  E 10 62,-4  S 10 54,12  W 10 38,4
            B2 8  N 10 46,88  E 10 62,96  W 10 38,104
        """,
        corners="A1 9  C1 9  C2 9  A2 9",
    )
    return compile_network("toy", build_grid_town(table))


def route_places(town, turns, start, end):
    """The route's stretches, and its places at every 10 cm."""
    route = route_by_turns(town, start, turns, end)
    found = stretches(town, route.lanes, route.start_m)
    position = np.arange(0.0, route.length_m, 0.1) + 0.05
    return found, position, places_along(position, found)


def test_a_right_turn_is_critical_from_20_m_before_it_to_its_end(town):
    found, position, places = route_places(town, "B1R", (12.0, 2.0), (48.0, 60.0))
    entry, leaving = 28.0, 28.0 + 2.0 + 6.0 * math.pi / 2.0 + 2.0
    np.testing.assert_allclose(np.ravel(found), [entry, leaving, True], atol=1e-6)
    expected = (position >= entry - 20.0) & (position < leaving)
    np.testing.assert_array_equal(places.turn, expected)
    np.testing.assert_array_equal(places.critical, expected)
    np.testing.assert_array_equal(places.straight, ~expected)
    assert not expected[[0, -1]].any()


def test_going_straight_through_a_junction_is_critical_but_no_turn(town):
    found, position, places = route_places(town, "B1S", (12.0, 2.0), (150.0, 2.0))
    np.testing.assert_allclose(np.ravel(found), [28.0, 48.0, False], atol=1e-6)
    np.testing.assert_array_equal(places.critical, (position >= 8.0) & (position < 48.0))
    assert not places.turn.any()


def test_a_corner_leaves_no_choice_and_is_no_turn(town):
    found, position, places = route_places(town, "", (100.0, 2.0), (198.0, 60.0))
    end = 91.0 + 7.0 * math.pi / 2.0
    np.testing.assert_allclose(np.ravel(found), [91.0, end, False], atol=1e-6)
    np.testing.assert_array_equal(places.critical, (position >= 71.0) & (position < end))
    assert not places.turn.any()


def test_a_junction_that_a_route_ends_before_does_not_count(town):
    found, _, places = route_places(town, "", (12.0, 2.0), (40.0, 2.0))
    assert len(found.begin_m) == 0
    assert not places.critical.any()


def test_turns_count_one_by_one(town):
    found, *_ = route_places(town, "B1R B2L", (12.0, 2.0), (150.0, 102.0))
    assert found.turns.tolist() == [True, True]
    assert found.begin_m[1] - found.end_m[0] == pytest.approx(80.0)
    ahead = places_along([0.0, 7.9, 8.1], found)
    assert ahead.turn.tolist() == [False, False, True]
    assert places_along([0.0], found, ahead_m=30.0).turn.all()


def test_junctions_that_touch_are_told_apart_by_their_choices():
    # lanes 1 (right turn) and 2 (straight on) lie in the first junction, 3 in the second one
    quarter = np.array([[0.0, 0.0, 1.0, 0.0], [5.0, 5.0, 0.0, 1.0]])
    onward = np.array([[0.0, 0.0, 1.0, 0.0], [10.0, 0.0, 1.0, 0.0]])

    def lane(points, in_junction):
        stations = np.array([0.0, 10.0])
        return Lane(("a", "b", 0), stations, points, stations, (), (), 10.0, in_junction)

    lanes = (lane(onward, False), lane(quarter, True), lane(onward, True), lane(onward, True))
    town = SimpleNamespace(lanes=lanes, successors=((1,), (2, 3), (), ()))
    # the gap from (5, 5) back to the origin counts too
    gaps = np.hypot(10.0, 0.0), np.hypot(5.0, 5.0)
    found = stretches(town, (0, 1, 3), 4.0)
    begin = np.cumsum([6.0 + gaps[0], 10.0 + gaps[1]])
    np.testing.assert_allclose(found.begin_m, begin)
    np.testing.assert_allclose(found.end_m, begin + 10.0)
    assert found.turns.tolist() == [True, False]


def test_wherever_a_route_bends_it_is_critical():
    town, rng = compiled_town("Town02"), np.random.default_rng(0)
    bends = 0
    for _ in range(20):
        route = random_route(town, rng, 80.0, 300.0)
        headings = np.unwrap(np.arctan2(route.points[:, 3], route.points[:, 2]))
        steps = math.floor(20.0 / route.spacing_m)
        bent = [abs(headings[i : i + steps + 1] - headings[i]).max() for i in range(len(headings))]
        position = np.arange(len(headings)) * route.spacing_m
        found = places_along(position, stretches(town, route.lanes, route.start_m))
        ahead = np.array(bent) > 1e-3
        assert found.critical[ahead].all()
        assert not (found.turn & ~found.critical).any()
        bends += ahead.sum()
    assert bends > 1000


def test_samples_of_a_log_are_where_their_states_say(log_folder):
    log = DriveLog(log_folder)
    indices = log.indices()[::7]
    found = log_places(log, indices, ahead_m=60.0)
    for index, critical, turn in zip(indices, found.critical, found.turn, strict=True):
        episode, _ = log.locate(int(index))
        header = log.episodes[episode]
        position = log.state(int(index)).progress[0, ROUTE_POSITION]
        route = stretches(log.town, header.lanes, header.start_m)
        alone = places_along([position], route, ahead_m=60.0)
        assert (critical, turn) == (alone.critical[0], alone.turn[0])
    assert found.critical.any()
