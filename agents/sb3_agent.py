"""Agents that Stable-Baselines3 saved, of any algorithm.

A file of Stable-Baselines3 is a zip of pickles: **loading one can run any code that its author put
in. Load only files that you trust.** BEVTown's own weights (``agents.checkpoint``) cannot.

Only the policy is made again, not the algorithm: driving needs no more, it works the same for
every algorithm (sb3-contrib's too, where it is installed), and an off-policy algorithm would set
aside its whole replay buffer. The statistics of a ``VecNormalize`` are no part of such a file.
"""

from __future__ import annotations

import inspect
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.utils import set_random_seed

from bev_driving_env.training.threads import one_thread

from .adapters import observation_adapter

_NEEDED = ("policy_class", "observation_space", "action_space", "policy_kwargs", "use_sde")


class SB3Agent:
    """Drives with a policy of Stable-Baselines3.

    Args:
        policy: The policy; recurrent ones get their state back at every step.
        env: The environment it will drive.
        deterministic: Take its best action instead of a random one.

    Raises:
        ValueError: The policy was trained on observations or actions that this environment's
            cannot be turned into.
    """

    def __init__(
        self, policy: BasePolicy, env: gym.Env[Any, Any], deterministic: bool = True
    ) -> None:
        acts, space = policy.action_space, env.action_space
        if not (isinstance(acts, Box) and isinstance(space, Box) and _same_bounds(acts, space)):
            raise ValueError(
                f"the policy acts in {acts}, the environment in {space}: train it in that space, "
                "or translate its actions in an agent of your own, 'module:factory'"
            )
        self.policy = policy
        self.deterministic = deterministic
        self._adapt = observation_adapter(policy.observation_space, env.observation_space)
        self._state: tuple[NDArray[Any], ...] | None = None
        self._starting = True

    def reset(self, seed: int | None) -> None:
        """Start an episode, without memory of the last one.

        A policy that samples draws with the generators of this process, which the seed sets.
        """
        self._state = None
        self._starting = True
        if not self.deterministic and seed is not None:
            set_random_seed(seed)

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        """The policy's action (2,)."""
        with one_thread():
            action, self._state = self.policy.predict(
                self._adapt(observation),
                state=self._state,
                episode_start=np.array([self._starting]),
                deterministic=self.deterministic,
            )
        self._starting = False
        return action


def _same_bounds(first: Box, second: Box) -> bool:
    """Whether two spaces hold the same arrays, whatever their precision."""
    return first.shape == second.shape and all(
        np.array_equal(getattr(first, end), getattr(second, end)) for end in ("low", "high")
    )


def load_sb3_agent(path: Path, env: gym.Env[Any, Any], deterministic: bool = True) -> SB3Agent:
    """Make an agent of a file that ``model.save`` of Stable-Baselines3 wrote.

    Args:
        path: The zip. Loading it can run code in it: see the top of this module.
        env: The environment it will drive.
        deterministic: Take the policy's best action instead of a random one.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is not such a file, or does not fit the environment.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            stored = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ValueError(f"{path} is no zip that Stable-Baselines3 saved: {error}") from error
    # what driving does not need stays pickled: schedules, for one, often fail between Pythons
    ignored = {name: None for name in stored if name not in _NEEDED}
    data, parameters, _ = load_from_zip_file(path, device="cpu", custom_objects=ignored)
    missing = [name for name in _NEEDED[:3] if (data or {}).get(name) is None]
    if data is None or missing or "policy" not in parameters:
        raise ValueError(f"{path} holds no policy of Stable-Baselines3: no {missing or 'weights'}")
    policy = _make_policy(data)
    weights: Any = parameters["policy"]  # a dict of tensors, whatever its annotation says
    policy.load_state_dict(weights)
    policy.set_training_mode(False)
    return SB3Agent(policy, env, deterministic)


def _make_policy(data: Mapping[str, Any]) -> BasePolicy:
    """The policy as its algorithm made it, with new weights."""
    policy_class = data["policy_class"]
    keywords = dict(data.get("policy_kwargs") or {})
    keywords.pop("device", None)
    # policies that are not optimised by gradients (ARS) take no learning rate
    if "lr_schedule" in inspect.signature(policy_class).parameters:
        keywords["lr_schedule"] = lambda _: 0.0
    if data.get("use_sde"):
        keywords["use_sde"] = True
    return policy_class(data["observation_space"], data["action_space"], **keywords).to("cpu")
