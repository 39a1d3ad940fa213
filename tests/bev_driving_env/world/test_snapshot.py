import dataclasses

import numpy as np
import pytest

from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.towns.route import random_route
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World

WORLDS = 3


def new_world(name="Town02", worlds=WORLDS):
    town = compiled_town(name)
    world = World(town, WorldConfig(), worlds)
    for k in range(worlds):
        world.rngs[k] = np.random.default_rng(k)
        world.place(k, random_route(town, world.rngs[k], 80.0, 300.0), f"{name}/{k}")
    return world


def random_actions(steps, worlds=WORLDS, seed=0):
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, worlds, 2))
    return actions * [1.0, 0.3] + [0.3, 0.0]


def play(world, actions):
    """Drive; return everything that can be told about every step."""
    told = []
    for action in actions:
        world.step(np.clip(action, -1.0, 1.0))
        draws = [rng.uniform() for rng in world.rngs]
        told.append([*outputs(world), np.array(draws)])
    bev = np.empty((len(world), *world.bev_shape), np.uint8)
    world.render(bev)
    return told, bev, tuple(world.events)


def outputs(world):
    state = [getattr(world.state, item.name).copy() for item in dataclasses.fields(world.state)]
    return [*state, world.began.copy(), world.success.copy(), world.rewards.copy()]


def assert_same(first, second):
    for step, again in zip(first[0], second[0], strict=True):
        for array, other in zip(step, again, strict=True):
            assert array.tobytes() == other.tobytes()
    assert first[1].tobytes() == second[1].tobytes()
    assert first[2] == second[2]


def test_after_restoring_200_random_steps_are_bit_equal():
    world = new_world()
    play(world, random_actions(50, seed=1))
    snapshot = world.snapshot()
    first = play(world, random_actions(200))
    assert any(first[2])  # the random drive left the road: events must come back too
    world.restore(snapshot)
    assert_same(play(world, random_actions(200)), first)
    world.restore(snapshot)  # a snapshot is not used up
    assert_same(play(world, random_actions(200)), first)


def test_a_snapshot_continues_in_another_world_of_the_same_town():
    world, other = new_world(), new_world()
    play(world, random_actions(30, seed=1))
    snapshot = world.snapshot()
    play(other, random_actions(7, seed=2))
    other.restore(snapshot)
    assert_same(play(other, random_actions(40)), play(world, random_actions(40)))
    assert other.episode_ids == world.episode_ids
    assert other.routes == world.routes


def test_restoring_goes_back_to_another_episode():
    world = new_world(worlds=1)
    snapshot = world.snapshot()
    pose, route = world.state.ego[0].copy(), world.routes[0]
    world.place(0, random_route(world.town, world.rngs[0], 350.0, 400.0), "other")
    world.restore(snapshot)
    assert world.state.ego[0].tolist() == pose.tolist()
    assert world.routes[0] is route
    assert world.episode_ids == ["Town02/0"]


def test_restoring_forgets_the_last_steps_reward_and_infractions():
    world = new_world(worlds=1)
    snapshot = world.snapshot()
    world.state.ego[0, :2] += 500.0
    world.step(np.ones((1, 2)))
    assert world.began[0]
    assert world.rewards[0] < 0.0
    world.restore(snapshot)
    assert not world.began[0]
    assert world.rewards[0] == 0.0
    assert not world.terminated()[0]


def test_a_snapshot_of_another_number_of_worlds_is_refused():
    with pytest.raises(ValueError, match="holds 2 worlds, this environment 1"):
        new_world(worlds=1).restore(new_world(worlds=2).snapshot())


def test_a_snapshot_of_another_town_is_refused():
    with pytest.raises(ValueError, match="taken in Town01, this environment is Town02"):
        new_world("Town02").restore(new_world("Town01").snapshot())
