"""TorchRL: its specs, its wrapper and its own way of making an environment."""

import gymnasium as gym
import pytest

import bev_driving_env  # noqa: F401  # registers the ids

pytest.importorskip("torchrl")


@pytest.fixture(params=["wrapper", "by name"])
def env(request):
    from torchrl.envs import GymEnv, GymWrapper

    if request.param == "wrapper":
        made = GymWrapper(gym.make("BEVTown01-v0"))
    else:
        made = GymEnv("BEVTown01-v0")
    yield made
    made.close()


def test_its_checker_accepts_the_specs(env):
    from torchrl.envs.utils import check_env_specs

    check_env_specs(env)


def test_no_observation_key_is_renamed(env):
    import torch

    steps = env.rollout(3)
    assert steps["bev"].dtype == torch.uint8
    assert steps["bev"].shape[1:] == (6, 192, 192)
    assert steps["measurements"].shape[1:] == (3,)
    assert set(env.observation_spec.keys()) == {"bev", "measurements"}


def test_camera_images_arrive_as_they_are():
    import torch
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    env = GymWrapper(gym.make("BEVTown02-v0", cameras=True, camera_size=(32, 64)))
    check_env_specs(env)
    steps = env.rollout(3)
    assert steps["cameras"].dtype == steps["route_map"].dtype == torch.uint8
    assert steps["cameras"].shape[1:] == (4, 32, 64, 3)
    assert steps["route_map"].shape[1:] == (192, 192)
    env.close()
