import re
from types import MappingProxyType

import numpy as np
import pytest

from bev_driving_env.kernels.layout import LAST_RAIL, LENGTH, RAIL, STOPPED_S
from bev_driving_env.towns.build import build_grid_town
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.grid import GridTown
from bev_driving_env.towns.registry import compiled_town, route_book
from bev_driving_env.towns.route import random_route
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import (
    PRESETS,
    TOWN01_LANE_M,
    TrafficConfig,
    check_traffic,
    road_lane_m,
    traffic_config,
    traffic_room,
)

# vehicles and pedestrians of NoCrash (Codevilla et al. 2019, section 4): empty, regular, dense
NUMBERS = [
    ("none", "Town01", 0, 0),
    ("none", "Town02", 0, 0),
    ("light", "Town01", 20, 50),
    ("light", "Town02", 15, 50),
    ("dense", "Town01", 100, 250),
    ("dense", "Town02", 70, 150),
]


@pytest.mark.parametrize(("preset", "name", "vehicles", "pedestrians"), NUMBERS)
def test_presets_are_those_of_nocrash(preset, name, vehicles, pedestrians):
    config = traffic_config(preset, True, compiled_town(name))
    assert config == TrafficConfig(vehicles, pedestrians, lights=True)


def test_there_is_no_other_preset():
    assert set(PRESETS) == {preset for preset, *_ in NUMBERS}


def test_the_lanes_of_town01_are_as_long_as_is_said():
    assert road_lane_m(compiled_town("Town01")) == pytest.approx(TOWN01_LANE_M, rel=0.01)


@pytest.mark.parametrize(
    ("preset", "vehicles", "pedestrians"), [("light", 20, 50), ("dense", 100, 250)]
)
@pytest.mark.parametrize("name", ["ladder", "ring"])
def test_another_town_has_as_many_as_town01_per_metre_of_lane(
    name, preset, vehicles, pedestrians, request
):
    town = request.getfixturevalue(name)
    # both ways along all roads: the ladder's outer ring and rung less its two junctions
    lane_m = sum(lane.length_m for lane in town.lanes if not lane.in_junction)
    config = traffic_config(preset, False, town)
    assert config.vehicles == pytest.approx(vehicles * lane_m / TOWN01_LANE_M, abs=1.0)
    assert config.pedestrians == pytest.approx(pedestrians * lane_m / TOWN01_LANE_M, abs=1.0)
    assert not config.lights


def test_the_lanes_of_the_ring_are_both_ways_round(ring):
    """Straights of 180 m and 40 m, and corners of 10 m whose lanes are 2 m off the middle."""
    around = [2.0 * (180.0 + 40.0) + 2.0 * 3.14159265 * radius for radius in (8.0, 12.0)]
    assert road_lane_m(ring) == pytest.approx(sum(around), rel=1e-3)


def test_without_sidewalks_nobody_walks():
    from highway_env.road.lane import StraightLane
    from highway_env.road.road import RoadNetwork

    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [TOWN01_LANE_M / 2.0, 0.0]))
    town = compile_network("highway", network, allow_dead_ends=True)
    assert town.cross_section.sidewalk_m == 0.0
    assert traffic_config("dense", False, town) == TrafficConfig(50, 0, lights=False)


@pytest.mark.parametrize("preset", ["none", "light", "dense"])
@pytest.mark.parametrize("lights", [True, False])
def test_lights_are_as_asked_for(preset, lights, ladder):
    assert traffic_config(preset, lights, ladder).lights == lights


def test_numbers_may_be_given_by_hand_and_default_to_none(ladder):
    given = {"vehicles": 3, "pedestrians": 7}
    assert traffic_config(given, True, ladder) == TrafficConfig(3, 7, lights=True)
    assert traffic_config(MappingProxyType(given), True, ladder) == TrafficConfig(3, 7, lights=True)
    assert traffic_config({"vehicles": 3}, False, ladder) == TrafficConfig(3, 0, lights=False)
    assert traffic_config({"pedestrians": 3}, False, ladder) == TrafficConfig(0, 3, lights=False)
    assert traffic_config({}, False, ladder) == TrafficConfig()


