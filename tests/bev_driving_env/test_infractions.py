"""Scripted drives: each has exactly one infraction, of the right name, at the right metre."""

import dataclasses
import math
import uuid

import numpy as np
import pytest

from bev_driving_env import BEVTownEnv, BEVTownVectorEnv, register_town
from bev_driving_env.kernels.layout import (
    AFTER_RAIL,
    HEADING,
    LAST_RAIL,
    NEXT_RAIL,
    RAIL,
    SIGNAL_GREEN,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
    STATION,
    X,
)
from bev_driving_env.kernels.signals import show_signals
from bev_driving_env.kernels.walks import (
    ALONG_M,
    CROSSING,
    DIRECTION,
    HESITATE_S,
    MODE,
    ON_CROSSING,
)
from bev_driving_env.towns.build import build_grid_town
from bev_driving_env.towns.grid import GridTown
from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.towns.solids import index_solids
from bev_driving_env.world.config import Rules, WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import TrafficConfig

HALF_LENGTH_M = 2.5
STEP_S = 0.1
ANYWHERE = Rules(deviation_m=30.0)
WESTERN_SIGNAL = 2
LINE_X = 40.0
"""Stop line of the ladder's western approach to its junction B1; the road runs along y = 2."""


def begin(town, start, turns, end, *, speed=0.0, heading=0.0, rules=ANYWHERE, **traffic):
    """A world of one car at the start of a route that leads east."""
    config = WorldConfig(terminate_on=(), rules=rules, traffic=TrafficConfig(**traffic))
    world = World(town, config)
    world.rngs[0] = np.random.default_rng(0)
    world.place(0, route_by_turns(town, start, turns, end))
    world.state.ego[0, HEADING:] = heading, speed
    return world


def drive(world, seconds, acceleration=0.0):
    for _ in range(round(seconds / STEP_S)):
        world.step(np.array([[acceleration, 0.0]]))


def until_it_happens(world):
    """Coast until the first infraction, at most a minute; returns it."""
    for _ in range(600):
        world.step(np.zeros((1, 2)))
        if world.events[0]:
            (event,) = world.events[0]
            return event
    raise AssertionError("nothing happened")


def stop_and_wait(world):
    """Brake to a stop, and stand for 10 s."""
    drive(world, 10.0, acceleration=-1.0)
    assert world.state.ego[0, SPEED] == 0.0


def step_end_m(distance_m, speed):
    """Metres driven at the end of the control step in which a distance is covered."""
    return math.ceil(distance_m / (speed * STEP_S)) * speed * STEP_S


def stand_at_line(world, number, *, front_m=1.0, length_m=4.5):
    """Put a vehicle at rest before the end of the ego's rail, where it waits for the signal."""
    state = world.state
    tables = world.town.traffic().network.tables
    rail = state.route_rails[0, 0]
    station = tables.length[rail] - front_m - length_m / 2.0
    state.vehicles[0, number] = LINE_X - front_m - length_m / 2.0, 2.0, 0.0, 0.0, length_m, 1.9
    state.vehicle_track[0, number] = 0
    state.vehicle_track[0, number, [RAIL, NEXT_RAIL, AFTER_RAIL]] = state.route_rails[0, :3]
    state.vehicle_track[0, number, LAST_RAIL] = -1
    state.vehicle_motion[0, number] = 0.0
    state.vehicle_motion[0, number, STATION] = station


def stand_on_crossing(state, n, number):
    """Put a pedestrian who hesitates for ever on the first crossing of the ladder, at y = 2."""
    state.pedestrians[n, number] = 41.3, 2.0, 0.0, 0.0, 0.5, 0.5
    state.pedestrian_track[n, number] = 0
    state.pedestrian_track[n, number, [DIRECTION, MODE, CROSSING]] = 1, ON_CROSSING, 0
    state.pedestrian_motion[n, number] = 0.0
    # the crossing runs north from the southern kerb at y = 4.3
    state.pedestrian_motion[n, number, [ALONG_M, HESITATE_S]] = 2.3, 1e9


def seed_showing(town, light, seconds):
    """An episode seed with which the western signal shows a light throughout some seconds."""
    plan, shown = town.traffic().plan, np.zeros(len(town.signals), np.uint8)
    for seed in range(2000):
        lights = set()
        for time_s in np.arange(*seconds, STEP_S):
            show_signals(plan, time_s, seed, shown)
            lights.add(int(shown[WESTERN_SIGNAL]))
        if lights == {light}:
            return seed
    raise AssertionError("no such seed")


