"""``blocked``: standing still counts only with nothing to wait for.

The ego stands on the ladder's western road, whose stop line is at x = 40.
"""

import pytest

from bev_driving_env.kernels.layout import (
    AFTER_RAIL,
    LAST_RAIL,
    NEXT_RAIL,
    RAIL,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    STATION,
    STOPPED_S,
    WANTED_MPS,
)
from bev_driving_env.kernels.walks import (
    ALONG_M,
    CROSSING,
    DIRECTION,
    HESITATE_S,
    MODE,
    ON_CROSSING,
    WALKING,
)
from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.world.config import Rules, WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import TrafficConfig


def events(world, name):
    return [event for event in world.events[0] if event.name == name]


SIGNAL = 2


@pytest.fixture
def wait(ladder):
    """Function that makes a world whose car stands so many metres before the stop line."""

    def make(before_m, *, blocked_s=10.0, **traffic):
        traffic = TrafficConfig(**{"vehicles": 1, **traffic})
        rules = Rules(deviation_m=30.0, blocked_s=blocked_s)
        world = World(ladder, WorldConfig(traffic=traffic, rules=rules))
        world.place(0, route_by_turns(ladder, (10.0, 2.0), "B1S", (90.0, 2.0)))
        world.state.vehicles[:], world.state.pedestrians[:] = 0.0, 0.0
        world.state.ego[0, 0] = 40.0 - before_m - 2.5
        world.state.progress[0, :2] = world.state.ego[0, 0] - 10.0
        return world

    return make


def put_vehicle(world, x, speed=0.0):
    """A vehicle of 4 m on the ego's own road, with no other way than straight on."""
    state = world.state
    rail = int(state.route_rails[0, 0])
    tables = world.town.traffic().network.tables
    state.vehicles[0, 0] = x, 2.0, 0.0, speed, 4.0, 1.8
    state.vehicle_track[0, 0] = 0
    state.vehicle_track[0, 0, [RAIL, NEXT_RAIL, AFTER_RAIL]] = state.route_rails[0, :3]
    state.vehicle_track[0, 0, LAST_RAIL] = -1
    state.vehicle_motion[0, 0] = 0.0
    state.vehicle_motion[0, 0, STATION] = tables.length[rail] - (40.0 - x)


def test_waiting_at_a_red_light_is_not_blocked(wait, drive):
    world = wait(1.0)
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    drive(world, 40.0)
    assert not world.events[0]
    assert world.state.timers[0, STOPPED_S] == pytest.approx(40.0)


@pytest.mark.parametrize("light", [SIGNAL_OFF, SIGNAL_GREEN])
def test_standing_at_a_line_that_may_be_crossed_is_blocked(wait, drive, light):
    world = wait(1.0)
    world.state.signals[0, SIGNAL] = light
    drive(world, 12.0)
    (event,) = world.events[0]
    assert (event.name, event.time_s) == ("blocked", pytest.approx(10.1))


@pytest.mark.parametrize(("before_m", "waits"), [(9.5, True), (10.5, False)])
def test_a_red_light_farther_away_than_10_m_is_no_reason_to_stand(wait, drive, before_m, waits):
    world = wait(before_m)
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    drive(world, 12.0)
    assert bool(events(world, "blocked")) != waits


def test_another_approachs_red_light_is_no_reason_to_stand(wait, drive):
    world = wait(1.0)
    world.state.signals[0] = SIGNAL_RED
    world.state.signals[0, SIGNAL] = SIGNAL_GREEN
    drive(world, 12.0)
    assert len(events(world, "blocked")) == 1


def test_the_time_standing_pauses_while_there_is_something_to_wait_for(wait, drive):
    world = wait(1.0)
    drive(world, 6.0)
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    drive(world, 30.0)
    world.state.signals[0, SIGNAL] = SIGNAL_GREEN
    drive(world, 3.9)
    assert not world.events[0]
    drive(world, 0.3)
    (event,) = world.events[0]
    assert (event.name, event.time_s) == ("blocked", pytest.approx(40.1))


def test_moving_on_starts_the_paused_time_anew(wait, drive):
    world = wait(8.0)
    drive(world, 9.0)
    drive(world, 0.1, acceleration=0.5)
    drive(world, 0.1, acceleration=-1.0)
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    drive(world, 20.0)
    world.state.signals[0, SIGNAL] = SIGNAL_GREEN
    drive(world, 9.8)
    assert not world.events[0]
    drive(world, 0.5)
    assert len(events(world, "blocked")) == 1


def test_standing_behind_a_vehicle_that_waits_is_not_blocked(wait, drive):
    world = wait(10.0)
    # it waits a metre before the line, as its model does; the ego is 5 m behind it
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    put_vehicle(world, 37.0)
    drive(world, 40.0)
    assert world.state.vehicles[0, 0, 0] == pytest.approx(37.0, abs=1e-3)
    assert not world.events[0]


def test_standing_behind_a_vehicle_that_has_gone_is_blocked(wait, drive):
    world = wait(10.0)
    put_vehicle(world, 37.0)
    world.state.vehicle_motion[0, 0, WANTED_MPS] = 8.0
    drive(world, 20.0)
    assert world.state.vehicles[0, 0, 0] > 60.0
    (event,) = world.events[0]
    assert event.name == "blocked"
    assert 10.0 < event.time_s < 14.0


def test_standing_before_people_on_a_crossing_is_not_blocked(wait, drive):
    # the ladder's first crossing is at x = 41.3; it begins on the southern kerb, at y = 4.3
    world = wait(1.0, pedestrians=1)
    state = world.state
    state.pedestrians[0, 0] = 41.3, 2.0, 0.0, 0.0, 0.5, 0.5
    state.pedestrian_track[0, 0] = 0
    state.pedestrian_track[0, 0, [DIRECTION, MODE, CROSSING]] = 1, ON_CROSSING, 0
    state.pedestrian_motion[0, 0] = 0.0
    state.pedestrian_motion[0, 0, [ALONG_M, HESITATE_S]] = 2.3, 30.0
    drive(world, 29.0)
    assert not world.events[0]
    state.pedestrians[0] = 0.0
    state.pedestrian_track[0, 0, MODE] = WALKING
    drive(world, 9.8)
    assert not world.events[0]
    drive(world, 0.5)
    assert [event.name for event in world.events[0]] == ["blocked"]


def test_off_its_route_there_is_nothing_to_wait_for(wait, drive):
    world = wait(1.0)
    world.state.signals[0, SIGNAL] = SIGNAL_RED
    world.state.ego[0, 1] = -2.0
    drive(world, 12.0)
    assert len(events(world, "blocked")) == 1
