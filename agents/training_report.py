"""What a training leaves behind: options, progress bar, metrics, checkpoint, weights and card."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from bev_driving_env.files import write_text
from bev_driving_env.provenance import provenance
from bev_driving_env.training.optimisation import Measured
from bev_driving_env.training.progress import Progress, as_csv

from .checkpoint import save_weights
from .network import NetworkConfig
from .training import Trainer
from .training_config import TrainingConfig

CHECKPOINT, WEIGHTS, METRICS = "checkpoint.pt", "policy.safetensors", "metrics.csv"


@dataclass(frozen=True)
class TrainOptions:
    """Options of ``bev-agents train``.

    Attributes:
        data: Folders of drive logs.
        out: Folder for the policy.
        network: What the policy sees.
        training: How to train.
        weighting: ``"none"`` or ``"kde"``.
        dagger: Rounds in which the policy drives and the expert labels.
        checkpoint_s: Seconds between checkpoints.
        device: Where.
        overwrite: Discard what the output folder holds.
        tensorboard: Also write TensorBoard events.
    """

    data: tuple[Path, ...]
    out: Path
    network: NetworkConfig
    training: TrainingConfig
    weighting: str
    dagger: int
    checkpoint_s: float
    device: torch.device
    overwrite: bool
    tensorboard: bool

    def __post_init__(self) -> None:
        if self.dagger < 0:
            raise ValueError(f"--dagger must be at least 0, got {self.dagger}")
        if self.dagger >= self.training.steps:
            raise ValueError(
                f"--dagger {self.dagger} needs more --steps than that, got {self.training.steps}: "
                "each round is followed by some"
            )
        if not self.checkpoint_s > 0.0:
            raise ValueError(f"--checkpoint-minutes must be positive, got {self.checkpoint_s / 60}")

    def ends(self) -> list[int]:
        """Step at which each phase ends: one before each DAgger round, and one after the last.

        One learning-rate cycle spans them, so that the last part of it learns from all rounds.
        """
        phases = self.dagger + 1
        return [self.training.steps * (phase + 1) // phases for phase in range(phases)]


class Report(Progress):
    """Progress, metrics and files of a training; silent in all processes but the first."""

    def __init__(
        self, options: TrainOptions, argv: Sequence[str], trainer: Trainer, chief: bool
    ) -> None:
        self._options, self._argv, self._trainer, self._chief = options, argv, trainer, chief
        events = options.out if options.tensorboard else None
        super().__init__(options.training.steps, trainer.step, chief, events)

    def validated(self, measured: Measured, value: float) -> None:
        """Add a row."""
        trainer = self._trainer
        row = {
            "step": float(trainer.step),
            "samples": float(trainer.step * self._options.training.batch_size),
            "minutes": trainer.trained_s / 60.0,
            "train_nll": float(self.smoothed or 0.0),
            "validation_nll": value,
            "learning_rate": measured.learning_rate,
            "gradient_norm": measured.gradient_norm,
        }
        trainer.rows.append(row)
        self.note(row, ("train_nll", "validation_nll"))

    def keep(self) -> None:
        """Write checkpoint, metrics and the best policy."""
        if not self._chief:
            return
        options, trainer = self._options, self._trainer
        write_text(options.out / METRICS, as_csv(trainer.rows))
        save_weights(trainer.best_policy(), options.out / WEIGHTS, self._card())
        # last, so that with a checkpoint of the last step nothing else is missing
        trainer.save(options.out / CHECKPOINT)

    def _card(self) -> dict[str, Any]:
        """What the weights file says about where it came from."""
        options, trainer = self._options, self._trainer
        note = provenance(self._argv, [options.training.seed])
        # none right after a DAgger round: what was best before it counts no more
        validated = math.isfinite(trainer.best_value)
        return {
            **note,
            "command": shlex.join(["bev-agents", *self._argv]),
            "data": [str(folder) for folder in options.data],
            "weighting": options.weighting,
            "dagger_rounds": sum(trainer.step > end for end in options.ends()[:-1]),
            "steps": trainer.step,
            "hours": round(trainer.trained_s / 3600.0, 4),
            "validation_nll": trainer.best_value if validated else None,
        }