def test_straight_on_at_a_corner_is_off_road_where_the_pavement_ends(ring):
    world = begin(ring, (170.1, 2.0), "", (198.0, 40.0), speed=6.0)
    # the corner's pavement is a quarter disc of radius 14.3 m about (190, 10)
    ahead, right = np.meshgrid(np.linspace(-2.475, 2.475, 100), np.linspace(-0.99, 0.99, 100))
    x = 195.0
    while (np.hypot(x + ahead - 190.0, 2.0 + right - 10.0) > 14.3).mean() < 0.25:
        x += 0.01
    event = until_it_happens(world)
    assert (event.name, event.actor, event.fault) == ("off_road", "", "ego")
    assert event.x == pytest.approx(170.1 + step_end_m(x - 170.1, 6.0), abs=0.61)
    # the route bends about the same point, with a radius of 8 m
    assert event.route_m == pytest.approx(19.9 + 8.0 * math.atan2(event.x - 190.0, 8.0), abs=0.1)
    assert event.time_s == pytest.approx((event.x - 170.1) / 6.0)
    stop_and_wait(world)
    assert world.events[0] == (event,)


def test_drifting_over_the_center_line_is_wrong_lane_a_second_later(ring):
    world = begin(ring, (20.0, 2.0), "", (180.0, 2.0), speed=5.0, heading=-0.3)
    event = until_it_happens(world)
    crossed_s = 2.0 / (5.0 * math.sin(0.3))
    # the rules see lanes in pixels of 0.2 m, which the car drifts across in 0.14 s
    assert event.name == "wrong_lane"
    assert crossed_s + 0.85 < event.time_s < crossed_s + 1.35
    assert event.route_m == pytest.approx(5.0 * math.cos(0.3) * event.time_s, abs=1e-6)
    assert (event.y, event.heading) == pytest.approx((2.0 - 1.4776 * event.time_s, -0.3), abs=1e-3)
    assert (event.actor, event.fault) == ("", "ego")
    stop_and_wait(world)
    assert world.events[0] == (event,)


def test_straight_on_where_the_route_turns_off_is_a_deviation(ladder):
    world = begin(ladder, (20.0, 2.0), "B1R", (48.0, 20.0), speed=5.0, rules=Rules())
    event = until_it_happens(world)
    # the right turn has radius 6 m about (42, 8); 3.5 m off its arc is 9.5 m from there
    x = 20.0 + step_end_m(22.0 + math.sqrt(9.5**2 - 6.0**2), 5.0)
    assert event.name == "route_deviation"
    assert event.x == pytest.approx(x)
    # seen from beside a bend, its polygon of 0.5 m steps is up to 0.1 m off
    assert event.route_m == pytest.approx(22.0 + 6.0 * math.atan2(x - 42.0, 6.0), abs=0.1)
    drive(world, 5.0)
    stop_and_wait(world)
    assert world.state.ego[0, X] > 70.0
    assert world.events[0] == (event,)


def test_through_a_red_light_is_one_event_of_that_signal_at_its_line(ladder):
    world = begin(ladder, (20.2, 2.0), "B1S", (90.0, 2.0), speed=5.0, lights=True)
    world.state.episode_seed[0] = seed_showing(ladder, SIGNAL_RED, (3.0, 4.0))
    event = until_it_happens(world)
    driven_m = step_end_m(LINE_X - HALF_LENGTH_M - 20.2, 5.0)
    assert (event.name, event.actor, event.fault) == ("red_light", "signal 2", "ego")
    assert event.route_m == pytest.approx(driven_m)
    assert event.time_s == pytest.approx(driven_m / 5.0)
    assert (event.x, event.y, event.speed_mps) == pytest.approx((20.2 + driven_m, 2.0, 5.0))
    drive(world, 8.0)
    stop_and_wait(world)
    assert world.state.ego[0, X] > 75.0
    assert world.events[0] == (event,)


@pytest.mark.parametrize("light", [SIGNAL_GREEN, SIGNAL_YELLOW])
def test_driving_on_at_green_or_yellow_is_none(ladder, light):
    world = begin(ladder, (20.2, 2.0), "B1S", (90.0, 2.0), speed=5.0, lights=True)
    world.state.episode_seed[0] = seed_showing(ladder, light, (3.0, 4.0))
    drive(world, 11.0)
    assert world.state.ego[0, X] > 75.0
    assert world.events[0] == ()


