"""Collisions with others: who was hit, who was at fault, and when it is another one.

The ego is on the ring's northern road; a vehicle off the rails is moved by nothing.
"""

import math

import pytest

from bev_driving_env.kernels.layout import (
    RAIL,
)
from bev_driving_env.kernels.walks import (
    MODE,
)
from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.world.config import Rules, WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import TrafficConfig


def events(world, name):
    return [event for event in world.events[0] if event.name == name]


@pytest.fixture
def beside(ring):
    """Function that makes a world with the ego at x = 60 and a vehicle of 4 m somewhere."""

    def make(x, y=2.0, heading=0.0, *, speed=0.0, other_speed=0.0):
        config = WorldConfig(traffic=TrafficConfig(vehicles=3), rules=Rules(deviation_m=30.0))
        world = World(ring, config)
        world.place(0, route_by_turns(ring, (20.0, 2.0), "", (180.0, 2.0)))
        world.state.vehicles[:], world.state.vehicle_track[0, :, RAIL] = 0.0, -1
        world.state.vehicles[0, 1] = x, y, heading, other_speed, 4.0, 1.8
        world.state.ego[0] = 60.0, 2.0, 0.0, speed
        world.state.progress[0, :2] = 40.0
        return world

    return make


@pytest.mark.parametrize(
    ("scene", "fault"),
    [
        (dict(x=64.0, speed=4.0), "ego"),
        (dict(x=64.0, speed=4.0, other_speed=2.0), "ego"),
        (dict(x=64.0, heading=math.pi, speed=4.0, other_speed=2.0), ""),
        (dict(x=56.0, speed=2.0, other_speed=4.0), "other"),
        (dict(x=56.0, other_speed=4.0), "other"),
        (dict(x=60.0, y=0.3, speed=4.0, other_speed=4.0), ""),
        (dict(x=60.0, y=0.3, speed=4.0), "ego"),
    ],
)
def test_a_collision_names_the_vehicle_and_who_was_at_fault(beside, drive, scene, fault):
    world = beside(**scene)
    drive(world, 0.1)
    (event,) = events(world, "collision_vehicle")
    assert (event.actor, event.fault) == ("vehicle 1", fault)
    assert event.speed_mps == scene.get("speed", 0.0)


@pytest.mark.parametrize(("speed", "fault"), [(0.0, "other"), (3.0, "ego")])
def test_a_pedestrian_who_walks_into_a_standing_car_is_at_fault(start, drive, speed, fault):
    world = start(speed=speed, traffic=TrafficConfig(pedestrians=2))
    state = world.state
    state.pedestrians[0], state.pedestrian_track[0, :, MODE] = 0.0, -1
    drive(world, 0.1)
    assert not world.events[0]
    # from the side: what he does decides nothing but where he is
    state.pedestrians[0, 1] = state.ego[0, 0], 2.0 + 1.2, -1.5, 1.2, 0.5, 0.5
    drive(world, 0.1)
    (event,) = world.events[0]
    assert (event.name, event.actor) == ("collision_pedestrian", "pedestrian 1")
    assert event.fault == fault


@pytest.mark.parametrize(("away_s", "count"), [(0.5, 1), (1.9, 1), (2.1, 2), (5.0, 2)])
def test_touching_again_within_2_s_is_still_the_same_collision(beside, drive, away_s, count):
    world = beside(64.0)
    drive(world, 3.0)
    assert len(world.events[0]) == 1
    world.state.vehicles[0, 1, 0] = 80.0
    drive(world, away_s)
    world.state.vehicles[0, 1, 0] = 64.0
    drive(world, 3.0)
    assert [event.name for event in world.events[0]] == ["collision_vehicle"] * count


def test_the_2_s_begin_with_the_last_contact(beside, drive):
    world = beside(64.0)
    for _ in range(4):
        world.state.vehicles[0, 1, 0] = 64.0
        drive(world, 0.1)
        world.state.vehicles[0, 1, 0] = 80.0
        drive(world, 1.5)
    assert len(world.events[0]) == 1


def test_each_kind_of_collision_has_a_time_of_its_own(start, drive):
    world = start(traffic=TrafficConfig(vehicles=1, pedestrians=1))
    state = world.state
    state.vehicle_track[0, 0, RAIL], state.pedestrian_track[0, 0, MODE] = -1, -1
    state.vehicles[0, 0] = 24.0, 2.0, 0.0, 0.0, 4.0, 1.8
    state.pedestrians[0, 0] = 0.0
    drive(world, 0.5)
    state.pedestrians[0, 0] = 22.0, 2.0, 0.0, 0.0, 0.5, 0.5
    drive(world, 0.5)
    names = [event.name for event in world.events[0]]
    assert names == ["collision_vehicle", "collision_pedestrian"]


def test_rolling_the_last_centimetres_into_a_parked_car_is_the_egos_fault(beside, drive):
    world = beside(64.51, speed=0.4)
    drive(world, 0.1, acceleration=-1.0)
    (event,) = events(world, "collision_vehicle")
    assert world.state.ego[0, 3] == 0.0
    assert event.fault == "ego"
