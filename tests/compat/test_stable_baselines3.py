"""Stable-Baselines3: its checker, its CNN, a little learning."""

import warnings

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env

sb3 = pytest.importorskip("stable_baselines3")


def tiny_ppo(policy, env):
    return sb3.PPO(
        policy,
        env,
        n_steps=16,
        batch_size=16,
        n_epochs=1,
        seed=0,
        device="cpu",
        policy_kwargs={"net_arch": [8]},
    )


@pytest.mark.parametrize("bev_only", [False, True])
def test_its_checker_finds_nothing_to_warn_about(bev_only):
    from stable_baselines3.common.env_checker import check_env

    env = gym.make("BEVTown01-v0", render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(bev_driving_env.BEVOnly(env) if bev_only else env)


def test_its_checker_has_one_thing_to_say_about_cameras():
    from stable_baselines3.common.env_checker import check_env

    env = gym.make("BEVTown02-v0", cameras=True, camera_size=(56, 120))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # its own CNN takes one image; four of them are for a network of one's own
        warnings.filterwarnings("ignore", message=".*unconventional shape.*")
        check_env(env)


def test_ppo_learns_from_the_dict_observation_with_a_cnn():
    from stable_baselines3.common.torch_layers import NatureCNN

    env = gym.make("BEVTown01-v0", time_limit_s=1.0)
    model = tiny_ppo("MultiInputPolicy", env)
    # a bev with the wrong bounds or dtype would silently be flattened instead
    assert isinstance(model.policy.features_extractor.extractors["bev"], NatureCNN)
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(32)
    assert model.num_timesteps == 32
    after = list(model.policy.parameters())
    pairs = zip(before, after, strict=True)
    assert any(not np.array_equal(a.numpy(), b.detach().numpy()) for a, b in pairs)
    # SB3's Monitor owns info["episode"]
    assert [episode["l"] for episode in model.ep_info_buffer] == [10, 10, 10]


def test_its_vector_environment_finds_the_last_view_and_the_time_limit():
    from stable_baselines3.common.vec_env import DummyVecEnv

    envs = DummyVecEnv([lambda: gym.make("BEVTown01-v0", time_limit_s=0.3)] * 2)
    envs.seed(5)
    assert envs.reset()["bev"].shape == (2, 6, 192, 192)
    for _ in range(3):
        observation, rewards, dones, infos = envs.step(np.zeros((2, 2), np.float32))
    assert rewards.shape == (2,)
    assert dones.all()
    assert infos[0]["TimeLimit.truncated"] is True
    assert infos[0]["terminal_observation"]["bev"].shape == (6, 192, 192)
    assert observation["measurements"].shape == (2, 3)
