"""Behaviour cloning: likelihood of the expert's actions, one cycle, resumable to the bit.

``Trainer`` holds what changes (network, optimizer, step, the best weights so far); the learning
rate and the order of the samples are functions of the step.
"""

from __future__ import annotations

import io
import math
import pickle
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from bev_driving_env.files import write_bytes
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.spaces import observation_space

from .batches import Batch, RenderedBatches, SampleSet
from .beta import beta_nll
from .network import NetworkConfig
from .policy import BetaPolicy
from .processes import process_rank
from .training_config import TrainingConfig, one_cycle

FORMAT, VERSION = "bevtown-training", 1


class TrainingError(ValueError):
    """Training cannot start or go on; the message says why, and the cure."""


@dataclass(frozen=True)
class Measured:
    """What one step showed.

    Attributes:
        nll: Loss of the batch before the step.
        gradient_norm: Before it was clipped.
        learning_rate: Of the step.
    """

    nll: float
    gradient_norm: float
    learning_rate: float


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


class Trainer:
    """Trains a new policy; every process of a ``torchrun`` makes one.

    Args:
        config: How to train.
        network: What the policy sees.
        device: Where.

    Attributes:
        policy: The policy as it is now.
        step: Steps done.
        best_nll: Least validation NLL so far.
        rows: What was measured at each validation.

    Raises:
        TrainingError: The batch cannot be shared evenly by the processes.
    """

    def __init__(
        self, config: TrainingConfig, network: NetworkConfig, device: torch.device | None = None
    ) -> None:
        self.rank, self.ranks = process_rank()
        if config.batch_size % self.ranks:
            raise TrainingError(
                f"a batch of {config.batch_size} cannot be shared evenly by {self.ranks} "
                "processes: change --batch-size"
            )
        self.config, self.network = config, network
        self.device = device or torch.device("cpu")
        self.policy = new_policy(network, config.seed).to(self.device)
        self.actor = self.policy.actor()
        self._module: nn.Module = self.actor
        if self.ranks > 1:
            self._module = DistributedDataParallel(self.actor)
        self._optimizer = torch.optim.AdamW(
            self.actor.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.step = 0
        self.best_nll = math.inf
        self.best = _copied(self.actor.state_dict())
        self.rows: list[dict[str, float]] = []
        self._stale = 0
        self.trained_s = 0.0

    @property
    def exhausted(self) -> bool:
        """Whether validation has not improved for so long that training stops early."""
        return self._stale >= self.config.patience

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
                measured = self._learn(batch.to(self.device))
                self.step += 1
                self.trained_s += time.monotonic() - began
                yield measured
                began = time.monotonic()

    def _learn(self, batch: Batch) -> Measured:
        config = self.config
        rate = one_cycle(self.step, config.steps, config.learning_rate)
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        self._module.train()
        with torch.autocast(self.device.type, torch.bfloat16, enabled=config.precision == "bf16"):
            alpha, beta = self._module(batch.bev, batch.measurements)
        loss = (batch.weights * beta_nll(alpha.float(), beta.float(), batch.actions)).mean()
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(self.actor.parameters(), config.clip_norm)
        if not torch.isfinite(norm):
            raise TrainingError(
                f"the gradient of step {self.step} is not finite (loss {loss.item()}): "
                "lower --learning-rate"
            )
        self._optimizer.step()
        return Measured(loss.item(), float(norm), rate)

    def validate(self, samples: SampleSet) -> float:
        """Mean NLL of a split, and keep the weights if it is the least so far."""
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
        self._stale += 1
        if value < self.best_nll:
            self.best_nll, self._stale, self.best = value, 0, _copied(self.actor.state_dict())
        return value

    def best_policy(self) -> BetaPolicy:
        """A policy with the best weights; the last ones while nothing was validated."""
        policy = new_policy(self.network, self.config.seed).to(self.device)
        weights = self.best if math.isfinite(self.best_nll) else self.actor.state_dict()
        policy.actor().load_state_dict(weights)
        policy.set_training_mode(False)
        return policy

    def save(self, path: Path) -> None:
        """Write all that going on needs; an interruption leaves the old file or the new one."""
        kept = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self._identity(),
            "step": self.step,
            "actor": self.actor.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "best": self.best,
            "best_nll": self.best_nll,
            "stale": self._stale,
            "trained_s": self.trained_s,
            "rows": self.rows,
        }
        buffer = io.BytesIO()
        torch.save(kept, buffer)
        write_bytes(path, buffer.getvalue())

    def restore(self, path: Path) -> None:
        """Go on from a file that :meth:`save` wrote.

        Raises:
            TrainingError: It is damaged, foreign, of a newer version, or of another training.
        """
        kept = _read(path, self.device)
        mine, theirs = self._identity(), kept["identity"]
        for name, value in mine.items():
            if theirs.get(name) != value:
                raise TrainingError(
                    f"{path} is of a training with {name} {theirs.get(name)!r}, this one has "
                    f"{value!r}: choose another --out, or add --overwrite"
                )
        try:
            self.actor.load_state_dict(kept["actor"])
            self._optimizer.load_state_dict(kept["optimizer"])
            self.step, self.best_nll = int(kept["step"]), float(kept["best_nll"])
            self.best, self.rows = dict(kept["best"]), list(kept["rows"])
            self._stale, self.trained_s = int(kept["stale"]), float(kept["trained_s"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise TrainingError(f"{path} is damaged ({error!r}): add --overwrite") from error

    def _identity(self) -> dict[str, Any]:
        """What makes two trainings the same, so that one may go on with the other."""
        return {**asdict(self.config), **self.network.as_json()}


def _read(path: Path, device: torch.device) -> dict[str, Any]:
    """Content of a checkpoint, of which loading executes nothing."""
    try:
        kept = torch.load(path, map_location=device, weights_only=True)
    except FileNotFoundError:
        raise TrainingError(f"there is no checkpoint {path}") from None
    except (OSError, EOFError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
        raise TrainingError(f"{path} is damaged or no checkpoint of bev-agents: {error}") from error
    if not isinstance(kept, dict) or kept.get("format") != FORMAT:
        raise TrainingError(f"{path} is not a checkpoint of bev-agents train")
    if not isinstance(kept.get("version"), int) or kept["version"] > VERSION:
        raise TrainingError(
            f"{path} is of version {kept.get('version')!r}, this BEVTown reads up to {VERSION}: "
            "update BEVTown"
        )
    return kept


def _copied(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.detach().clone() for name, value in weights.items()}
