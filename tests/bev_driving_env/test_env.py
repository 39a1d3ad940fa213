"""``BEVTownEnv`` as Gymnasium sees it: spaces, values, information, order of calls."""

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env
from bev_driving_env.frames import CHANNELS

INFO_KEYS = {
    "route_m",
    "route_length_m",
    "infractions",
    "success",
    "lateral_error_m",
    "episode_id",
}
FORWARD = np.array([0.4, 0.0], np.float32)


@pytest.fixture
def env():
    made = gym.make("BEVTown01-v0")
    yield made
    made.close()


def arrays_of(observation):
    return list(observation.values())


def test_spaces_are_those_of_the_contract(env):
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert list(env.observation_space.spaces) == ["bev", "measurements"]
    assert env.observation_space["bev"] == gym.spaces.Box(0, 255, (6, 192, 192), np.uint8)
    assert env.observation_space["measurements"].shape == (3,)
    assert env.observation_space["measurements"].dtype == np.float32
    assert CHANNELS == ("road", "route", "lane", "vehicles", "pedestrians", "lights")


def test_the_ground_truth_view_holds_masks_of_0_and_255(env):
    observation, _ = env.reset(seed=0)
    for _ in range(5):
        assert set(np.unique(observation["bev"]).tolist()) == {0, 255}
        observation, *_ = env.step(FORWARD)
    filled = observation["bev"].reshape(6, -1).any(axis=1)
    # there are no other road users and no lights in this version
    assert filled.tolist() == [True, True, True, False, False, False]


def test_measurements_are_speed_and_the_last_command(env):
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observation["measurements"], np.zeros(3, np.float32))
    observation, *_ = env.step(np.array([0.4, -0.1], np.float32))
    # 0.4 of 5 m/s^2 for 0.1 s
    np.testing.assert_allclose(observation["measurements"], [0.2, 0.4, -0.1], rtol=1e-6)
    observation, *_ = env.step(np.array([-1.0, 0.1], np.float32))
    np.testing.assert_allclose(observation["measurements"], [0.0, -1.0, 0.1], rtol=1e-6, atol=1e-9)


def test_actions_beyond_the_space_are_clipped_to_it(env):
    env.reset(seed=0)
    observation, *_ = env.step(np.array([7.0, 0.0], np.float32))
    np.testing.assert_allclose(observation["measurements"], [0.5, 1.0, 0.0], rtol=1e-6)


def test_reset_and_step_return_the_types_of_the_contract(env):
    observation, info = env.reset(seed=0)
    assert observation in env.observation_space
    assert set(info) == INFO_KEYS
    observation, reward, terminated, truncated, info = env.step(FORWARD)
    assert observation in env.observation_space
    assert type(reward) is float
    assert type(terminated) is bool
    assert type(truncated) is bool
    assert set(info) == INFO_KEYS | {"reward_terms"}
    types = {key: type(value) for key, value in info.items()}
    assert types == {
        "route_m": float,
        "route_length_m": float,
        "infractions": list,
        "success": bool,
        "lateral_error_m": float,
        "episode_id": str,
        "reward_terms": dict,
    }


def test_the_reward_is_the_sum_of_its_terms(env):
    env.reset(seed=0)
    for k in range(20):
        _, reward, _, _, info = env.step(np.array([0.5, 0.02 * (k % 3)], np.float32))
        assert all(type(term) is float for term in info["reward_terms"].values())
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)


def test_every_step_returns_new_objects(env):
    observation, info = env.reset(seed=0)
    results = [(observation, info)]
    for _ in range(3):
        observation, _, _, _, info = env.step(FORWARD)
        results.append((observation, info))
    for i, (observation, info) in enumerate(results):
        for other, other_info in results[:i]:
            for a, b in zip(arrays_of(observation), arrays_of(other), strict=True):
                assert not np.shares_memory(a, b)
            assert info is not other_info
            assert info["infractions"] is not other_info["infractions"]


def test_writing_into_an_observation_does_not_reach_the_world(env):
    observation, _ = env.reset(seed=0)
    expected = observation["bev"].copy()
    observation["bev"][:] = 77
    observation["measurements"][:] = 77
    np.testing.assert_array_equal(env.unwrapped.ground_truth_bev(), expected)
    np.testing.assert_allclose(env.step(FORWARD)[0]["measurements"], [0.2, 0.4, 0.0], rtol=1e-6)


def test_the_observed_view_is_the_ground_truth_of_the_moment(env):
    env.reset(seed=4)
    observation, *_ = env.step(FORWARD)
    np.testing.assert_array_equal(observation["bev"], env.unwrapped.ground_truth_bev())


def test_step_before_reset_says_to_reset():
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        bev_driving_env.BEVTownEnv().step(FORWARD)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        bev_driving_env.BEVTownEnv().route  # noqa: B018


@pytest.mark.parametrize(
    ("action", "named"),
    [
        ([0.0], r"\(1,\)"),
        ([[0.0, 0.0]], r"\(1, 2\)"),
        ([0.0, 0.0, 0.0], r"\(3,\)"),
        (0.5, r"\(\)"),
        ([np.nan, 0.0], "nan"),
        ([0.0, np.inf], "inf"),
        ("left", "left"),
        (None, "None|nan|shape"),
    ],
)
def test_a_bad_action_is_refused_with_what_came_and_what_is_expected(action, named):
    env = bev_driving_env.BEVTownEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=named) as error:
        env.step(action)
    assert "(2,)" in str(error.value) or "[-1, 1]" in str(error.value)
    assert env.world.state.steps[0] == 0


def test_an_unknown_town_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'Town03'.*Town01.*Town02"):
        bev_driving_env.BEVTownEnv("Town03")


def test_an_unknown_render_mode_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'rgb_array' or 'human'.*'ansi'"):
        bev_driving_env.BEVTownEnv(render_mode="ansi")


def test_the_env_tells_its_pose_and_the_other_vehicles(env):
    env.reset(seed=0, options={"episode": 0})
    x, y, heading = env.unwrapped.ego_pose
    assert (x, y) == pytest.approx((140.0, 195.15), abs=0.01)  # where the route file says
    assert heading == pytest.approx(np.pi)  # the lane runs west
    assert env.unwrapped.vehicle_states.shape == (0, 6)
    assert len(env.unwrapped.route.points) > 200


@pytest.mark.parametrize(
    "vehicle", [{"speed_limit_mps": 0.1}, {"max_acceleration_mps2": 2000.0}, {}]
)
def test_observations_stay_in_their_space_at_full_throttle(vehicle):
    env = bev_driving_env.BEVTownEnv(
        vehicle=vehicle, terminate_on=(), bev={"size": 32, "ego_row": 16}
    )
    env.reset(seed=0)
    for _ in range(100):
        observation, *_ = env.step([1.0, 0.0])
        assert env.observation_space.contains(observation)


def test_numpy_integers_configure_the_view_as_python_ones_do():
    size, row = np.int64(64), np.int32(40)
    env = bev_driving_env.BEVTownEnv(bev={"size": size, "ego_row": row}, appearance=np.int64(5))
    assert env.reset(seed=0)[0]["bev"].shape == (6, 64, 64)
    assert type(env.world.config.bev.size) is int
