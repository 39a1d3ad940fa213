"""``BEVOnly``."""

import gymnasium as gym
import numpy as np
import pytest

from bev_driving_env import BEVOnly


def test_it_keeps_the_bev_and_nothing_else():
    env, plain = BEVOnly(gym.make("BEVTown01-v0")), gym.make("BEVTown01-v0")
    assert env.observation_space == gym.spaces.Box(0, 255, (6, 192, 192), np.uint8)
    observation, info = env.reset(seed=0)
    expected, expected_info = plain.reset(seed=0)
    np.testing.assert_array_equal(observation, expected["bev"])
    assert info == expected_info
    observation, *rest = env.step([0.5, 0.1])
    expected, *expected_rest = plain.step([0.5, 0.1])
    np.testing.assert_array_equal(observation, expected["bev"])
    assert rest == expected_rest
    assert observation in env.observation_space


def test_the_environment_inside_stays_reachable():
    env = BEVOnly(gym.make("BEVTown01-v0"))
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(env.unwrapped.ground_truth_bev(), observation)


def test_an_environment_without_a_bev_is_refused_with_what_it_has():
    with pytest.raises(ValueError, match=r"'bev'.*Box"):
        BEVOnly(gym.make("CartPole-v1"))
    with pytest.raises(ValueError, match=r"'bev'.*Box"):
        BEVOnly(BEVOnly(gym.make("BEVTown01-v0")))
