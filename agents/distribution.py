"""The Beta distribution as Stable-Baselines3 wants its distributions."""

from __future__ import annotations

import math

import torch
from stable_baselines3.common.distributions import Distribution
from torch import Tensor

from .beta import beta_entropy, beta_mean, beta_mode, beta_nll, beta_sample
from .network import BetaHead

POINTS = ("mode", "mean")


class BetaDistribution(Distribution):
    """Independent Beta distributions over actions in [-1, 1].

    Likelihood and entropy are those of the action itself, not of the rescaled one in (0, 1), so
    they compare with the ones of Stable-Baselines3's own distributions.

    Args:
        actions: Number of actions D.
        point: What a deterministic action is, ``"mode"`` or ``"mean"``.

    Raises:
        ValueError: ``point`` is neither.
    """

    distribution: torch.distributions.Beta

    def __init__(self, actions: int, point: str = "mode") -> None:
        if point not in POINTS:
            raise ValueError(f"a deterministic action is 'mode' or 'mean', got {point!r}")
        super().__init__()  # type: ignore[no-untyped-call]
        self.actions = actions
        self.point = point

    def proba_distribution_net(self, latent_dim: int, floor: float) -> BetaHead:
        """The layers that make alpha and beta of ``latent_dim`` features."""
        return BetaHead(latent_dim, self.actions, floor)

    def proba_distribution(self, alpha: Tensor, beta: Tensor) -> BetaDistribution:
        """Take on the concentrations, each (N, D); returns itself."""
        self.distribution = torch.distributions.Beta(alpha, beta)
        return self

    @property
    def alpha(self) -> Tensor:
        """First concentrations (N, D)."""
        return self.distribution.concentration1

    @property
    def beta(self) -> Tensor:
        """Second concentrations (N, D)."""
        return self.distribution.concentration0

    def log_prob(self, actions: Tensor) -> Tensor:
        """Log-likelihood (N,) of actions (N, D) in [-1, 1]."""
        return -beta_nll(self.alpha, self.beta, actions) - self.actions * math.log(2.0)

    def entropy(self) -> Tensor:
        """Entropy (N,) in nats."""
        return beta_entropy(self.alpha, self.beta)

    def sample(self) -> Tensor:
        """Random actions (N, D)."""
        return beta_sample(self.alpha, self.beta)

    def mode(self) -> Tensor:
        """Deterministic actions (N, D): the mode, or the mean where that was asked for."""
        point = beta_mode if self.point == "mode" else beta_mean
        return point(self.alpha, self.beta)

    def actions_from_params(
        self, alpha: Tensor, beta: Tensor, deterministic: bool = False
    ) -> Tensor:
        """Actions (N, D) of given concentrations."""
        return self.proba_distribution(alpha, beta).get_actions(deterministic=deterministic)

    def log_prob_from_params(self, alpha: Tensor, beta: Tensor) -> tuple[Tensor, Tensor]:
        """Random actions (N, D) of given concentrations, and their log-likelihoods (N,)."""
        actions = self.actions_from_params(alpha, beta)
        return actions, self.log_prob(actions)
