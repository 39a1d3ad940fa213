import math

import numpy as np
import pytest

from bev_driving_env.kernels.layout import (
    SIGNAL_RED,
)
from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.world.config import Rules, WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.infractions import INFRACTIONS, bits_of, names_of

NAMES = (
    "off_road",
    "wrong_lane",
    "route_deviation",
    "collision_vehicle",
    "collision_pedestrian",
    "collision_static",
    "red_light",
    "blocked",
)


def events(world, name):
    return [event for event in world.events[0] if event.name == name]


def test_names_and_order_are_those_of_the_contract():
    assert tuple(INFRACTIONS) == NAMES


def test_every_infraction_has_a_bit_of_its_own():
    assert all(names_of(bits_of([name])) == (name,) for name in NAMES)
    assert names_of(bits_of(NAMES)) == NAMES
    assert names_of(0) == ()
    assert bits_of([]) == 0
    assert bits_of(["blocked", "blocked"]) == bits_of(["blocked"])


def test_an_unknown_infraction_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'offroad'.*off_road, wrong_lane.*blocked"):
        bits_of(["off_road", "offroad"])


def test_driving_straight_on_at_a_corner_ends_off_the_road_where_the_pavement_ends(start, drive):
    world = start(end=(198.0, 40.0), speed=6.0, terminate_on=("off_road",))
    drive(world, 32.0)
    (event,) = events(world, "off_road")
    # the corner's pavement is a quarter disc of radius 14.3 m about (190, 10)
    ahead, right = np.meshgrid(np.linspace(-2.475, 2.475, 100), np.linspace(-0.99, 0.99, 100))
    x = 200.0
    while (np.hypot(x + ahead - 190.0, 2.0 + right - 10.0) > 14.3).mean() < 0.25:
        x += 0.01
    assert event.x == pytest.approx(x, abs=0.6)  # logged at the end of a step of 0.6 m
    assert event.x >= x - 0.15
    assert event.time_s == pytest.approx((event.x - 20.0) / 6.0, abs=1e-6)
    assert (event.y, event.heading, event.speed_mps) == pytest.approx((2.0, 0.0, 6.0))


def test_an_infraction_is_logged_once_at_its_onset_and_again_after_it_ended(start, drive):
    world = start(y=2.0, speed=5.0)
    for y, count in [(4.4, 1), (4.4, 1), (2.0, 1), (2.0, 1), (4.4, 2)]:
        world.state.ego[0, 1] = y  # beyond the kerb at y = 4.3, or in the lane
        drive(world, 0.5)
        assert len(events(world, "off_road")) == count
    first, second = events(world, "off_road")
    assert (first.time_s, second.time_s) == pytest.approx((0.1, 2.1))


def test_a_step_reports_only_what_began_in_it(start, drive):
    world = start(y=4.4, speed=5.0, terminate_on=("off_road",))
    drive(world, 0.1)
    assert names_of(int(world.began[0])) == ("off_road",)
    assert world.terminated()[0]
    drive(world, 0.1)
    assert names_of(int(world.began[0])) == ()
    assert not world.terminated()[0]


def test_more_than_a_second_across_the_center_line_is_wrong_lane(start, drive):
    world = start(y=-1.0, speed=5.0)
    drive(world, 0.9)
    assert not world.events[0]
    drive(world, 0.3)
    (event,) = world.events[0]
    assert event.name == "wrong_lane"
    # one second is not yet more than a second; the next tick is part of the step that ends at 1.1
    assert event.time_s == pytest.approx(1.1)
    assert event.x == pytest.approx(20.0 + 5.0 * 1.1)


def test_coming_back_within_a_second_is_no_wrong_lane(start, drive):
    world = start(speed=5.0)
    for y in (-1.0, 1.0, -1.0, 1.0):
        world.state.ego[0, 1] = y
        drive(world, 0.9)
    assert not world.events[0]


def test_driving_backwards_through_its_own_lane_is_wrong_lane(start, drive):
    world = start(heading=math.pi, speed=3.0)
    drive(world, 1.5)
    assert len(events(world, "wrong_lane")) == 1


