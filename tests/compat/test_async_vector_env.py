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


def test_cameras_are_the_same_in_worker_processes():
    keywords = {"cameras": True, "camera_size": (32, 64), "time_limit_s": 0.3}
    make = partial(gym.make, "bev_driving_env:BEVTown01-v0", **keywords)
    seen = []
    for envs in (SyncVectorEnv([make, make]), AsyncVectorEnv([make, make], context="fork")):
        observations, _ = envs.reset(seed=3)
        steps = [observations]
        for _ in range(5):
            steps.append(envs.step(np.full((2, 2), (0.8, 0.1), np.float32))[0])
        seen.append([{key: array.copy() for key, array in step.items()} for step in steps])
        envs.close()
    for here, there in zip(*seen, strict=True):
        assert set(here) == {"bev", "measurements", "cameras", "route_map"}
        for key, array in here.items():
            np.testing.assert_array_equal(there[key], array, err_msg=key)
