"""Behaviour cloning: likelihood of the expert's actions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.spaces import observation_space
from bev_driving_env.training.optimisation import Measured, Optimisation

from .batches import Batch, RenderedBatches, SampleSet
from .beta import beta_nll
from .network import NetworkConfig
from .policy import BetaPolicy
from .training_config import TrainingConfig


def new_policy(network: NetworkConfig, seed: int) -> BetaPolicy:
    """An untrained policy; the first weights follow from the seed."""
    torch.manual_seed(seed)
    size = network.bev_size
    return BetaPolicy(
        observation_space(BEVGeometry(size=size, ego_row=size * 152 // 192), np.inf),
        gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
        lambda _: 3e-4,
        **network.policy_kwargs,
    )


class Trainer(Optimisation):
    """Trains a new policy.

    Args:
        config: How to train.
        network: What the policy sees.
        device: Where.

    Attributes:
        policy: The policy as it is now.
        actor: What of it is trained.

    Raises:
        TrainingError: The batch cannot be shared evenly by the processes.
    """

    def __init__(
        self, config: TrainingConfig, network: NetworkConfig, device: torch.device | None = None
    ) -> None:
        self.config, self.network = config, network
        device = device or torch.device("cpu")
        self.policy = new_policy(network, config.seed).to(device)
        self.actor = self.policy.actor()
        super().__init__(self.actor, config, {**asdict(config), **network.as_json()}, device)

    def train(self, samples: SampleSet, until: int) -> Iterator[Measured]:
        """Train up to a step; yields after each, when all is in order to be kept.

        Args:
            samples: What to learn from.
            until: Step to stop before.
        """
        config = self.config
        span, share = (self.step, until), (self.rank, self.ranks)
        with RenderedBatches(samples, config.batch_size, config.seed, span, *share) as batches:
            began = time.monotonic()
            for _, batch in batches:
                measured = self.learn(batch.to(self.device))
                self.trained_s += time.monotonic() - began
                yield measured
                began = time.monotonic()

    def learn(self, batch: Batch) -> Measured:
        """One step on a batch."""

        def loss_of(actor: nn.Module) -> Tensor:
            with self.autocast():
                alpha, beta = actor(batch.bev, batch.measurements)
            nll = beta_nll(alpha.float(), beta.float(), batch.actions)
            return (batch.weights * nll).mean()

        return self.update(loss_of)

    def validate(self, samples: SampleSet) -> float:
        """Mean NLL of a split; the weights are kept if it is the least so far."""
        count = min(len(samples), self.config.validation_samples)
        numbers = np.linspace(0, len(samples) - 1, count).astype(np.int64)
        total = torch.zeros(2, dtype=torch.float64)
        self.actor.eval()
        with torch.inference_mode():
            for part in np.array_split(numbers, max(1, count // 128))[self.rank :: self.ranks]:
                batch = samples.batch(part).to(self.device)
                alpha, beta = self.actor(batch.bev, batch.measurements)
                nll = beta_nll(alpha, beta, batch.actions)
                total += torch.tensor([nll.double().sum().item(), len(part)], dtype=torch.float64)
        if self.ranks > 1:
            dist.all_reduce(total)
        value = float(total[0] / total[1])
        self.judge(value)
        return value

    def best_policy(self) -> BetaPolicy:
        """A policy with the best weights; the last ones while nothing was validated."""
        policy = new_policy(self.network, self.config.seed).to(self.device)
        policy.actor().load_state_dict(self.best_weights())
        policy.set_training_mode(False)
        return policy