@pytest.mark.parametrize("heading", [math.radians(110.0), math.radians(-110.0)])
def test_driving_across_a_lane_is_not_yet_against_it(start, drive, heading):
    world = start(heading=heading, speed=0.2)
    drive(world, 3.0)
    assert not events(world, "wrong_lane")


def test_standing_for_30_s_is_blocked(start, drive):
    world = start()
    drive(world, 29.9)
    assert not world.events[0]
    drive(world, 0.3)
    (event,) = world.events[0]
    assert event.name == "blocked"
    assert event.time_s == pytest.approx(30.05, abs=0.06)
    assert (event.x, event.speed_mps, event.route_m) == pytest.approx((20.0, 0.0, 0.0))


def test_moving_on_for_a_moment_starts_the_30_s_anew(start, drive):
    world = start()
    drive(world, 20.0)
    drive(world, 0.1, acceleration=0.5)
    drive(world, 0.1, acceleration=-1.0)
    drive(world, 29.5)
    assert not world.events[0]
    drive(world, 1.0)
    assert len(events(world, "blocked")) == 1


@pytest.mark.parametrize(("speed", "blocked"), [(0.09, True), (0.11, False)])
def test_creeping_below_0_1_mps_counts_as_standing(start, drive, speed, blocked):
    world = start(speed=speed)
    drive(world, 31.0)
    assert bool(events(world, "blocked")) == blocked


@pytest.mark.parametrize(
    ("y", "deviates"), [(5.4, False), (5.6, True), (-1.4, False), (-1.6, True)]
)
def test_more_than_3_5_m_beside_the_route_is_a_deviation(start, drive, y, deviates):
    world = start(y=y, speed=5.0)
    drive(world, 0.5)
    assert bool(events(world, "route_deviation")) == deviates


def test_a_suite_may_allow_more_deviation(start, drive):
    world = start(y=11.9, speed=5.0, rules=Rules(deviation_m=10.0))
    drive(world, 0.5)
    assert not events(world, "route_deviation")
    world.state.ego[0, 1] = 12.1
    drive(world, 0.1)
    assert len(events(world, "route_deviation")) == 1


def test_leaving_the_route_at_a_junction_deviates_though_the_car_keeps_to_the_road(ladder):
    world = World(ladder, WorldConfig(terminate_on=("route_deviation",)))
    world.place(0, route_by_turns(ladder, (20.0, 2.0), "B1R", (48.0, 20.0)))  # but it goes straight
    world.state.ego[0, 3] = 5.0
    while not world.terminated()[0] and world.state.steps[0] < 200:
        world.step(np.zeros((1, 2)))
    (event,) = world.events[0]
    assert event.name == "route_deviation"
    # the route's right turn has radius 6 about (42, 8); 3.5 m off its arc means 9.5 m from there
    assert event.x == pytest.approx(42.0 + math.sqrt(9.5**2 - 6.0**2), abs=0.55)


def test_only_the_chosen_infractions_end_an_episode(start, drive):
    world = start(y=-2.5, speed=5.0, terminate_on=("wrong_lane",))
    drive(world, 0.1)
    assert names_of(int(world.began[0])) == ("route_deviation",)
    assert not world.terminated()[0]
    drive(world, 0.9)
    while not world.began[0]:
        drive(world, 0.1)
    assert names_of(int(world.began[0])) == ("wrong_lane",)
    assert world.terminated()[0]


@pytest.mark.parametrize(("y", "heading", "count"), [(2.0, 0.0, 1), (-2.0, 0.0, 0)])
def test_only_its_own_lanes_line_counts_and_only_forwards(ladder, drive, y, heading, count):
    world = World(ladder, WorldConfig(rules=Rules(deviation_m=30.0, wrong_lane_s=60.0)))
    world.place(0, route_by_turns(ladder, (20.2, 2.0), "B1S", (90.0, 2.0)))
    world.state.ego[0, 1:] = y, heading, 5.0
    world.state.signals[0] = SIGNAL_RED
    drive(world, 6.0)
    assert len(events(world, "red_light")) == count


