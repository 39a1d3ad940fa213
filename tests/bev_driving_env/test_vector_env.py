"""``BEVTownVectorEnv``: how it is made, what it returns, and what it refuses."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import bev_driving_env
from bev_driving_env import BEVTownEnv, BEVTownVectorEnv

STAND = np.zeros((3, 2), np.float32)


@pytest.fixture
def envs():
    return BEVTownVectorEnv(3)


@pytest.mark.parametrize("env_id", ["BEVTown01-v0", "bev_driving_env:BEVTown02-v0"])
def test_make_vec_gives_the_batched_environment_without_a_warning(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gym.make_vec(env_id, num_envs=8)
        envs.reset(seed=0)
        envs.step(np.zeros((8, 2), np.float32))
        envs.close()
    assert type(envs) is BEVTownVectorEnv
    assert envs.num_envs == 8
    assert envs.spec.id == env_id.rsplit(":", maxsplit=1)[-1]


def test_make_vec_passes_keywords_on():
    envs = gym.make_vec(
        "BEVTown01-v0",
        num_envs=2,
        max_episode_steps=5,
        autoreset_mode=AutoresetMode.SAME_STEP,
        max_speed_mps=7.0,
    )
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert envs.settings.max_speed_mps == 7.0


def test_the_mode_of_one_environment_does_not_leak_into_another():
    BEVTownVectorEnv(1, autoreset_mode="SameStep")
    assert BEVTownVectorEnv(1).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_make_vec_can_still_be_told_to_use_separate_environments():
    envs = gym.make_vec("BEVTown01-v0", num_envs=2, vectorization_mode="sync")
    assert type(envs.envs[0].unwrapped) is BEVTownEnv


def test_spaces_are_batches_of_the_single_ones(envs):
    single = BEVTownEnv()
    assert envs.single_observation_space == single.observation_space
    assert envs.single_action_space == single.action_space
    assert envs.action_space.shape == (3, 2)
    assert envs.observation_space["bev"].shape == (3, 6, 192, 192)


def test_results_have_the_types_of_gymnasiums_vector_environments(envs):
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    observations, rewards, terminations, truncations, infos = envs.step(STAND)
    assert observations in envs.observation_space
    assert (rewards.shape, rewards.dtype) == ((3,), np.float64)
    assert (terminations.shape, terminations.dtype) == ((3,), np.bool_)
    assert (truncations.shape, truncations.dtype) == ((3,), np.bool_)
    keys = {"route_m", "route_length_m", "infractions", "success", "lateral_error_m"}
    keys |= {"episode_id", "reward_terms"}
    assert set(infos) == keys | {f"_{key}" for key in keys}
    assert "episode" not in infos


def test_every_step_returns_new_arrays(envs):
    observations, infos = envs.reset(seed=0)
    rows = [(*observations.values(), infos["route_m"], infos["success"])]
    for _ in range(3):
        observations, *arrays, infos = envs.step(STAND)
        rows.append((*observations.values(), infos["route_m"], infos["success"], *arrays))
    for i, row in enumerate(rows):
        for other in rows[:i]:
            assert not any(np.shares_memory(a, b) for a in row for b in other)


def test_seeds_count_up_from_one_or_are_given_one_by_one(envs):
    envs.reset(seed=10)
    poses = envs.ego_poses
    envs.reset(seed=[10, 11, 12])
    np.testing.assert_array_equal(envs.ego_poses, poses)
    envs.reset(seed=[12, None, 10])
    np.testing.assert_array_equal(envs.ego_poses[[0, 2]], poses[[2, 0]])


def test_ego_poses_are_where_the_cars_are(envs):
    envs.reset(seed=5)
    for _ in range(5):
        envs.step(np.full((3, 2), 0.1, np.float32))
    single = BEVTownEnv()
    for i in range(3):
        single.reset(seed=5 + i)
        for _ in range(5):
            single.step(np.full(2, 0.1, np.float32))
        assert tuple(envs.ego_poses[i]) == single.ego_pose
    envs.ego_poses[:] = 0.0
    assert envs.ego_poses.any()


def test_options_hold_for_all_worlds(envs):
    _, infos = envs.reset(seed=0, options={"episode": 3})
    assert infos["episode_id"].tolist() == ["Town01/episode/3"] * 3
    assert len({tuple(pose) for pose in envs.ego_poses}) == 1


def test_max_episode_steps_truncates_every_world():
    envs = BEVTownVectorEnv(2, max_episode_steps=4, autoreset_mode="Disabled")
    envs.reset(seed=0)
    ends = [envs.step(STAND[:2])[3].tolist() for _ in range(4)]
    assert ends == [[False, False]] * 3 + [[True, True]]


def test_max_episode_steps_does_not_lengthen_an_episode():
    envs = BEVTownVectorEnv(1, max_episode_steps=100, time_limit_s=0.3)
    envs.reset(seed=0)
    assert [bool(envs.step(STAND[:1])[3][0]) for _ in range(3)] == [False, False, True]


def test_render_gives_one_frame_a_world():
    envs = gym.make_vec("BEVTown01-v0", num_envs=2, render_mode="rgb_array")
    envs.reset(seed=0)
    frames = envs.render()
    assert isinstance(frames, tuple)
    assert [frame.dtype for frame in frames] == [np.uint8, np.uint8]
    single = gym.make("BEVTown01-v0", render_mode="rgb_array")
    for i, frame in enumerate(frames):
        single.reset(seed=i)
        np.testing.assert_array_equal(frame, single.render())


def test_render_without_a_mode_warns_and_gives_nothing(envs):
    envs.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert envs.render() is None


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"num_envs": 0}, r"num_envs .*0"),
        ({"num_envs": 2.0}, r"num_envs .*2\.0"),
        ({"num_envs": True}, r"num_envs .*True"),
        ({"town": "Town09"}, r"'Town09'.*Town01"),
        ({"render_mode": "human"}, r"'rgb_array'.*'human'"),
        ({"max_episode_steps": 0}, r"max_episode_steps .*0"),
        ({"max_episode_steps": 2.5}, r"max_episode_steps .*2\.5"),
        ({"max_episode_steps": "2"}, r"max_episode_steps .*'2'"),
        ({"autoreset_mode": "sometimes"}, r"(?s)(?=.*sometimes)(?=.*NextStep)(?=.*SameStep)"),
    ],
)
def test_bad_arguments_are_refused_with_what_came(arguments, named):
    with pytest.raises(ValueError, match=named):
        BEVTownVectorEnv(**arguments)


def test_bad_actions_are_refused_with_the_expected_shape(envs):
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(3, 2\).*\(2,\)"):
        envs.step(np.zeros(2))
    bad = STAND.copy()
    bad[1, 0] = np.nan
    with pytest.raises(ValueError, match="nan"):
        envs.step(bad)


def test_the_wrong_number_of_seeds_is_refused(envs):
    with pytest.raises(ValueError, match=r"3 seeds.*2"):
        envs.reset(seed=[1, 2])


def test_bad_options_are_refused_like_those_of_the_single_environment(envs):
    with pytest.raises(ValueError, match=r"episode 7 .*0 to 4"):
        envs.reset(seed=0, options={"episode": 7})


def test_step_before_reset_says_to_reset(envs):
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        envs.step(STAND)
    envs.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        envs.step(STAND)


@pytest.mark.parametrize("mask", [[True, False], np.ones(3), np.zeros(3, bool), "all"])
def test_a_bad_reset_mask_is_refused(envs, mask):
    with pytest.raises(ValueError, match=r"reset_mask must be .*\(3,\)"):
        envs.reset(options={"reset_mask": mask})


def test_the_name_at_the_top_of_the_package_is_this_class():
    assert bev_driving_env.BEVTownVectorEnv is BEVTownVectorEnv