@pytest.mark.parametrize(
    ("config", "moves"),
    [
        (TrafficConfig(), False),
        (TrafficConfig(vehicles=1), True),
        (TrafficConfig(pedestrians=1), True),
        (TrafficConfig(lights=True), True),
    ],
)
def test_only_a_town_without_traffic_and_lights_stands_still(config, moves):
    assert config.moves == moves


WRONG = [
    ("heavy", "'none', 'light', 'dense'", "'heavy'"),
    ("", "'none', 'light', 'dense'", "''"),
    (30, "keys vehicles and pedestrians", "30"),
    (None, "keys vehicles and pedestrians", "None"),
    ({"cars": 3}, "keys vehicles and pedestrians", "{'cars': 3}"),
    ({"lights": True}, "keys vehicles and pedestrians", "{'lights': True}"),
    ({"vehicles": -1}, "vehicles must be an int of at least 0", "-1"),
    ({"vehicles": 2.0}, "vehicles must be an int of at least 0", "2.0"),
    ({"vehicles": True}, "vehicles must be an int of at least 0", "True"),
    ({"pedestrians": "9"}, "pedestrians must be an int of at least 0", "'9'"),
]


@pytest.mark.parametrize(("traffic", "cure", "value"), WRONG)
def test_wrong_traffic_is_refused_in_one_line_with_its_value_and_the_cure(
    traffic, cure, value, ladder
):
    for refuse in (check_traffic, lambda wrong: traffic_config(wrong, False, ladder)):
        with pytest.raises(ValueError, match=re.escape(cure)) as error:
            refuse(traffic)
        assert str(error.value).endswith(f"got {value}")
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("traffic", ["none", "light", "dense", {}, {"vehicles": 3}])
def test_valid_traffic_is_let_through_before_any_town_is_known(traffic):
    check_traffic(traffic)


def test_lights_must_be_true_or_false(ladder):
    with pytest.raises(ValueError, match="traffic_lights must be True or False, got 1"):
        traffic_config("none", 1, ladder)


def test_in_a_small_town_a_preset_means_as_many_as_there_is_room_for():
    table = GridTown(
        columns={"A": 0.0, "B": 60.0},
        rows={"1": 0.0, "2": 40.0},
        links="A1-B1 B1-B2 A2-B2 A1-A2",
        junctions="",
        corners="A1 10  B1 10  B2 10  A2 10",
        sidewalk_m=1.2,
    )
    town = compile_network("narrow", build_grid_town(table))
    config = traffic_config("dense", False, town)
    assert config.pedestrians == 0  # nobody can walk there
    assert 0 < config.vehicles <= traffic_room(town)["vehicles"]
    World(town, WorldConfig(traffic=config))


@pytest.mark.parametrize("name", ["Town01", "Town02"])
def test_a_full_town_can_be_filled_wherever_the_ego_starts(name):
    town = compiled_town(name)
    traffic = TrafficConfig(vehicles=traffic_room(town)["vehicles"])
    world = World(town, WorldConfig(traffic=traffic))
    for seed in range(60):
        world.rngs[0] = np.random.default_rng(seed)
        world.place(0, random_route(town, world.rngs[0], 100.0, 400.0))
    assert (world.state.vehicles[0, :, LENGTH] > 0.0).all()


def test_an_ego_that_is_parked_closes_no_road():
    # whoever had to wait long is let go first; whoever just stands is not
    town = compiled_town("Town01")
    world = World(town, WorldConfig(traffic=TrafficConfig(vehicles=100)))
    world.rngs[0] = np.random.default_rng(0)
    world.place(0, route_book("Town01").route("route", 0, town))
    road, onward, beyond = world.state.route_rails[0, :3]
    tables = town.traffic().network.tables
    assert tables.movement[onward]
    assert not tables.movement[road]
    entered = set()
    for step in range(4000):
        world.step(np.zeros((1, 2)))
        track = world.state.vehicle_track[0]
        if step > 800:
            others = (track[:, RAIL] == beyond) & (track[:, LAST_RAIL] != onward)
            entered |= set(np.flatnonzero(others))
    assert world.state.timers[0, STOPPED_S] > 390.0
    assert len(entered) >= 4
