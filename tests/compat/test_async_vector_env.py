"""Worker processes, however they are started."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

MAKE = partial(gym.make, "bev_driving_env:BEVTown01-v0", time_limit_s=0.5)


def rollout(envs):
    try:
        observations, infos = envs.reset(seed=11)
        seen = [(observations, infos)]
        rng = np.random.default_rng(0)
        for _ in range(12):
            actions = rng.uniform(-1.0, 1.0, (2, 2)).astype(np.float32)
            observations, rewards, terminations, truncations, infos = envs.step(actions)
            seen.append((observations, rewards, terminations, truncations, infos))
    finally:
        envs.close()
    return seen


@pytest.fixture(scope="module")
def expected():
    return rollout(SyncVectorEnv([MAKE, MAKE]))


def test_the_rollout_compared_below_has_episode_ends(expected):
    assert np.sum([step[3] for step in expected[1:]]) == 4


@pytest.mark.parametrize("context", ["fork", "spawn", "forkserver"])
def test_worker_processes_give_the_same_numbers_as_this_process(context, expected):
    seen = rollout(AsyncVectorEnv([MAKE, MAKE], context=context))
    for (observations, *numbers, infos), (wanted, *wanted_numbers, wanted_infos) in zip(
        seen, expected, strict=True
    ):
        np.testing.assert_array_equal(observations["bev"], wanted["bev"])
        np.testing.assert_array_equal(observations["measurements"], wanted["measurements"])
        for number, wanted_number in zip(numbers, wanted_numbers, strict=True):
            np.testing.assert_array_equal(number, wanted_number)
        np.testing.assert_array_equal(infos["route_m"], wanted_infos["route_m"])
        assert infos["episode_id"].tolist() == wanted_infos["episode_id"].tolist()
