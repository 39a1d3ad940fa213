"""The expert completes every fixed route without an infraction."""

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env
from agents import Expert

TOWNS = ("Town01", "Town02")
PAPER_TOTAL_M = {"Town01": 598.0, "Town02": 604.0}


@pytest.fixture(scope="module", params=TOWNS)
def env(request):
    # a small view: the expert does not look at it
    bev = {"size": 16, "px_per_m": 1.0, "ego_row": 8}
    return gym.make(f"BEV{request.param}-v0", bev=bev)


def drive(env, expert, options):
    """Drive an episode to its end and return its summary and all speeds."""
    expert.reset(0)
    observation, _ = env.reset(seed=0, options=options)
    speeds = []
    while True:
        action = expert.act(observation)
        assert action in env.action_space
        observation, _, terminated, truncated, info = env.step(action)
        speeds.append(float(observation["measurements"][0]))
        if terminated or truncated:
            return info["episode_summary"], np.array(speeds)


def assert_clean(summary):
    assert summary["infractions"] == []
    assert summary["success"], summary


def test_it_drives_the_five_evaluation_episodes_cleanly_and_they_sum_to_the_papers_metres(env):
    expert = Expert(env)
    length = 0.0
    for k in range(5):
        summary, speeds = drive(env, expert, {"episode": k})
        assert_clean(summary)
        assert speeds.max() < 6.1
        length += summary["route_length_m"]
    town = env.unwrapped.world.town.name
    assert length == pytest.approx(PAPER_TOTAL_M[town], rel=0.02)


def test_it_drives_the_ten_long_routes_cleanly(env):
    expert = Expert(env)
    for k in range(10):
        assert_clean(drive(env, expert, {"route": k})[0])


@pytest.mark.parametrize("split", ["val", "test"])
def test_it_drives_every_fifth_route_of_the_splits_cleanly(env, split):
    expert = Expert(env)
    for k in range(0, 50, 5):
        assert_clean(drive(env, expert, {"split": split, "index": k})[0])


@pytest.mark.parametrize("max_speed_mps", [3.0, 9.0])
@pytest.mark.parametrize("town", TOWNS)
def test_another_cruising_speed_is_kept_to_and_stays_clean(town, max_speed_mps):
    env = gym.make(f"BEV{town}-v0", max_speed_mps=max_speed_mps)
    expert = Expert(env)
    for k in range(5):
        summary, speeds = drive(env, expert, {"episode": k})
        assert_clean(summary)
        assert speeds.max() < max_speed_mps + 0.2
    assert speeds.max() > max_speed_mps - 1.0


def test_other_control_parameters_stay_clean(env):
    for lookahead_m, lookahead_s in ((0.3, 0.3), (1.5, 0.3)):
        expert = Expert(env, lookahead_m, lookahead_s)
        for k in range(5):
            assert_clean(drive(env, expert, {"episode": k})[0])


def test_random_routes_are_driven_cleanly(env):
    expert = Expert(env)
    env.reset(seed=5)
    for _ in range(5):
        env.reset()
        points = env.unwrapped.route.points
        pose = (*points[0, :2], np.arctan2(points[0, 3], points[0, 2]))
        goal = (*points[-1, :2], np.arctan2(points[-1, 3], points[-1, 2]))
        assert_clean(drive(env, expert, {"start": pose, "goal": goal})[0])


def test_it_is_deterministic_and_survives_a_rewind(env):
    expert = Expert(env)
    env.reset(options={"route": 0})
    for _ in range(100):
        env.step(expert.act())
    snapshot = env.unwrapped.snapshot()
    first = [tuple(env.step(expert.act())[0]["measurements"]) for _ in range(50)]
    env.reset(options={"route": 1})
    expert.act()
    env.unwrapped.restore(snapshot)
    assert [tuple(env.step(expert.act())[0]["measurements"]) for _ in range(50)] == first


def test_a_new_route_is_planned_anew_without_being_told(env):
    used, fresh = Expert(env), Expert(env)
    env.reset(options={"route": 0})
    used.act()
    env.reset(options={"route": 1})
    for _ in range(400):
        action = fresh.act()
        np.testing.assert_array_equal(used.act(), action)
        env.step(action)


def test_it_finds_its_way_back_to_the_lane_after_a_push(env):
    expert = Expert(env)
    env.reset(options={"route": 0})
    for _ in range(60):
        env.step(expert.act())
    for _ in range(6):
        env.step(np.array([0.0, 0.06], np.float32))
    for _ in range(60):
        *_, info = env.step(expert.act())
        assert info["infractions"] == []
    assert abs(info["lateral_error_m"]) < 0.3


def test_it_drives_through_wrappers():
    wrapped = bev_driving_env.BEVOnly(gym.make("BEVTown01-v0"))
    wrapped.reset(seed=0)
    assert Expert(wrapped).act() in wrapped.action_space


def test_before_reset_it_says_to_reset():
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        Expert(gym.make("BEVTown01-v0")).act()


def test_a_foreign_environment_is_refused_by_name():
    with pytest.raises(TypeError, match="BEVTownEnv, got CartPoleEnv"):
        Expert(gym.make("CartPole-v1"))
