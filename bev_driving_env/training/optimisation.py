"""``Optimisation``: what changes while a network is trained, resumable to the bit.

The learning rate is a function of the step, and so must the order of the samples be; then a
training that was stopped goes on exactly as if it had not been.
"""

from __future__ import annotations

import io
import math
import pickle
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from ..files import write_bytes
from .processes import process_rank
from .schedule import one_cycle
from .settings import TrainingSettings

FORMAT, VERSION = "bevtown-training", 1

Weights = dict[str, Tensor]


class TrainingError(ValueError):
    """Training cannot start or go on; the message says why, and the cure."""


@dataclass(frozen=True)
class Measured:
    """What one step showed.

    Attributes:
        loss: Of the batch before the step.
        gradient_norm: Before it was clipped.
        learning_rate: Of the step.
    """

    loss: float
    gradient_norm: float
    learning_rate: float


class Optimisation:
    """AdamW with one cycle of the learning rate; every process of a ``torchrun`` makes one.

    Args:
        module: What is trained, on its device.
        settings: The numbers.
        identity: What makes two trainings the same, so that one may go on with the other.
        device: Where.

    Attributes:
        module: See above.
        step: Steps done.
        best_value: Least value judged so far; infinite while there is none.
        rows: What was measured at each validation.
        trained_s: Time spent training.
        rank: Number of this process.
        ranks: How many share each batch.

    Raises:
        TrainingError: The batch cannot be shared evenly by the processes.
    """

    def __init__(
        self,
        module: nn.Module,
        settings: TrainingSettings,
        identity: Mapping[str, Any],
        device: torch.device,
    ) -> None:
        self.rank, self.ranks = process_rank()
        if settings.batch_size % self.ranks:
            raise TrainingError(
                f"a batch of {settings.batch_size} cannot be shared evenly by {self.ranks} "
                "processes: change --batch-size"
            )
        self.module, self.device = module, device
        self._settings, self._identity = settings, dict(identity)
        self._shared = DistributedDataParallel(module) if self.ranks > 1 else module
        self._optimizer = torch.optim.AdamW(
            module.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        self.step = 0
        self.best_value = math.inf
        self._best = _copied(module.state_dict())
        self.rows: list[dict[str, float]] = []
        self._stale = 0
        self.trained_s = 0.0

    @property
    def exhausted(self) -> bool:
        """Whether nothing better was judged for so long that training stops early."""
        return self._stale >= self._settings.patience

    def autocast(self) -> AbstractContextManager[Any]:
        """Context in which the network computes in the precision asked for."""
        half = self._settings.precision == "bf16"
        return torch.autocast(self.device.type, torch.bfloat16, enabled=half)

    def update(self, loss_of: Callable[[nn.Module], Tensor]) -> Measured:
        """One step.

        Args:
            loss_of: Calls the module it is given, once, and returns the loss.

        Raises:
            TrainingError: The gradient is not finite.
        """
        settings = self._settings
        rate = one_cycle(self.step, settings.steps, settings.learning_rate)
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        self._shared.train()
        loss = loss_of(self._shared)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(self.module.parameters(), settings.clip_norm)
        if not torch.isfinite(norm):
            raise TrainingError(
                f"the gradient of step {self.step} is not finite (loss {loss.item()}): "
                "lower --learning-rate"
            )
        self._optimizer.step()
        self.step += 1
        return Measured(loss.item(), float(norm), rate)

    def judge(self, value: float) -> None:
        """Keep the weights if a value of theirs, such as a loss in validation, is the least."""
        self._stale += 1
        if value < self.best_value:
            self.best_value, self._stale = value, 0
            self._best = _copied(self.module.state_dict())

    def forget_best(self) -> None:
        """Let the next value judged be the best: what was best before counts no more."""
        self.best_value, self._stale = math.inf, 0

    def best_weights(self) -> Weights:
        """The best weights; the last ones while nothing was judged."""
        return self._best if math.isfinite(self.best_value) else self.module.state_dict()

    def save(self, path: Path) -> None:
        """Write all that going on needs; an interruption leaves the old file or the new one."""
        kept = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self._identity,
            "step": self.step,
            "weights": self.module.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "best": self._best,
            "best_value": self.best_value,
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
        theirs = dict(kept["identity"])
        for name, value in self._identity.items():
            if theirs.get(name) != value:
                raise TrainingError(
                    f"{path} is of a training with {name} {theirs.get(name)!r}, this one has "
                    f"{value!r}: choose another --out, or add --overwrite"
                )
        try:
            self.module.load_state_dict(kept["weights"])
            self._optimizer.load_state_dict(kept["optimizer"])
            self.step, self.best_value = int(kept["step"]), float(kept["best_value"])
            self._best, self.rows = dict(kept["best"]), list(kept["rows"])
            self._stale, self.trained_s = int(kept["stale"]), float(kept["trained_s"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise TrainingError(f"{path} is damaged ({error!r}): add --overwrite") from error


def _read(path: Path, device: torch.device) -> dict[str, Any]:
    """Content of a checkpoint, of which loading executes nothing."""
    try:
        kept = torch.load(path, map_location=device, weights_only=True)
    except FileNotFoundError:
        raise TrainingError(f"there is no checkpoint {path}") from None
    except (OSError, EOFError, RuntimeError, ValueError, pickle.UnpicklingError) as error:
        raise TrainingError(f"{path} is damaged or no checkpoint of BEVTown: {error}") from error
    if not isinstance(kept, dict) or kept.get("format") != FORMAT:
        raise TrainingError(f"{path} is not a checkpoint of BEVTown's training")
    if not isinstance(kept.get("version"), int) or kept["version"] > VERSION:
        raise TrainingError(
            f"{path} is of version {kept.get('version')!r}, this BEVTown reads up to {VERSION}: "
            "update BEVTown"
        )
    return kept


def _copied(weights: Mapping[str, Tensor]) -> Weights:
    return {name: value.detach().clone() for name, value in weights.items()}