def test_crossing_a_line_from_behind_is_no_red_light(ladder, drive):
    world = World(ladder, WorldConfig(rules=Rules(deviation_m=90.0, wrong_lane_s=60.0)))
    world.place(0, route_by_turns(ladder, (20.2, 2.0), "B1S", (90.0, 2.0)))
    world.state.ego[0] = 48.0, 2.0, math.pi, 5.0
    world.state.signals[0] = SIGNAL_RED
    drive(world, 4.0)
    assert world.state.ego[0, 0] == pytest.approx(28.0)
    assert not world.events[0]


def test_each_red_line_crossed_is_an_event_with_its_own_signal(ladder, drive):
    world = World(ladder, WorldConfig(rules=Rules(deviation_m=90.0, wrong_lane_s=60.0)))
    world.place(0, route_by_turns(ladder, (20.2, 2.0), "B1S", (90.0, 2.0)))
    world.state.signals[0] = SIGNAL_RED
    for pose in [(36.0, 2.0, 0.0), (64.0, -2.0, math.pi), (52.0, 14.0, -math.pi / 2.0)]:
        world.state.ego[0] = *pose, 5.0
        drive(world, 0.6)
    assert [event.actor for event in world.events[0]] == ["signal 2", "signal 0", "signal 1"]
    assert {event.name for event in world.events[0]} == {"red_light"}


def travelled(world):
    return tuple(world.state.travelled[0].tolist())


def test_metres_driven_add_up_and_in_the_own_lane_none_of_them_is_outside(start, drive):
    world = start(speed=5.0)
    drive(world, 4.0)
    assert travelled(world) == pytest.approx((20.0, 0.0))


def test_metres_against_the_lane_are_outside_from_the_first_on(start, drive):
    world = start(speed=5.0, rules=Rules(deviation_m=30.0))
    drive(world, 2.0)
    world.state.ego[0, 1] = -2.0
    drive(world, 0.7)
    world.state.ego[0, 1] = 2.0
    drive(world, 1.0)
    assert travelled(world) == pytest.approx((18.5, 3.5))
    assert not world.events[0]


def test_metres_off_the_road_are_outside_and_counted_once_if_also_against_the_lane(start, drive):
    world = start(y=-3.9, speed=5.0, rules=Rules(deviation_m=30.0))
    drive(world, 1.0)
    assert events(world, "off_road")
    assert travelled(world) == pytest.approx((5.0, 5.0))


def test_metres_inside_a_junction_are_not_outside(ladder, drive):
    world = World(ladder, WorldConfig(rules=Rules(deviation_m=30.0)))
    world.place(0, route_by_turns(ladder, (20.0, 2.0), "B1S", (90.0, 2.0)))
    world.state.ego[0] = 42.0, -2.0, 0.0, 5.0
    drive(world, 3.0)
    assert travelled(world) == pytest.approx((15.0, 0.0))


def test_a_stop_and_start_drives_as_far_as_the_car_gets(start, drive):
    world = start()
    drive(world, 1.0, acceleration=1.0)
    drive(world, 2.0)
    drive(world, 2.0, acceleration=-1.0)
    assert world.state.ego[0, 3] == 0.0
    assert travelled(world)[0] == pytest.approx(world.state.ego[0, 0] - 20.0)


def test_a_new_episode_starts_with_no_metres_and_nobody_involved(start, drive, ring):
    world = start(y=-2.0, speed=5.0)
    drive(world, 2.0)
    world.place(0, route_by_turns(ring, (30.0, 2.0), "", (90.0, 2.0)))
    assert not world.state.travelled.any()
    assert not world.state.involved.any()
    assert not world.state.timers.any()


def test_metres_driven_are_those_the_car_moved_while_it_accelerates(start, drive):
    world = start()
    drive(world, 1.0, acceleration=1.0)
    assert travelled(world)[0] == pytest.approx(world.state.ego[0, 0] - 20.0)
