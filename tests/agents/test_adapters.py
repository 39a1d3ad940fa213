"""Observations in the form that third-party policies want."""

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env
from agents.adapters import observation_adapter
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.spaces import observation_space

Box, Dict = gym.spaces.Box, gym.spaces.Dict


@pytest.fixture(scope="module")
def env():
    bev = {"size": 64, "px_per_m": 1.5, "ego_row": 50}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=1.0)


@pytest.mark.parametrize(
    "wrapper",
    [
        lambda env: env,
        bev_driving_env.BEVOnly,
        gym.wrappers.FlattenObservation,
        lambda env: gym.wrappers.FlattenObservation(bev_driving_env.BEVOnly(env)),
        lambda env: gym.wrappers.FilterObservation(env, ["measurements"]),
    ],
)
def test_a_wrapped_environments_observation_is_made_of_the_plain_one(wrapper, env):
    wrapped = wrapper(env)
    expected, _ = wrapped.reset(seed=4)
    plain, _ = env.reset(seed=4)
    made = observation_adapter(wrapped.observation_space, env.observation_space)(plain)
    assert made in wrapped.observation_space
    expected_parts = expected if isinstance(expected, dict) else {"": expected}
    made_parts = made if isinstance(made, dict) else {"": made}
    assert made_parts.keys() == expected_parts.keys()
    for key, part in expected_parts.items():
        np.testing.assert_array_equal(made_parts[key], part)
        assert made_parts[key].dtype == part.dtype


def test_flat_observations_leave_out_cameras_that_the_policy_never_saw(env):
    given = observation_space(BEVGeometry(64, 1.5, 50), 30.0, images=(4, 8, 12, 3))
    given.seed(0)
    observation = given.sample()
    flat = observation_adapter(gym.spaces.flatten_space(env.observation_space), given)(observation)
    seen = np.concatenate([observation["bev"].reshape(-1), observation["measurements"]])
    np.testing.assert_array_equal(flat, seen)
    flat = observation_adapter(gym.spaces.flatten_space(given), given)(observation)
    np.testing.assert_array_equal(flat, gym.spaces.flatten(given, observation))


def test_measurements_alone_are_enough_for_a_policy_that_wants_no_more(env):
    observation, _ = env.reset(seed=0)
    made = observation_adapter(Box(-1, 30, (3,)), env.observation_space)(observation)
    np.testing.assert_array_equal(made, observation["measurements"])


@pytest.mark.parametrize(("high", "scale"), [(1.0, 255.0), (255.0, 1.0)])
def test_a_float_bev_is_scaled_to_the_bounds_it_was_trained_with(high, scale, env):
    observation, _ = env.reset(seed=0)
    wanted = Box(0.0, high, (6, 64, 64), np.float32)
    made = observation_adapter(wanted, env.observation_space)(observation)
    assert made.dtype == np.float32
    assert made in wanted
    np.testing.assert_allclose(made * scale, observation["bev"], atol=1e-4)
    assert observation["bev"].max() == 255


def test_in_a_wrapped_environment_the_observation_goes_through_as_it_is(env):
    wrapped = bev_driving_env.BEVOnly(env)
    observation, _ = wrapped.reset(seed=0)
    made = observation_adapter(wrapped.observation_space, wrapped.observation_space)(observation)
    np.testing.assert_array_equal(made, observation)


@pytest.mark.parametrize(
    "wanted",
    [
        Box(0, 255, (6, 192, 192), np.uint8),  # another size
        Box(0, 255, (24, 64, 64), np.uint8),  # four frames stacked
        Box(0, 255, (64, 64, 6), np.uint8),
        Box(-1, 1, (17,)),
        Dict({"bev": Box(0, 255, (6, 64, 64), np.uint8), "lidar": Box(0, 1, (9,))}),
        Dict({"measurements": Box(-1, 1, (6,))}),
        gym.spaces.Discrete(4),
    ],
)
def test_what_cannot_be_made_is_refused_with_both_spaces(wanted, env):
    with pytest.raises(ValueError, match="the policy was trained on") as error:
        observation_adapter(wanted, env.observation_space)
    assert "{bev: Box(6, 64, 64) uint8, measurements: Box(3,) float32}" in str(error.value)


def test_a_dict_cannot_be_made_of_an_image(env):
    image = env.observation_space["bev"]
    with pytest.raises(ValueError, match=r"environment gives Box\(6, 64, 64\) uint8"):
        observation_adapter(env.observation_space, image)
