"""Gymnasium's own checker and wrappers."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FlattenObservation, FrameStackObservation, RecordEpisodeStatistics

import bev_driving_env

ALL_KEYWORDS = {
    "bev_source": {"default": "ground_truth"},
    "traffic": "none",
    "traffic_lights": False,
    "appearance": "test",
    "cameras": False,
    "camera_size": (112, 240),
    "camera_motion": True,
    "terminate_on": ("off_road",),
    "max_speed_mps": 8.0,
}


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.parametrize(
    ("env_id", "render_mode"), [("BEVTown01-v0", "rgb_array"), ("BEVTown02-v0", None)]
)
def test_gymnasiums_checker_finds_nothing_to_warn_about(env_id, render_mode):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(env_id, render_mode=render_mode)
        check_env(env.unwrapped)  # declared render modes are checked through env.spec
        env.close()


def test_gymnasiums_checker_accepts_every_keyword_of_the_contract():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("BEVTown01-v0", **ALL_KEYWORDS)
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"bev_source": bev_driving_env.CorruptedBEV("ground_truth", flicker=0.5, latency=0.2)},
        {"appearance": "hard", "camera_motion": False},
    ],
)
def test_gymnasiums_checker_finds_nothing_to_warn_about_with_cameras(keywords):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("BEVTown02-v0", cameras=True, camera_size=(56, 120), **keywords)
        check_env(env.unwrapped, skip_render_check=True)


def test_gymnasiums_checker_accepts_the_bev_only_view():
    env = bev_driving_env.BEVOnly(gym.make("BEVTown01-v0").unwrapped)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # the checker notes any wrapper, and the spec does not know of this one
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        check_env(env, skip_render_check=True, skip_close_check=True)


def test_record_episode_statistics_adds_up_what_the_episode_summary_says():
    env = RecordEpisodeStatistics(gym.make("BEVTown01-v0", time_limit_s=2.0))
    env.reset(seed=0)
    rewards = []
    for _ in range(19):
        _, reward, terminated, truncated, info = env.step([0.3, 0.0])
        rewards.append(reward)
        assert "episode" not in info
        assert not terminated
        assert not truncated
    _, reward, _, truncated, info = env.step([0.3, 0.0])
    rewards.append(reward)
    assert truncated
    assert info["episode"]["l"] == info["episode_summary"]["steps"] == 20
    assert info["episode"]["r"] == pytest.approx(sum(rewards))
    assert info["episode_summary"]["return"] == pytest.approx(sum(rewards))


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_record_episode_statistics_works_on_the_vector_environment(mode):
    plain = gym.make_vec(
        "BEVTown01-v0", num_envs=3, max_episode_steps=4, autoreset_mode=mode, time_limit_s=9.0
    )
    envs = gym.wrappers.vector.RecordEpisodeStatistics(plain)
    envs.reset(seed=0)
    for _ in range(4):
        *_, infos = envs.step(np.full((3, 2), (0.4, 0.0), np.float32))
    assert infos["_episode"].all()
    assert infos["episode"]["l"].tolist() == [4, 4, 4]
    final = infos["final_info"] if mode is AutoresetMode.SAME_STEP else infos
    np.testing.assert_allclose(infos["episode"]["r"], final["episode_summary"]["return"])


def test_observations_can_be_stacked_and_flattened():
    stacked = FrameStackObservation(gym.make("BEVTown01-v0"), 3)
    observation, _ = stacked.reset(seed=0)
    assert observation["bev"].shape == (3, 6, 192, 192)
    flat = FlattenObservation(gym.make("BEVTown01-v0"))
    observation, _ = flat.reset(seed=0)
    assert observation.shape == (6 * 192 * 192 + 3,)


def test_camera_images_can_be_stacked_and_flattened():
    keywords = {"cameras": True, "camera_size": (32, 64)}
    stacked = FrameStackObservation(gym.make("BEVTown02-v0", **keywords), 2)
    observation, _ = stacked.reset(seed=0)
    assert observation["cameras"].shape == (2, 4, 32, 64, 3)
    flat = FlattenObservation(gym.make("BEVTown02-v0", **keywords))
    observation, _ = flat.reset(seed=0)
    assert observation.shape == (6 * 192 * 192 + 3 + 4 * 32 * 64 * 3 + 192 * 192,)


def test_the_spec_makes_the_same_environment_again():
    env = gym.make("BEVTown02-v0", max_speed_mps=7.0)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    first, _ = env.reset(seed=3)
    second, _ = again.reset(seed=3)
    np.testing.assert_array_equal(first["bev"], second["bev"])
    assert again.unwrapped.settings == env.unwrapped.settings
