"""May a driver enter junction B1 of the ladder, in scenes made by hand?

Ways are named by the arms they join: "WE" goes straight on to the east, "ES" turns left into the
stem, "SW" left out of it, "WS" right into it, "SE" right out of it.
"""

import itertools

import numpy as np
import pytest

from bev_driving_env.kernels.layout import (
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
)
from bev_driving_env.kernels.rails import CLEAR_M, OTHER, rail_pose
from bev_driving_env.kernels.right_of_way import (
    FREE,
    FULL,
    GIVE_WAY,
    IN_THE_WAY,
    PEOPLE,
    STOP_SIGNAL,
    may_enter,
)
from bev_driving_env.towns.route import route_by_turns

from .rail_scene import EGO_LENGTH_M, RailScene

WAYS = ("EW", "ES", "WE", "WS", "SE", "SW")
# pairs of ways from different arms whose paths cross, end in one road, or keep clear
CROSSING = ("ES WE", "ES SW", "WE SW")
MERGING = ("WE SE", "EW SW", "ES WS")


@pytest.fixture
def scene(ladder):
    return RailScene(ladder)


@pytest.fixture(scope="module")
def left_turn(ladder):
    """A route from the north-eastern road left into the stem."""
    return route_by_turns(ladder, (75.0, -2.0), "B1L", (48.0, 20.0))


def asked(scene, i=0):
    return may_enter(scene.rails, scene.line_up(), i, scene.signals, scene.occupied)


def light(scene, arm, state, others=SIGNAL_RED):
    scene.signals[:] = others
    scene.signals[scene.rails.signal[scene.approach(arm)]] = state


def pairs(texts):
    """Both ways round."""
    return [pair for text in texts for pair in itertools.permutations(text.split())]


@pytest.mark.parametrize("way", WAYS)
def test_an_empty_junction_is_free_to_all(scene, way):
    scene.approaching(way)
    assert asked(scene) == FREE


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("state", "answer"),
    [
        (SIGNAL_RED, STOP_SIGNAL),
        (SIGNAL_YELLOW, STOP_SIGNAL),
        (SIGNAL_GREEN, FREE),
        (SIGNAL_OFF, FREE),
    ],
)
def test_who_stands_at_a_signal_goes_by_its_own_light(scene, way, state, answer):
    scene.approaching(way)
    for others in (SIGNAL_RED, SIGNAL_GREEN):
        light(scene, way[0], state, others)
        assert asked(scene) == answer


@pytest.mark.parametrize(
    ("line_m", "speed", "answer"),
    [(5.0, 8.0, FREE), (30.0, 8.0, STOP_SIGNAL), (5.0, 5.0, STOP_SIGNAL)],
)
def test_yellow_is_driven_through_only_where_braking_would_be_hard(scene, line_m, speed, answer):
    """From 8 m/s stopping at 3 m/s^2 takes 10.7 m, from 5 m/s it takes 4.2 m."""
    light(scene, "W", SIGNAL_YELLOW)
    scene.approaching("WE", line_m, speed=speed)
    assert asked(scene) == answer


@pytest.mark.parametrize("others", [SIGNAL_OFF, SIGNAL_RED])
@pytest.mark.parametrize(("way", "other"), pairs(CROSSING + MERGING))
def test_somebody_halfway_through_a_way_that_meets_ones_own_is_waited_for(
    scene, way, other, others
):
    light(scene, way[0], SIGNAL_OFF if others == SIGNAL_OFF else SIGNAL_GREEN, others)
    scene.approaching(way)
    movement = scene.movement(other)
    scene.add(movement, 0.45 * scene.rails.length[movement], scene.exit(other[1]), speed=5.0)
    assert asked(scene) == IN_THE_WAY


@pytest.mark.parametrize(("way", "other"), pairs(("EW WE", "EW WS", "EW SE", "WS SW")))
def test_ways_that_keep_clear_of_each_other_are_used_together(scene, way, other):
    scene.approaching(way)
    movement = scene.movement(other)
    scene.add(movement, 0.45 * scene.rails.length[movement], scene.exit(other[1]), speed=5.0)
    assert asked(scene) == FREE


@pytest.mark.parametrize("way", WAYS)
def test_somebody_ahead_on_ones_own_way_is_followed_not_waited_for(scene, way):
    scene.approaching(way)
    scene.add(scene.movement(way), 10.0, scene.exit(way[1]), speed=5.0)
    assert asked(scene) == FREE


@pytest.mark.parametrize(("way", "other"), [("WE", "WS"), ("ES", "EW"), ("SW", "SE")])
def test_somebody_who_turns_off_ahead_is_followed_not_waited_for(scene, way, other):
    scene.approaching(way)
    scene.add(scene.movement(other), 5.0, scene.exit(other[1]), speed=5.0)
    assert asked(scene) == FREE


