"""``reset(options=...)``: every form, and what a wrong one is told."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork

import bev_driving_env
from bev_driving_env.towns import registry


@pytest.fixture(scope="module")
def env():
    return gym.make("BEVTown01-v0").unwrapped


@pytest.fixture
def towns(monkeypatch):
    """Forget towns and ids registered by a test."""
    monkeypatch.setattr(registry, "_towns", dict(registry._towns))
    known = set(gym.registry)
    yield
    for env_id in set(gym.registry) - known:
        del gym.registry[env_id]


def route_of(env):
    return env.route.points


@pytest.mark.parametrize("options", [None, {}])
def test_without_options_start_and_route_come_from_the_seed(env, options):
    _, info = env.reset(seed=1, options=options)
    first = route_of(env)
    assert info["episode_id"] == "Town01/random"
    env.reset(seed=2, options=options)
    assert not np.array_equal(route_of(env)[0], first[0])
    env.reset(seed=1, options=options)
    np.testing.assert_array_equal(route_of(env), first)


def test_without_a_seed_every_reset_draws_another_route(env):
    env.reset(seed=1)
    starts = []
    for _ in range(4):
        env.reset()
        starts.append(tuple(route_of(env)[0]))
    assert len(set(starts)) == 4


@pytest.mark.parametrize(
    ("options", "episode_id"),
    [
        ({"episode": 0}, "Town01/episode/0"),
        ({"episode": 4}, "Town01/episode/4"),
        ({"episode": np.int64(2)}, "Town01/episode/2"),
        ({"route": 9}, "Town01/route/9"),
        ({"split": "val", "index": 49}, "Town01/val/49"),
        ({"split": "test", "index": 0}, "Town01/test/0"),
    ],
)
def test_a_fixed_route_is_the_same_for_every_seed(env, options, episode_id):
    _, info = env.reset(seed=1, options=options)
    first = route_of(env)
    assert info["episode_id"] == episode_id
    env.reset(seed=2, options=options)
    np.testing.assert_array_equal(route_of(env), first)


def test_the_car_stands_at_the_start_of_its_route(env):
    for seed in range(5):
        observation, info = env.reset(seed=seed)
        x, y, heading = env.ego_pose
        np.testing.assert_allclose([x, y], route_of(env)[0, :2])
        np.testing.assert_allclose([np.cos(heading), np.sin(heading)], route_of(env)[0, 2:])
        assert observation["measurements"][0] == 0.0
        assert info["route_m"] == 0.0
        assert info["route_length_m"] == env.route.length_m
        assert info["lateral_error_m"] == pytest.approx(0.0)
        assert info["infractions"] == []


def test_start_and_goal_plan_a_route_between_them(env):
    _, info = env.reset(options={"start": (140.0, 195.15), "goal": (88.4, 251.01)})
    assert info["episode_id"] == "Town01/planned"
    points = route_of(env)
    np.testing.assert_allclose(points[0, :2], [140.0, 195.15], atol=0.1)
    np.testing.assert_allclose(points[-1, :2], [88.4, 251.01], atol=0.1)
    # the shortest way is evaluation episode 0, one left turn
    env.reset(options={"episode": 0})
    assert info["route_length_m"] == pytest.approx(env.route.length_m, abs=0.2)


@pytest.mark.parametrize("heading", [0.0, np.pi])
def test_a_heading_picks_the_lane_that_runs_that_way(env, heading):
    env.reset(options={"start": (220.0, 197.15, heading), "goal": (88.4, 251.01)})
    assert abs(np.cos(env.ego_pose[2] - heading)) == pytest.approx(1.0)
    assert np.cos(env.ego_pose[2] - heading) > 0.0


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"episode": 5}, r"episode 5 .*'Town01' has episode 0 to 4"),
        ({"episode": -1}, r"episode -1 .*0 to 4"),
        ({"episode": "two"}, r"episode 'two' .*0 to 4"),
        ({"episode": 2.0}, r"episode 2\.0 .*0 to 4"),
        ({"episode": True}, r"episode True .*0 to 4"),
        ({"episode": None}, r"episode None .*0 to 4"),
        ({"route": 10}, r"route 10 .*0 to 9"),
        ({"split": "val", "index": 50}, r"val 50 .*0 to 49"),
        ({"split": "train", "index": 0}, r"'train'.*val, test"),
        ({"split": ["val"], "index": 0}, r"\['val'\].*val, test"),
        ({"split": "val"}, r"\{'split': 'val'\}.*\"index\": k"),
        ({"index": 3}, r"\{'index': 3\}.*\"split\""),
        ({"epsiode": 1}, r"'epsiode'.*\"episode\": k"),
        ({"episode": 1, "route": 1}, r"'episode': 1, 'route': 1"),
        ({"start": (0.0, 0.0)}, r"'start'.*\"goal\""),
        ({"start": (0.0, 0.0), "goal": (1.0,)}, r"goal must be .*\(1\.0,\)"),
        ({"start": (np.nan, 0.0), "goal": (0.0, 99.0)}, r"start must be .*nan"),
        ({"start": ("a", 0.0), "goal": (0.0, 99.0)}, r"start must be .*'a'"),
        ({"start": (5e3, 0.0), "goal": (0.0, 99.0)}, r"start .*more than 10 m .*Town01"),
    ],
)
def test_bad_options_are_refused_with_what_came_and_what_is_valid(env, options, named):
    with pytest.raises(ValueError, match=named):
        env.reset(seed=0, options=options)


def test_refused_options_leave_the_running_episode_alone(env):
    env.reset(seed=0, options={"episode": 1})
    for _ in range(3):
        env.step([0.4, 0.0])
    pose = env.ego_pose
    with pytest.raises(ValueError, match="out of range"):
        env.reset(options={"episode": 99})
    assert env.ego_pose == pose
    assert env.step([0.0, 0.0])[4]["episode_id"] == "Town01/episode/1"


def ring_of_straights(closed):
    corners = {"a": (0.0, 0.0), "b": (200.0, 0.0), "c": (200.0, 120.0), "d": (0.0, 120.0)}
    network = RoadNetwork()
    names = "abcda" if closed else "abcd"
    for start, end in pairwise(names):
        network.add_lane(start, end, StraightLane(corners[start], corners[end]))
    return network


def test_a_road_network_with_a_dead_end_is_refused_by_name_when_made(towns):
    env_id = bev_driving_env.register_town("Cul_de_sac", lambda: ring_of_straights(closed=False))
    with pytest.raises(ValueError, match=r"'Cul_de_sac' has a dead end at node 'd'"):
        gym.make(env_id)


def test_a_town_of_ones_own_can_be_driven_and_has_no_fixed_routes(towns):
    env_id = bev_driving_env.register_town("Ring", lambda: ring_of_straights(closed=True))
    assert env_id == "BEVRing-v0"
    env = gym.make(env_id)
    _, info = env.reset(seed=0)
    assert info["episode_id"] == "Ring/random"
    assert env.step([0.5, 0.0])[4]["infractions"] == []
    with pytest.raises(ValueError, match=r"'Ring' has no 'episode' routes"):
        env.reset(options={"episode": 0})
