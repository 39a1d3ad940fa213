"""The expert among others: behind leaders, at lines, before people, before blocked junctions."""

import gymnasium as gym
import numpy as np
import pytest

from agents import Expert
from bev_driving_env.kernels.layout import (
    NEXT_RAIL,
    RAIL,
    SIGNAL_GREEN,
    SIGNAL_RED,
    SPEED,
    STATION,
    WANTED_MPS,
)
from bev_driving_env.kernels.rails import rail_pose
from bev_driving_env.kernels.snap import write_row

HALF_M = 2.5
SMALL = {"bev": {"size": 16, "px_per_m": 1.0, "ego_row": 8}, "terminate_on": ()}


def make(**keywords):
    return gym.make("bev_driving_env:BEVTown02-v0", **SMALL, **keywords).unwrapped


def drive(env, steps, route=1, seed=0):
    """The expert's drive, step by step."""
    env.reset(seed=seed, options={"route": route})
    expert = Expert(env)
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(expert.act())
        if terminated or truncated:
            return
        yield env.world.state


def bumper_to_lines(env):
    """Metres (S,) from the front bumper to each stop line straight ahead, nan for the others."""
    x, y, heading = env.ego_pose
    lines = env.world.town.stop_lines
    middle = (lines[:, :2] + lines[:, 2:]) / 2.0 - (x, y)
    across = lines[:, 2:] - lines[:, :2]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    towards = np.column_stack([across[:, 1], -across[:, 0]]) @ (np.cos(heading), np.sin(heading))
    ahead = middle @ (np.cos(heading), np.sin(heading))
    aside = middle @ (-np.sin(heading), np.cos(heading))
    return np.where((towards > 0.9) & (np.abs(aside) < 1.5), ahead - HALF_M, np.nan)


def test_it_stops_close_before_a_red_line_and_creeps_no_further():
    env = make(traffic_lights=True)
    gaps = []
    for state in drive(env, 6000):
        if state.ego[0, SPEED] < 0.05:
            distance = bumper_to_lines(env)
            near = np.abs(distance) < 4.0
            red = near & (state.signals[0] == SIGNAL_RED)
            gaps += distance[red].tolist()
    assert len(gaps) > 300
    assert min(gaps) >= 0.0
    assert max(gaps) < 1.6
    assert env.world.success[0]
    assert not env.world.events[0]


def test_it_follows_a_slow_leader_at_a_distance_and_without_a_collision():
    env = make(traffic={"vehicles": 1})
    env.reset(seed=0, options={"route": 0})
    state = env.world.state
    rails = env.world.town.traffic().network.tables
    rail = int(state.route_rails[0, 0])
    station = -state.route_rail_m[0, 0] + 25.0
    state.vehicle_track[0, 0, RAIL], state.vehicle_motion[0, 0, STATION] = rail, station
    state.vehicle_track[0, 0, NEXT_RAIL] = state.route_rails[0, 1]
    state.vehicle_motion[0, 0, WANTED_MPS] = 2.0
    write_row(state.vehicles[0, 0], *rail_pose(rails, rail, station), 2.0)
    expert, gaps, speeds = Expert(env), [], []
    for _ in range(150):
        env.step(expert.act())
        gaps.append(np.hypot(*(state.vehicles[0, 0, :2] - state.ego[0, :2])))
        speeds.append(state.ego[0, SPEED])
    assert min(gaps) > 8.0
    assert np.mean(speeds[100:]) == pytest.approx(2.0, abs=0.2)


def test_it_waits_for_people_on_a_crossing_and_then_goes_on():
    env = make(traffic={"pedestrians": 150})
    waited, hit = 0, []
    for state in drive(env, 4000):
        waited += bool(state.waiting[0]) and state.ego[0, SPEED] < 0.1
        hit += [event for event in env.world.events[0] if event.name == "collision_pedestrian"]
    assert waited > 20
    assert not hit
    assert env.world.success[0]


def test_at_green_it_waits_in_front_of_a_junction_that_is_not_free():
    env = make(traffic={"vehicles": 1}, traffic_lights=True)
    env.reset(seed=0, options={"route": 1})
    state = env.world.state
    rails = env.world.town.traffic().network.tables
    exit_rail = int(state.route_rails[0, 2])
    expert = Expert(env)
    fronts = []
    for _ in range(600):
        # somebody stands just behind the junction, whatever the signal shows
        state.vehicle_track[0, 0, RAIL], state.vehicle_motion[0, 0, STATION] = exit_rail, 4.0
        state.vehicle_motion[0, 0, WANTED_MPS] = 0.0
        write_row(state.vehicles[0, 0], *rail_pose(rails, exit_rail, 4.0), 0.0)
        env.step(expert.act())
        distance = bumper_to_lines(env)[rails.signal[int(state.route_rails[0, 0])]]
        green = state.signals[0, rails.signal[int(state.route_rails[0, 0])]] == SIGNAL_GREEN
        if green:
            fronts.append(distance)
    assert len(fronts) > 90
    assert 0.0 <= np.nanmin(fronts) < 2.0
    assert not np.isnan(fronts).any()


def test_without_anybody_it_drives_as_it_does_in_an_empty_town():
    empty, lonely = make(), make(traffic={"vehicles": 1})
    lonely.reset(seed=0)
    actions = []
    for env in (empty, lonely):
        env.reset(seed=0, options={"route": 0})
        env.world.state.vehicles[:] = 0.0
        expert = Expert(env)
        taken = []
        for _ in range(200):
            taken.append(expert.act())
            env.step(taken[-1])
        actions.append(np.array(taken))
    # it brakes for curves alike; only on the way up to speed the model is gentler
    assert np.abs(actions[0][50:] - actions[1][50:]).max() < 0.25