def test_who_has_crossed_ones_way_is_waited_for_no_longer(scene):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE")
    other = scene.movement("ES")
    crosser = scene.add(other, 0.0, scene.exit("S"), speed=5.0)
    answers = []
    for station in np.arange(0.0, scene.rails.length[other], 0.25):
        scene.motion[crosser, 0] = station
        answers.append(asked(scene))
    assert answers[0] == IN_THE_WAY
    assert answers[-1] == FREE
    assert sum(a != b for a, b in itertools.pairwise(answers)) == 1
    # a car of 4 m that has just left the lane from the west: its tail is south of y = 2 + 0.9
    left = 0.25 * answers.index(FREE)
    assert rail_pose(scene.rails, other, left - 2.0)[1] > 2.9


def test_who_ends_in_the_same_road_is_waited_for_until_it_is_there(scene):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE")
    other = scene.movement("SE")
    scene.add(other, scene.rails.length[other] - 0.1, scene.exit("E"), speed=8.0)
    assert asked(scene) == IN_THE_WAY


@pytest.mark.parametrize(("station", "answer"), [(3.0, IN_THE_WAY), (5.0, FREE)])
def test_a_tail_may_be_in_the_way_when_its_vehicle_is_on_the_next_road(scene, station, answer):
    rails, other = scene.rails, scene.movement("ES")
    conflicts = rails.conflicts.copy()
    mine = slice(*rails.conflict_first[scene.movement("WE") :][:2])
    (row,) = np.flatnonzero(conflicts[mine, OTHER] == other) + mine.start
    conflicts[row, CLEAR_M] = rails.length[other] + 4.0
    scene.rails = rails._replace(conflicts=conflicts)
    scene.approaching("WE")
    scene.add(scene.exit("S"), station, speed=5.0)
    assert asked(scene) == answer


@pytest.mark.parametrize(("admitted", "answer"), [(True, IN_THE_WAY), (False, FREE)])
def test_who_can_no_longer_stop_before_its_line_is_waited_for(scene, admitted, answer):
    light(scene, "S", SIGNAL_GREEN)
    scene.approaching("SW")
    scene.approaching("ES", 6.0, speed=7.0, admitted=admitted)
    assert asked(scene) == answer


def test_who_can_no_longer_stop_but_goes_elsewhere_is_not_waited_for(scene):
    scene.approaching("WE")
    scene.approaching("EW", 6.0, speed=7.0, admitted=True)
    assert asked(scene) == FREE


@pytest.mark.parametrize(("speed", "answer"), [(9.0, IN_THE_WAY), (4.0, FREE)])
def test_an_ego_that_can_no_longer_stop_before_its_line_is_waited_for(
    scene, left_turn, speed, answer
):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE")
    line_m = scene.rails.length[scene.approach("E")] - 8.0 - EGO_LENGTH_M / 2.0
    scene.send_ego(left_turn, 0.0)
    scene.send_ego(left_turn, line_m - scene.line_up().station[-1], speed=speed)
    assert asked(scene) == answer


def test_an_ego_inside_the_junction_is_waited_for(scene, left_turn):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE")
    on_road_m = scene.rails.length[scene.approach("E")]
    scene.send_ego(left_turn, 0.0)
    scene.send_ego(left_turn, on_road_m - scene.line_up().station[-1] + 8.0)
    assert asked(scene) == IN_THE_WAY


# the left turn gives way to oncoming traffic, the stem to the through road
YIELDS = ("ES WE", "ES WS", "SE WE", "SW EW", "SW WE", "SW ES")


@pytest.mark.parametrize(("way", "other"), [text.split() for text in YIELDS])
def test_without_signals_left_turns_and_the_stem_give_way(scene, way, other):
    scene.approaching(way)
    scene.approaching(other, 20.0, speed=8.0)
    assert asked(scene) == GIVE_WAY


@pytest.mark.parametrize(("other", "way"), [text.split() for text in YIELDS])
def test_without_signals_the_through_road_does_not_give_way(scene, way, other):
    scene.approaching(way)
    scene.approaching(other, 20.0, speed=8.0)
    assert asked(scene) == FREE


@pytest.mark.parametrize(("way", "other"), [text.split() for text in YIELDS])
def test_at_a_green_light_nobody_gives_way_to_who_has_red(scene, way, other):
    light(scene, way[0], SIGNAL_GREEN)
    scene.approaching(way)
    scene.approaching(other, 20.0, speed=8.0)
    assert asked(scene) == FREE


@pytest.mark.parametrize(
    ("line_m", "speed", "answer"),
    [(39.0, 8.0, GIVE_WAY), (41.0, 8.0, FREE), (4.0, 1.0, GIVE_WAY), (6.0, 1.0, FREE)],
)
def test_who_is_5_s_away_leaves_a_gap(scene, line_m, speed, answer):
    scene.approaching("SE")
    scene.approaching("WE", line_m, speed=speed)
    assert asked(scene) == answer