def test_stopping_at_a_red_light_and_driving_on_at_green_is_none(ladder):
    world = begin(ladder, (20.2, 2.0), "B1S", (90.0, 2.0), speed=5.0, vehicles=1)
    world.state.vehicles[0] = 0.0
    world.state.signals[0, WESTERN_SIGNAL] = SIGNAL_RED
    drive(world, 2.9)
    drive(world, 60.0, acceleration=-1.0)
    assert 0.0 < LINE_X - HALF_LENGTH_M - world.state.ego[0, X] < 1.0
    world.state.signals[0, WESTERN_SIGNAL] = SIGNAL_GREEN
    drive(world, 1.0, acceleration=1.0)
    drive(world, 5.0)
    assert world.state.ego[0, X] > 60.0
    assert world.events[0] == ()


def test_into_a_car_that_waits_is_one_collision_where_its_rear_is(ladder):
    world = begin(ladder, (12.2, 2.0), "B1S", (90.0, 2.0), speed=5.0, vehicles=1)
    world.state.signals[0, WESTERN_SIGNAL] = SIGNAL_RED
    stand_at_line(world, 0)
    rear_x = LINE_X - 1.0 - 4.5
    event = until_it_happens(world)
    driven_m = step_end_m(rear_x - HALF_LENGTH_M - 12.2, 5.0)
    assert (event.name, event.actor, event.fault) == ("collision_vehicle", "vehicle 0", "ego")
    assert event.route_m == pytest.approx(driven_m)
    assert (event.time_s, event.speed_mps) == pytest.approx((driven_m / 5.0, 5.0))
    stop_and_wait(world)
    assert world.events[0] == (event,)
    assert world.state.vehicles[0, 0, X] == pytest.approx(rear_x + 2.25, abs=1e-3)


def test_into_a_pedestrian_is_one_collision_where_he_stands(ladder):
    world = begin(ladder, (20.2, 2.0), "B1S", (90.0, 2.0), speed=5.0, pedestrians=3)
    world.state.pedestrians[0] = 0.0
    stand_on_crossing(world.state, 0, 2)
    event = until_it_happens(world)
    driven_m = step_end_m(41.3 - 0.25 - HALF_LENGTH_M - 20.2, 5.0)
    assert (event.name, event.fault) == ("collision_pedestrian", "ego")
    assert event.actor == "pedestrian 2"
    assert event.route_m == pytest.approx(driven_m)
    assert event.time_s == pytest.approx(driven_m / 5.0)
    stop_and_wait(world)
    assert world.events[0] == (event,)


def test_into_a_house_is_one_collision_at_its_wall(ring):
    house = index_solids([[100.0, 0.0, 0.0, 6.0, 8.0]])
    town = dataclasses.replace(ring, _solids={False: house}, _traffic={})
    world = begin(town, (80.2, 2.0), "", (180.0, 2.0), speed=5.0)
    event = until_it_happens(world)
    driven_m = step_end_m(97.0 - HALF_LENGTH_M - 80.2, 5.0)
    assert (event.name, event.actor, event.fault) == ("collision_static", "", "ego")
    assert event.route_m == pytest.approx(driven_m)
    assert event.time_s == pytest.approx(driven_m / 5.0)
    stop_and_wait(world)
    assert world.events[0] == (event,)


@pytest.mark.parametrize("traffic", [{}, {"vehicles": 1, "pedestrians": 1}])
def test_standing_still_in_the_road_is_blocked_after_30_s(ring, traffic):
    world = begin(ring, (20.0, 2.0), "", (180.0, 2.0), **traffic)
    if traffic:
        # far away, on the southern road
        world.state.vehicles[0], world.state.pedestrians[0] = 0.0, 0.0
    event = until_it_happens(world)
    assert (event.name, event.actor, event.fault) == ("blocked", "", "ego")
    # 30 s is not yet more than 30 s; the next tick is part of the step that ends at 30.1
    assert event.time_s == pytest.approx(30.1)
    assert (event.x, event.speed_mps, event.route_m) == pytest.approx((20.0, 0.0, 0.0))
    drive(world, 40.0)
    assert world.events[0] == (event,)


