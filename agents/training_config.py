"""How behaviour cloning trains: ``TrainingConfig``, and the learning rate of each step."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bev_driving_env.checks import require_count, require_positive

PRECISIONS = ("fp32", "bf16")
WARM_UP = 0.15
"""Share of the steps in which the learning rate rises."""


@dataclass(frozen=True)
class TrainingConfig:
    """How to train.

    Attributes:
        steps: Batches in all; the learning rate's cycle spans them.
        batch_size: Samples in a batch, over all processes.
        learning_rate: At its peak.
        weight_decay: AdamW's.
        clip_norm: Longest gradient; longer ones are shortened to it.
        seed: Decides first weights and order of the samples.
        precision: ``"fp32"``, or ``"bf16"`` for autocast to bfloat16.
        validate_every: Steps between validations.
        validation_samples: How many samples they look at, spread evenly over the split.
        patience: Validations without a new best after which training stops.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

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
        if self.precision not in PRECISIONS:
            raise ValueError(
                f"precision must be one of {', '.join(PRECISIONS)}, got {self.precision!r}"
            )


def one_cycle(step: int, steps: int, peak: float) -> float:
    """Learning rate of a step: half a cosine up from peak / 25, then one down to almost 0.

    >>> one_cycle(15, 100, 1.0), round(one_cycle(99, 100, 1.0), 4)
    (1.0, 0.0004)
    """
    rise = WARM_UP * steps
    if step < rise:
        low, high, share = peak / 25.0, peak, step / rise
    else:
        low, high, share = peak, peak / 10000.0, (step - rise) / (steps - rise)
    return low + (high - low) * 0.5 * (1.0 - math.cos(math.pi * share))