def test_nobody_gives_way_to_who_stands(scene):
    scene.approaching("SE")
    scene.approaching("WE", 1.0, speed=0.0)
    assert asked(scene) == FREE


def test_nobody_gives_way_to_who_goes_elsewhere(scene):
    scene.approaching("SE")
    scene.approaching("EW", 10.0, speed=8.0)
    assert asked(scene) == FREE


@pytest.mark.parametrize(("waited", "answer"), [(14.0, GIVE_WAY), (16.0, FREE)])
def test_patience_ends_after_15_s(scene, waited, answer):
    scene.approaching("SE", waited=waited)
    scene.approaching("WE", 20.0, speed=8.0)
    assert asked(scene) == answer


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def meet(path, a, b):
    """Whether a polyline (K, 2) crosses the segment from a to b."""
    p, q = path[:-1].T, path[1:].T
    sides = _cross((b - a), (p - a[:, None])) * _cross((b - a), (q - a[:, None]))
    ends = _cross((q - p), (a[:, None] - p)) * _cross((q - p), (b[:, None] - p))
    return bool(((sides <= 0.0) & (ends <= 0.0)).any())


@pytest.mark.parametrize("way", WAYS)
def test_people_on_the_half_of_a_crossing_that_ones_way_leads_over_are_waited_for(scene, way):
    scene.approaching(way)
    movement = scene.movement(way)
    stations = np.linspace(0.0, scene.rails.length[movement], 200)
    path = np.array([rail_pose(scene.rails, movement, s)[:2] for s in stations])
    answers = []
    for number, (ax, ay, bx, by) in enumerate(scene.crossing_ends):
        ends = np.array([[ax, ay], [(ax + bx) / 2.0, (ay + by) / 2.0], [bx, by]])
        for half in range(2):
            scene.occupied[:] = 0
            scene.occupied[number, half] = 1
            answers.append(asked(scene))
            assert answers[-1] == (PEOPLE if meet(path, *ends[half : half + 2]) else FREE)
    assert answers.count(PEOPLE) == 2  # one crossing on the way in and one on the way out


@pytest.mark.parametrize(
    ("rear_m", "speed", "answer"),
    [
        (6.9, 0.0, FULL),  # a car of 4 m needs 3 m more
        (7.1, 0.0, FREE),
        (6.0, 2.4, FULL),
        (6.0, 2.6, FREE),
        (3.9, 5.0, FULL),
    ],
)
def test_a_road_behind_the_junction_needs_room_unless_its_traffic_rolls(
    scene, rear_m, speed, answer
):
    scene.approaching("WE")
    scene.add(scene.exit("E"), rear_m + 2.0, speed=speed)
    assert asked(scene) == answer


@pytest.mark.parametrize(("rear_m", "answer"), [(13.9, FULL), (14.1, FREE)])
def test_room_is_kept_for_who_is_already_in_the_junction(scene, rear_m, answer):
    scene.approaching("WE")
    scene.add(scene.exit("E"), rear_m + 2.0)
    scene.add(scene.movement("WE"), 15.0, scene.exit("E"))
    assert asked(scene) == answer


def test_a_long_vehicle_needs_more_room_than_a_short_one(scene):
    short, long = scene.approaching("WE", length=4.0), scene.approaching("SE", length=7.0)
    scene.add(scene.exit("E"), 10.0)
    assert asked(scene, short) == FREE
    assert asked(scene, long) == FULL


@pytest.mark.parametrize(
    ("waited", "others_waited", "answer"),
    [(0.0, 49.0, FREE), (0.0, 51.0, FULL), (70.0, 60.0, FREE), (60.0, 70.0, FULL)],
)
def test_the_next_room_goes_to_who_has_starved_for_it(scene, waited, others_waited, answer):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE", waited=waited)
    scene.approaching("SE", waited=others_waited)
    assert asked(scene) == answer


def test_who_starves_for_another_road_is_not_let_go_first(scene):
    light(scene, "W", SIGNAL_GREEN)
    scene.approaching("WE")
    scene.approaching("SW", waited=60.0)
    assert asked(scene) == FREE


def test_asking_changes_nothing(scene):
    light(scene, "S", SIGNAL_GREEN)
    scene.approaching("SW")
    scene.approaching("WE", 5.0, speed=8.0)
    lineup = scene.line_up()
    before = [column.copy() for column in lineup]
    for i in range(2):
        may_enter(scene.rails, lineup, i, scene.signals, scene.occupied)
    for column, was in zip(lineup, before, strict=True):
        np.testing.assert_array_equal(column, was)
    assert scene.vehicles[1, SPEED] == 8.0