# the same in the environments

TABLE = GridTown(
    columns={"A": 0.0, "B": 50.0, "C": 100.0},
    rows={"1": 0.0, "2": 40.0},
    links="A1-B1 B1-C1 A2-B2 B2-C2 A1-A2 B1-B2 C1-C2",
    junctions="""
        B1 8  E 10 62,-4  S 10 54,12  W 10 38,4
        B2 8  N 10 46,28  E 10 62,36  W 10 38,44
    """,
    corners="A1 9  C1 9  C2 9  A2 9",
)
WAY = {"start": (20.2, 2.0, 0.0), "goal": (90.0, 2.0, 0.0)}
SCENES = {
    "red_light": ("signal 2", LINE_X - HALF_LENGTH_M - 20.2),
    "collision_vehicle": ("vehicle 0", 30.0 - HALF_LENGTH_M - 20.2),
    "collision_pedestrian": ("pedestrian 0", 41.3 - 0.25 - HALF_LENGTH_M - 20.2),
    "blocked": ("", 0.0),
}


@pytest.fixture(scope="module")
def keywords():
    name = f"Ladder_{uuid.uuid4().hex[:8]}"
    register_town(name, lambda: build_grid_town(TABLE))
    return {
        "town": name,
        "traffic": {"vehicles": 1, "pedestrians": 1},
        "rules": {"blocked_s": 4.0},
    }


def set_scene(state, n, name):
    """Put what a scene needs into a world, and nothing else; its car drives at 5 m/s."""
    state.vehicles[n], state.pedestrians[n], state.signals[n] = 0.0, 0.0, SIGNAL_GREEN
    state.ego[n, SPEED] = 0.0 if name == "blocked" else 5.0
    if name == "red_light":
        state.signals[n, WESTERN_SIGNAL] = SIGNAL_RED
    if name == "collision_vehicle":
        # off the rails nothing moves it
        state.vehicle_track[n, 0, RAIL] = -1
        state.vehicles[n, 0] = 32.0, 2.0, 0.0, 0.0, 4.0, 1.8
    if name == "collision_pedestrian":
        stand_on_crossing(state, n, 0)


def expected_s(name):
    return 4.1 if name == "blocked" else step_end_m(SCENES[name][1], 5.0) / 5.0


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("ends", [True, False])
def test_the_environment_reports_it_and_ends_if_it_is_asked_to(keywords, name, ends):
    others = tuple(set(SCENES) - {name})
    env = BEVTownEnv(terminate_on=(name,) if ends else others, **keywords)
    env.reset(seed=0, options=WAY)
    set_scene(env.world.state, 0, name)
    steps = round(expected_s(name) / STEP_S)
    for k in range(1, steps + 1):
        *_, terminated, truncated, info = env.step([0.0, 0.0])
        assert info["infractions"] == ([name] if k == steps else [])
        assert terminated == (ends and k == steps)
        assert not truncated
    assert info["reward_terms"]["infractions"] == -10.0
    if ends:
        (event,) = info["episode_summary"]["infractions"]
        assert (event["name"], event["actor"], event["fault"]) == (name, SCENES[name][0], "ego")
        assert event["route_m"] == pytest.approx(step_end_m(SCENES[name][1], 5.0))
        assert info["episode_summary"]["outside_m"] == 0.0


@pytest.mark.parametrize("name", SCENES)
def test_the_vector_environment_ends_only_the_world_it_happens_in(keywords, name):
    envs = BEVTownVectorEnv(2, terminate_on=(name,), **keywords)
    envs.reset(seed=0, options=WAY)
    set_scene(envs.world.state, 0, "none")
    envs.world.state.ego[0, SPEED] = 2.0
    set_scene(envs.world.state, 1, name)
    steps = round(expected_s(name) / STEP_S)
    for k in range(1, steps + 1):
        _, _, terminations, _, infos = envs.step(np.zeros((2, 2), np.float32))
        assert list(infos["infractions"]) == [[], [name] if k == steps else []]
        assert terminations.tolist() == [False, k == steps]
    events = envs.world.events
    assert events[0] == ()
    assert [(event.name, event.actor) for event in events[1]] == [(name, SCENES[name][0])]
    (summary,) = infos["episode_summary"]["infractions"][infos["_episode_summary"]]
    assert summary == [dataclasses.asdict(events[1][0])]
