"""What a training leaves behind: options, progress bar, metrics, checkpoint, weights and card."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from bev_driving_env.checks import is_int
from bev_driving_env.files import write_text
from bev_driving_env.provenance import provenance
from bev_driving_env.training.optimisation import Measured
from bev_driving_env.training.progress import Progress, as_csv

from .models.presets import ModelSpec
from .training import Trainer, Validation
from .training_config import TrainingConfig
from .weights import Predictor, save_predictor

CHECKPOINT, WEIGHTS, METRICS = "checkpoint.pt", "predictor.safetensors", "metrics.csv"


@dataclass(frozen=True)
class TrainOptions:
    """Options of ``bev-perception train``.

    Attributes:
        preset: Name of the network.
        data: Folders of drive logs.
        out: Folder for the predictor.
        start: Predictor to start from, if any.
        spec: The network.
        training: How to train.
        workers: Processes that render.
        until: Step to stop after; None for the last one.
        checkpoint_s: Seconds between checkpoints.
        device: Where.
        overwrite: Discard what the output folder holds.
        tensorboard: Also write TensorBoard events.

    Raises:
        ValueError: A value is out of range.
    """

    preset: str
    data: tuple[Path, ...]
    out: Path
    start: Path | None
    spec: ModelSpec
    training: TrainingConfig
    workers: int
    until: int | None
    checkpoint_s: float
    device: torch.device
    overwrite: bool
    tensorboard: bool

    def __post_init__(self) -> None:
        if not (is_int(self.workers) and self.workers >= 0):
            raise ValueError(f"--workers must be at least 0, got {self.workers}")
        last = self.training.steps
        if self.until is not None and not 1 <= self.until <= last:
            raise ValueError(f"--until must be from 1 to --steps {last}, got {self.until}")
        if not self.checkpoint_s > 0.0:
            raise ValueError(f"--checkpoint-minutes must be positive, got {self.checkpoint_s / 60}")


class Report(Progress):
    """Progress, metrics and files of a training; silent in all processes but the first.

    Args:
        options: Of the training.
        argv: Arguments of the command.
        trainer: The training.
        chief: Whether this is the process that shows and writes.
        samples: How many samples there are to learn from.
        effective: Effective sample size of each channel; None: all samples count the same.
        origin: What the card shall say about the predictor that training started from.
    """

    def __init__(
        self,
        options: TrainOptions,
        argv: Sequence[str],
        trainer: Trainer,
        chief: bool,
        samples: int,
        effective: Mapping[str, float] | None,
        origin: Mapping[str, Any] | None = None,
    ) -> None:
        self._options, self._argv, self._trainer, self._chief = options, argv, trainer, chief
        self._samples, self._effective, self._origin = samples, effective, origin
        self._channels = trainer.spec.config.channels
        self._before = (0.0, 0.0)
        events = options.out if options.tensorboard else None
        super().__init__(options.training.steps, trainer.step, chief, events)

    def validated(self, measured: Measured, found: Validation) -> None:
        """Add a row."""
        trainer = self._trainer
        thresholds = found.thresholds()
        row = {
            "step": float(trainer.step),
            "samples": float(trainer.step * self._options.training.batch_size),
            "minutes": trainer.trained_s / 60.0,
            "train_loss": float(self.smoothed or 0.0),
            "validation_loss": found.loss,
            **self._named("loss", found.channel_losses),
            **self._named("iou", found.iou()),
            **self._named("threshold", thresholds),
            **self._named("tuned_iou", found.iou(thresholds)),
            "learning_rate": measured.learning_rate,
            "gradient_norm": measured.gradient_norm,
            "waiting_share": self._waiting_share(),
        }
        trainer.rows.append(row)
        shown = ("train_loss", "validation_loss", *self._names("iou"))
        self.note(row, shown)

    def _names(self, kind: str) -> list[str]:
        return [f"{kind}_{name}" for name in self._channels]

    def _named(self, kind: str, values: Any) -> dict[str, float]:
        return dict(zip(self._names(kind), map(float, values), strict=True))

    def _waiting_share(self) -> float:
        """That since the row before."""
        pace = self._trainer.pace
        seconds, waited_s = pace.seconds - self._before[0], pace.waited_s - self._before[1]
        self._before = (pace.seconds, pace.waited_s)
        return waited_s / seconds if seconds else 0.0

    def keep(self) -> None:
        """Write checkpoint, metrics and the best predictor."""
        if not self._chief:
            return
        options, trainer = self._options, self._trainer
        write_text(options.out / METRICS, as_csv(trainer.rows))
        best = self._best_row()
        chosen = tuple(best[name] if best else 0.5 for name in self._names("threshold"))
        spec = trainer.spec
        model = trainer.best_model()
        predictor = Predictor(spec, model, chosen, spec.camera_size, self._card(best))
        save_predictor(predictor, options.out / WEIGHTS)
        # last, so that with a checkpoint of the last step nothing else is missing
        trainer.save(options.out / CHECKPOINT)

    def _best_row(self) -> dict[str, float] | None:
        """That of the weights that are kept; None while nothing was validated."""
        return min(self._trainer.rows, key=lambda row: row["validation_loss"], default=None)

    def _card(self, best: Mapping[str, float] | None) -> dict[str, Any]:
        """What the weights file says about where it came from."""
        options, trainer, config = self._options, self._trainer, self._trainer.config
        seen = trainer.step * config.batch_size
        return {
            **provenance(self._argv, [config.seed]),
            "command": shlex.join(["bev-perception", *self._argv]),
            "preset": options.preset,
            "data": [str(folder) for folder in options.data],
            "started_from": None if self._origin is None else dict(self._origin),
            "first_frame": trainer.batches_before * config.batch_size,
            "samples": seen,
            # every epoch goes through all samples once
            "distinct_frames": min(seen, self._samples),
            "steps": trainer.step,
            "best_step": None if best is None else int(best["step"]),
            "batch_size": config.batch_size,
            "hours": round(trainer.trained_s / 3600.0, 4),
            "precision": config.precision,
            "loss": config.loss,
            "looks": config.looks,
            "flips": config.flips,
            "weighting": config.weighting,
            "weighting_settings": {
                "bandwidth": config.bandwidth,
                "clip": config.clip,
                "temper": config.temper,
            },
            "effective_sample_size": None if self._effective is None else dict(self._effective),
            "validation": None if best is None else self._measured(best),
        }

    def _measured(self, best: Mapping[str, float]) -> dict[str, Any]:
        """Loss and IoU of the weights that are kept; None for IoU of channels with nothing."""

        def by_channel(kind: str) -> dict[str, float | None]:
            values = {name: best[f"{kind}_{name}"] for name in self._channels}
            return {k: round(v, 4) if math.isfinite(v) else None for k, v in values.items()}

        return {
            "loss": best["validation_loss"],
            "iou_at_0.5": by_channel("iou"),
            "iou": by_channel("tuned_iou"),
        }

    def summary(self) -> str:
        """One line about the whole training, and one about this session's pace."""
        trainer, best = self._trainer, self._best_row()
        line = f"{self._options.out / WEIGHTS}: "
        if best is not None:
            iou = ", ".join(f"{name} {best[f'tuned_iou_{name}']:.3f}" for name in self._channels)
            line += f"validation loss {best['validation_loss']:.4f}, IoU {iou}, "
        line += f"after {trainer.step} steps in {trainer.trained_s / 60:.1f} minutes"
        pace = trainer.pace
        if pace.frames:
            line += (
                f"\npace: {pace.frames_per_s:.1f} frames/s in {trainer.config.precision}, "
                f"{pace.waiting_share:.0%} of the time spent waiting for samples"
            )
        return line
