"""How episodes end: success, infractions, the time limit, and what is reported then."""

import json

import gymnasium as gym
import numpy as np
import pytest

from agents import Expert
from bev_driving_env.world.infractions import INFRACTIONS

GAS = np.array([1.0, 0.0], np.float32)
STAND = np.array([0.0, 0.0], np.float32)
SUMMARY_KEYS = {
    "episode_id",
    "route_m",
    "route_length_m",
    "success",
    "truncated",
    "steps",
    "time_s",
    "return",
    "travelled_m",
    "outside_m",
    "infractions",
}


def drive(env, policy, seed=0, options=None, most=2000):
    """All results of an episode: a list of (reward, terminated, truncated, info)."""
    observation, _ = env.reset(seed=seed, options=options)
    results = []
    while len(results) < most:
        observation, *result = env.step(policy(observation))
        results.append(tuple(result))
        if result[1] or result[2]:
            break
    return results


def straight_on(observation):
    return GAS


def standing(observation):
    return STAND


def test_success_terminates_the_episode():
    env = gym.make("BEVTown01-v0")
    results = drive(env, Expert(env).act, options={"episode": 2})
    *before, (_, terminated, truncated, info) = results
    assert terminated
    assert not truncated
    assert info["success"]
    assert info["route_m"] >= 0.99 * info["route_length_m"]
    end = env.unwrapped.route.points[-1, :2]
    assert np.hypot(*(end - env.unwrapped.ego_pose[:2])) < 10.0
    assert not any(result[3]["success"] for result in before)


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_an_infraction_terminates_the_episode_and_is_named(town):
    env = gym.make(f"BEV{town}-v0")
    *before, (_, terminated, truncated, info) = drive(env, straight_on, options={"episode": 0})
    assert terminated
    assert not truncated
    assert not info["success"]
    assert info["infractions"]
    assert set(info["infractions"]) <= set(INFRACTIONS)
    assert all(result[3]["infractions"] == [] for result in before)


def test_only_the_chosen_infractions_terminate():
    chosen = gym.make("BEVTown01-v0", terminate_on=("blocked",), time_limit_s=40.0)
    results = drive(chosen, straight_on, options={"episode": 0})
    names = [name for result in results for name in result[3]["infractions"]]
    assert {"off_road", "route_deviation"} <= set(names)
    assert "blocked" not in names
    assert not any(terminated for _, terminated, _, _ in results)
    assert results[-1][2]  # the time limit ended it
    summary = results[-1][3]["episode_summary"]
    assert [event["name"] for event in summary["infractions"]] == names


def test_standing_for_half_a_minute_is_blocked():
    env = gym.make("BEVTown01-v0", terminate_on=("blocked",))
    results = drive(env, standing, options={"episode": 0})
    assert results[-1][1]
    assert results[-1][3]["infractions"] == ["blocked"]
    assert len(results) == pytest.approx(300, abs=1)


def test_an_empty_choice_of_infractions_lets_the_episode_run_on():
    env = gym.make("BEVTown01-v0", terminate_on=(), time_limit_s=35.0)
    results = drive(env, standing)
    assert len(results) == 350
    assert results[-1][1:3] == (False, True)
    assert ["blocked"] in [result[3]["infractions"] for result in results]


def test_an_infraction_that_goes_on_is_reported_once():
    env = gym.make("BEVTown01-v0", terminate_on=(), time_limit_s=30.0)
    results = drive(env, straight_on, options={"episode": 0})
    names = [name for result in results for name in result[3]["infractions"]]
    assert names.count("route_deviation") == 1
    penalties = [result[3]["reward_terms"]["infractions"] for result in results]
    assert [p < 0.0 for p in penalties] == [bool(r[3]["infractions"]) for r in results]


def test_the_time_limit_truncates_and_does_not_terminate():
    env = gym.make("BEVTown01-v0", time_limit_s=2.0)
    results = drive(env, standing)
    assert len(results) == 20
    assert [r[1:3] for r in results] == [(False, False)] * 19 + [(False, True)]
    assert results[-1][3]["episode_summary"]["truncated"] is True


def test_termination_at_the_time_limit_is_not_truncation():
    options = {"episode": 0}
    steps = len(drive(gym.make("BEVTown01-v0"), straight_on, options=options))
    env = gym.make("BEVTown01-v0", time_limit_s=steps / 10)
    results = drive(env, straight_on, options=options)
    assert len(results) == steps
    assert results[-1][1:3] == (True, False)
    assert results[-1][3]["episode_summary"]["truncated"] is False


def test_gymnasiums_own_time_limit_truncates_too():
    env = gym.make("BEVTown01-v0", max_episode_steps=3)
    assert [r[1:3] for r in drive(env, standing)] == [(False, False)] * 2 + [(False, True)]


def test_without_a_limit_given_a_route_gets_30_s_and_0_8_s_a_metre():
    env = gym.make("BEVTown01-v0", terminate_on=())
    results = drive(env, standing, options={"episode": 2}, most=10_000)
    length = results[-1][3]["route_length_m"]
    assert len(results) / 10 == pytest.approx(30.0 + 0.8 * length, abs=0.1)


def test_the_summary_comes_at_the_end_only_and_adds_up():
    env = gym.make("BEVTown01-v0")
    results = drive(env, straight_on, options={"episode": 0})
    assert not any("episode_summary" in result[3] for result in results[:-1])
    info = results[-1][3]
    summary = info["episode_summary"]
    assert set(summary) == SUMMARY_KEYS
    assert summary["episode_id"] == info["episode_id"] == "Town01/episode/0"
    assert summary["route_m"] == info["route_m"]
    assert summary["success"] is False
    assert summary["steps"] == len(results)
    assert summary["time_s"] == pytest.approx(len(results) / 10)
    assert summary["return"] == pytest.approx(sum(result[0] for result in results))
    assert [event["name"] for event in summary["infractions"]] == info["infractions"]
    event = summary["infractions"][0]
    assert (event["x"], event["y"]) == pytest.approx(env.unwrapped.ego_pose[:2], abs=1.0)


def test_the_summary_can_be_written_as_json():
    info = drive(gym.make("BEVTown01-v0"), straight_on, options={"episode": 0})[-1][3]
    assert json.loads(json.dumps(info)) == info


def test_a_new_episode_starts_with_a_clean_record():
    env = gym.make("BEVTown01-v0")
    drive(env, straight_on)
    _, info = env.reset()
    assert info["infractions"] == []
    assert info["success"] is False
    assert env.step(STAND)[1:4] == (pytest.approx(0.0, abs=1e-9), False, False)
