"""The Beta policy: a Stable-Baselines3 actor-critic over BEV and measurements.

``PPO(BetaPolicy, env)`` and ``A2C(BetaPolicy, env)`` train it, ``PPO.load`` brings it back, and
:meth:`BetaPolicy.actor` is the plain network that behaviour cloning trains in place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn

from .distribution import BetaDistribution
from .network import ACTIONS, FEATURES, HEAD, BetaActor, BetaHead, BEVEncoder, NetworkConfig


class BEVFeatures(BaseFeaturesExtractor):
    """The encoder as a features extractor of Stable-Baselines3."""

    def __init__(self, observation_space: gym.Space[Any], config: NetworkConfig) -> None:
        super().__init__(observation_space, FEATURES)
        self.encoder = BEVEncoder(config)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Features (N, 256) of a batch of observations, the BEV in 0..255."""
        return self.encoder(observations["bev"], observations["measurements"])


class BetaPolicy(ActorCriticPolicy):
    """Actor and critic on one encoder, Beta distributions for acceleration and steering.

    Deterministic actions are the mode of the distribution by the case rules of
    :func:`agents.beta.beta_mode`.

    Args:
        observation_space: A ``Dict`` with ``bev`` (C, S, S) uint8 and ``measurements`` (3,);
            other keys are not looked at.
        action_space: ``Box(-1, 1, (2,))``.
        lr_schedule: Learning rate as a function of the remaining progress.
        channels: BEV channels that the network sees.
        measurements: Measurements that it sees.
        speed_scale_mps: Speeds are divided by it.
        concentration_floor: Least alpha and beta.
        deterministic_action: ``"mode"`` or ``"mean"``.
        use_sde: Stable-Baselines3 passes it; only False makes sense here.
        optimizer_class: Optimizer that reinforcement learning uses.
        optimizer_kwargs: Its arguments.

    Raises:
        ValueError: Spaces or settings do not fit; the message shows them.
    """

    features_extractor: BEVFeatures
    action_dist: BetaDistribution
    action_net: BetaHead

    def __init__(
        self,
        observation_space: gym.Space[Any],
        action_space: gym.Space[Any],
        lr_schedule: Schedule,
        *,
        channels: Sequence[int] = (0, 1, 2),
        measurements: Sequence[int] = (0, 1, 2),
        speed_scale_mps: float = 6.0,
        concentration_floor: float = 1e-3,
        deterministic_action: str = "mode",
        use_sde: bool = False,
        optimizer_class: type[torch.optim.Optimizer] = torch.optim.Adam,
        optimizer_kwargs: dict[str, Any] | None = None,
    ) -> None:
        if use_sde:
            raise ValueError("BetaPolicy explores by its own distribution; leave use_sde=False")
        _check_actions(action_space)
        config = NetworkConfig(
            channels=tuple(channels),
            measurements=tuple(measurements),
            bev_size=_bev_size(observation_space, channels),
            speed_scale_mps=speed_scale_mps,
            concentration_floor=concentration_floor,
        )
        self._point = deterministic_action
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch={"pi": list(HEAD), "vf": list(HEAD)},
            activation_fn=nn.ReLU,
            ortho_init=False,
            features_extractor_class=BEVFeatures,
            features_extractor_kwargs={"config": config},
            # the encoder divides by 255 itself, so that training on uint8 batches is the same
            normalize_images=False,
            optimizer_class=optimizer_class,
            optimizer_kwargs=optimizer_kwargs,
        )

    @property
    def config(self) -> NetworkConfig:
        """What the network sees and how it answers."""
        return self.features_extractor.encoder.config

    def actor(self) -> BetaActor:
        """The actor as one module over the same parameters, for training without a critic.

        Its ``forward(bev, measurements)`` takes uint8 batches and returns alpha and beta, so
        that the loss of behaviour cloning is ``beta_nll(*actor(bev, measurements), action)``.
        """
        return BetaActor(
            self.features_extractor.encoder, self.mlp_extractor.policy_net, self.action_net
        )

    def extract_features(  # type: ignore[override]
        self, obs: dict[str, Tensor], features_extractor: BaseFeaturesExtractor | None = None
    ) -> Tensor:
        """Features (N, 256) of observations as they are.

        The parent would first make floats of all six channels, a fifth of the time of an update;
        the encoder makes them of those that it looks at.
        """
        return self.features_extractor(obs)

    def _build(self, lr_schedule: Schedule) -> None:
        """Replaces the parent's, whose distributions are a closed list."""
        self._build_mlp_extractor()
        self.action_dist = BetaDistribution(ACTIONS, self._point)
        self.action_net = self.action_dist.proba_distribution_net(
            self.mlp_extractor.latent_dim_pi, self.config.concentration_floor
        )
        self.value_net = nn.Linear(self.mlp_extractor.latent_dim_vf, 1)
        self.optimizer = self.optimizer_class(
            self.parameters(),
            lr=lr_schedule(1),  # type: ignore[call-arg]
            **self.optimizer_kwargs,
        )

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> BetaDistribution:
        return self.action_dist.proba_distribution(*self.action_net(latent_pi))

    def _get_constructor_parameters(self) -> dict[str, Any]:
        """Arguments that make this policy again, for ``save`` and ``load`` of the policy alone."""
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "lr_schedule": self._dummy_schedule,
            **self.config.policy_kwargs,
            "deterministic_action": self._point,
            "optimizer_class": self.optimizer_class,
            "optimizer_kwargs": self.optimizer_kwargs,
        }


def _bev_size(space: gym.Space[Any], channels: Sequence[int]) -> int:
    """Side of the BEV of an observation space that the policy can see with."""
    bev = space.spaces.get("bev") if isinstance(space, gym.spaces.Dict) else None
    measured = space.spaces.get("measurements") if isinstance(space, gym.spaces.Dict) else None
    if bev is None or measured is None or measured.shape != (3,):
        raise ValueError(
            "BetaPolicy needs a Dict observation with 'bev' and 'measurements' (3,), as BEVTown "
            f"gives without BEVOnly or flattening, got {space}"
        )
    shape = bev.shape or ()
    if len(shape) != 3 or shape[1] != shape[2] or bev.dtype != np.uint8:
        raise ValueError(f"BetaPolicy needs a square uint8 'bev' (channels, size, size), got {bev}")
    if any(channel >= shape[0] for channel in channels):
        raise ValueError(f"channels {tuple(channels)} are not all among the BEV's {shape[0]}")
    return int(shape[1])


def _check_actions(space: gym.Space[Any]) -> None:
    """Raise ValueError unless the space is the one that the distribution covers."""
    fits = isinstance(space, gym.spaces.Box) and space.shape == (ACTIONS,)
    if not (fits and np.all(space.low == -1.0) and np.all(space.high == 1.0)):  # type: ignore[attr-defined]
        raise ValueError(
            f"BetaPolicy acts in Box(-1, 1, ({ACTIONS},)), got {space}; "
            "gymnasium.wrappers.RescaleAction brings another range to it"
        )
