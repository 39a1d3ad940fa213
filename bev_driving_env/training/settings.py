"""``TrainingSettings``: the numbers that every training has; needs no PyTorch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ..checks import require_count, require_positive

PRECISIONS = ("fp32", "bf16")


@dataclass(frozen=True)
class TrainingSettings:
    """How to train; what is trained adds its own fields and defaults.

    Attributes:
        steps: Batches in all; the learning rate's cycle spans them.
        batch_size: Samples in a batch, over all processes.
        learning_rate: At its peak.
        weight_decay: AdamW's.
        clip_norm: Longest gradient; longer ones are shortened to it.
        seed: Decides first weights, order of the samples, and all else that is random.
        precision: ``"fp32"``, or ``"bf16"`` for autocast to bfloat16.
        validate_every: Steps between validations.
        validation_samples: How many samples they look at, spread evenly over the split.
        patience: Validations without a new best after which training stops.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    precisions: ClassVar[tuple[str, ...]] = PRECISIONS

    steps: int = 4000
    batch_size: int = 128
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    clip_norm: float = 1.0
    seed: int = 0
    precision: str = "fp32"
    validate_every: int = 200
    validation_samples: int = 1024
    patience: int = 10

    def __post_init__(self) -> None:
        for name in ("steps", "batch_size", "validate_every", "validation_samples", "patience"):
            require_count(name, getattr(self, name))
        for name in ("learning_rate", "clip_norm"):
            require_positive(name, getattr(self, name))
        if not (0.0 <= self.weight_decay < math.inf):
            raise ValueError(f"weight_decay must be at least 0, got {self.weight_decay!r}")
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0, got {self.seed!r}")
        if self.precision not in self.precisions:
            raise ValueError(
                f"precision must be one of {', '.join(self.precisions)}, got {self.precision!r}"
            )
