"""Independent Beta distributions over actions in [-1, 1]: likelihood, mode, mean, entropy, KL.

``alpha`` and ``beta`` describe x = (action + 1) / 2 in (0, 1). Functions of the whole action sum
over its dimensions, the last axis.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

EPSILON = 1e-6
"""How near to 0 and 1 a rescaled action may come; at the ends themselves the density is 0 or
infinite."""


def beta_nll(alpha: Tensor, beta: Tensor, action: Tensor) -> Tensor:
    """Negative log-likelihood of actions, the loss of behaviour cloning before its mean.

    The density is the one of the rescaled action (action + 1) / 2 in (0, 1), as in the paper. The
    density of the action itself is half of it per dimension: add ``log 2`` for each.

    Args:
        alpha: First concentrations (..., D), positive.
        beta: Second concentrations (..., D), positive.
        action: Actions (..., D) in [-1, 1]; the rescaled ones are clamped to ``EPSILON`` from
            both ends.

    Returns:
        One value per sample (...,), in nats, in the precision of ``alpha``.

    Raises:
        ValueError: The shapes differ.

    >>> uniform = torch.ones(1, 2)
    >>> beta_nll(uniform, uniform, torch.tensor([[-1.0, 0.3]])).tolist()
    [0.0]
    """
    if not alpha.shape == beta.shape == action.shape:
        # broadcasting (N, 2) with (N,) would silently give a loss over pairs of samples
        raise ValueError(
            "alpha, beta and action must have one shape (..., D), got "
            f"{tuple(alpha.shape)}, {tuple(beta.shape)} and {tuple(action.shape)}"
        )
    a, b, chosen = _wide(alpha), _wide(beta), _wide(action)
    # both distances from the action itself: 1 - x would lose them near x = 1
    log_x = torch.log((0.5 * (1.0 + chosen)).clamp(EPSILON, 1.0 - EPSILON))
    log_rest = torch.log((0.5 * (1.0 - chosen)).clamp(EPSILON, 1.0 - EPSILON))
    nll = _log_beta(a, b) - (a - 1.0) * log_x - (b - 1.0) * log_rest
    return nll.sum(dim=-1).to(alpha.dtype)


def beta_mode(alpha: Tensor, beta: Tensor) -> Tensor:
    """Most likely action (..., D); where that is not one point, the mean.

    Both concentrations above 1: the peak. Only one above 1: the end of the interval on its side.
    Neither: the density is flat or highest at both ends, and the mean is taken.
    """
    peaked = (alpha > 1.0) & (beta > 1.0)
    peak = (alpha - beta) / torch.where(peaked, alpha + beta - 2.0, torch.ones_like(alpha))
    action = torch.where(peaked, peak, beta_mean(alpha, beta))
    action = torch.where((alpha <= 1.0) & (beta > 1.0), -torch.ones_like(alpha), action)
    return torch.where((beta <= 1.0) & (alpha > 1.0), torch.ones_like(alpha), action)


def beta_mean(alpha: Tensor, beta: Tensor) -> Tensor:
    """Mean action (..., D)."""
    return (alpha - beta) / (alpha + beta)


def beta_sample(alpha: Tensor, beta: Tensor) -> Tensor:
    """Actions (..., D) drawn with torch's global generator; no gradient flows through them."""
    return 2.0 * torch.distributions.Beta(alpha, beta).sample() - 1.0


def beta_entropy(alpha: Tensor, beta: Tensor) -> Tensor:
    """Differential entropy (...,) of actions in [-1, 1], in nats; log 2 per dimension at most."""
    a, b = _wide(alpha), _wide(beta)
    both = a + b
    entropy = (
        _log_beta(a, b)
        - (a - 1.0) * torch.digamma(a)
        - (b - 1.0) * torch.digamma(b)
        + (both - 2.0) * torch.digamma(both)
        + math.log(2.0)
    )
    return entropy.sum(dim=-1).to(alpha.dtype)


def beta_kl(alpha: Tensor, beta: Tensor, other_alpha: Tensor, other_beta: Tensor) -> Tensor:
    """Kullback-Leibler divergence (...,) of (alpha, beta) from another pair, in nats."""
    a, b, c, d = _wide(alpha), _wide(beta), _wide(other_alpha), _wide(other_beta)
    divergence = (
        _log_beta(c, d)
        - _log_beta(a, b)
        + (a - c) * torch.digamma(a)
        + (b - d) * torch.digamma(b)
        + (c - a + d - b) * torch.digamma(a + b)
    )
    return divergence.sum(dim=-1).to(alpha.dtype)


def _log_beta(alpha: Tensor, beta: Tensor) -> Tensor:
    """Logarithm of the Beta function, elementwise."""
    return torch.lgamma(alpha) + torch.lgamma(beta) - torch.lgamma(alpha + beta)


def _wide(values: Tensor) -> Tensor:
    """The values in double precision, where the device has it.

    The terms of a log-density reach 1e5 for concentrations of 1e4 and all but cancel; float32
    would leave an error of some hundredths.
    """
    return values if values.device.type == "mps" else values.double()
