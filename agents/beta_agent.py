"""A Beta policy as an agent."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bev_driving_env.training.threads import one_thread

from .beta import beta_kl, beta_mean, beta_mode
from .checkpoint import load_weights
from .policy import BetaPolicy

ANSWERS = ("mode", "mean", "sample")


class BetaAgent:
    """Drives with a Beta policy.

    Args:
        policy: The policy.
        env: The environment, whose observations must fit the policy.
        answer: ``"mode"``, ``"mean"`` or ``"sample"``.

    Raises:
        ValueError: The observations do not fit, or ``answer`` is none of the three.
    """

    def __init__(
        self, policy: BetaPolicy, env: gym.Env[Any, Any], answer: str | None = None
    ) -> None:
        answer = policy.action_dist.point if answer is None else answer
        if answer not in ANSWERS:
            raise ValueError(f"a Beta policy answers by {', '.join(ANSWERS)}, got {answer!r}")
        _check_view(policy, env.observation_space)
        self.answer = answer
        self._device = policy.device
        self._actor = policy.actor().eval()
        self._rng = np.random.default_rng(0)
        self._last: tuple[NDArray[Any], NDArray[Any], tuple[Tensor, Tensor]] | None = None

    def reset(self, seed: int | None) -> None:
        """Start an episode; sampled actions follow from the seed alone."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """The action (2,) for ``bev`` (C, S, S) and ``measurements`` (3,)."""
        with one_thread(), torch.inference_mode():
            alpha, beta = self._heads(observation)
            if self.answer == "mode":
                return beta_mode(alpha, beta).numpy()
            if self.answer == "mean":
                return beta_mean(alpha, beta).numpy()
        # the agent's own generator: torch's is shared with whatever else runs in this process
        drawn = self._rng.beta(alpha.double().numpy(), beta.double().numpy())
        return (2.0 * drawn - 1.0).astype(np.float32)

    def divergence(
        self, observation: Mapping[str, NDArray[Any]], other: Mapping[str, NDArray[Any]]
    ) -> float:
        """How far its answer to another observation is from that to this one, in nats.

        The Kullback-Leibler divergence of the Beta distributions, summed over both actions.
        """
        with one_thread(), torch.inference_mode():
            return float(beta_kl(*self._heads(observation), *self._heads(other)))

    def _heads(self, observation: Mapping[str, NDArray[Any]]) -> tuple[Tensor, Tensor]:
        """Concentrations (2,) and (2,) of the answer to an observation.

        The last ones are kept: a moment that is compared with the truth is then acted on, and to
        compare observations takes a hundredth of the time that the network takes.
        """
        bev, measured = observation["bev"], observation["measurements"]
        if self._last is not None:
            seen, felt, heads = self._last
            if np.array_equal(bev, seen) and np.array_equal(measured, felt):
                return heads
        alpha, beta = self._actor(
            torch.as_tensor(bev[None], device=self._device),
            torch.as_tensor(measured[None], device=self._device),
        )
        heads = (alpha[0].cpu(), beta[0].cpu())
        self._last = (np.array(bev), np.array(measured), heads)
        return heads


def load_beta_agent(path: Path, env: gym.Env[Any, Any], answer: str | None = None) -> BetaAgent:
    """The agent of a weights file; errors as in ``load_weights`` and :class:`BetaAgent`."""
    return BetaAgent(load_weights(path), env, answer)


def _check_view(policy: BetaPolicy, space: gym.Space[Any]) -> None:
    """Raise ValueError unless the policy can look at observations of a space."""
    spaces = space.spaces if isinstance(space, gym.spaces.Dict) else {}
    if not {"bev", "measurements"} <= spaces.keys():
        raise ValueError(
            f"the policy looks at 'bev' and 'measurements', the observation is {space}"
        )
    shape = spaces["bev"].shape or ()
    size = policy.config.bev_size
    if len(shape) != 3 or shape[0] <= max(policy.config.channels) or shape[1:] != (size, size):
        raise ValueError(
            f"the policy looks at channels {policy.config.channels} of a BEV of {size} x {size} "
            f"pixels, the environment's has shape {shape}"
        )
