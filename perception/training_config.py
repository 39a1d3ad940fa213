"""How predictors are trained: ``TrainingConfig``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bev_driving_env.checks import is_number, require_count, require_positive

from .kde import BANDWIDTH, FINEST

LOSSES = ("bce", "bce_dice")
LOOKS = ("log", "random")
PRECISIONS = ("auto", "fp32", "bf16")
WEIGHTINGS = ("none", "kde", "actors", "kde+actors")


@dataclass(frozen=True)
class TrainingConfig:
    """How to train; sized for an hour or two on a laptop's processor.

    Attributes:
        steps: Batches in all; the learning rate's cycle spans them.
        batch_size: Samples in a batch, over all processes.
        learning_rate: At its peak.
        weight_decay: AdamW's.
        clip_norm: Longest gradient; longer ones are shortened to it.
        seed: Decides first weights, order of the samples, their looks and flips.
        precision: ``"fp32"``, ``"bf16"`` for autocast to bfloat16, or ``"auto"``: bf16 where it is
            faster.
        validate_every: Steps between validations.
        validation_samples: How many samples they look at, spread evenly over the split.
        patience: Validations without a new best after which training stops.
        loss: ``"bce"`` as in the paper, or ``"bce_dice"``.
        weighting: ``"none"``; ``"kde"``, by the density of the expert's actions as in the paper;
            ``"actors"``, in the actors' channels by how many of them there are; or
            ``"kde+actors"``, both.
        bandwidth: Of the KDE, in units of the action.
        clip: Largest weight of the KDE, in means; None: no limit.
        temper: Exponent of the KDE's weights, 1 as in the paper, 0 makes all equal.
        looks: ``"random"``: every sample has a look of its own; ``"log"``: that of the drive.
        flips: Whether half of the samples are mirrored.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    steps: int = 10_000
    batch_size: int = 8
    learning_rate: float = 1.5e-3
    weight_decay: float = 1e-4
    clip_norm: float = 1.0
    seed: int = 0
    precision: str = "auto"
    validate_every: int = 500
    validation_samples: int = 256
    patience: int = 20
    loss: str = "bce"
    weighting: str = "none"
    bandwidth: float = BANDWIDTH
    clip: float | None = None
    temper: float = 1.0
    looks: str = "random"
    flips: bool = True

    def __post_init__(self) -> None:
        for name in ("steps", "batch_size", "validate_every", "validation_samples", "patience"):
            require_count(name, getattr(self, name))
        for name in ("learning_rate", "clip_norm", "bandwidth"):
            require_positive(name, getattr(self, name))
        if not (0.0 <= self.weight_decay < math.inf):
            raise ValueError(f"weight_decay must be at least 0, got {self.weight_decay!r}")
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0, got {self.seed!r}")
        choices = {
            "precision": PRECISIONS,
            "loss": LOSSES,
            "weighting": WEIGHTINGS,
            "looks": LOOKS,
        }
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise ValueError(
                    f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}"
                )
        self._check_kde()

    def _check_kde(self) -> None:
        if self.bandwidth < FINEST:
            raise ValueError(f"bandwidth must be at least {FINEST}, got {self.bandwidth!r}")
        if self.clip is not None and not (is_number(self.clip) and self.clip >= 1.0):
            raise ValueError(f"clip must be at least 1 (times the mean), got {self.clip!r}")
        if not (is_number(self.temper) and 0.0 <= self.temper <= 1.0):
            raise ValueError(f"temper must be from 0 to 1, got {self.temper!r}")
