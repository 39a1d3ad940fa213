"""How PPO trains a Beta policy: ``PPOConfig``, and the two sets of numbers that are recommended."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bev_driving_env.checks import require_count, require_positive


@dataclass(frozen=True)
class PPOConfig:
    """Numbers of proximal policy optimisation; the defaults are for training from scratch.

    Attributes:
        steps: Of all worlds together.
        worlds: Stepped together.
        horizon: Steps of each world between two updates.
        batch_size: Samples in a gradient step.
        epochs: How often each sample is learned from.
        learning_rate: At the start; it falls linearly to a tenth.
        gamma: Discount of a step.
        gae_lambda: Of generalised advantage estimation.
        clip_range: Of the ratio of likelihoods.
        entropy_weight: In the loss.
        target_kl: An update stops early once the policy has moved this far; None never.
        critic_steps: Steps at the start in which only the critic learns, so that a policy that
            drives already is not unlearned by the advantages of a critic that knows nothing.
        seed: Of weights, worlds and samples.
        validate_every: Steps between two drives of the validation routes.
        validation_routes: How many of the town's ``val`` split.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    steps: int = 150_000
    worlds: int = 16
    horizon: int = 128
    batch_size: int = 256
    epochs: int = 3
    learning_rate: float = 3e-4
    gamma: float = 0.97
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_weight: float = 0.003
    target_kl: float | None = None
    critic_steps: int = 0
    seed: int = 0
    validate_every: int = 8192
    validation_routes: int = 20

    def __post_init__(self) -> None:
        for name in (
            *("steps", "worlds", "horizon", "batch_size", "epochs"),
            *("validate_every", "validation_routes"),
        ):
            require_count(name, getattr(self, name))
        for name in ("learning_rate", "clip_range"):
            require_positive(name, getattr(self, name))
        if self.target_kl is not None:
            require_positive("target_kl", self.target_kl)
        for name in ("gamma", "gae_lambda"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be above 0 and at most 1, got {getattr(self, name)}")
        if not 0.0 <= self.entropy_weight < math.inf:
            raise ValueError(f"entropy_weight must be at least 0, got {self.entropy_weight!r}")
        for name in ("critic_steps", "seed"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must be at least 0, got {getattr(self, name)}")
        if self.rollout % self.batch_size:
            raise ValueError(
                f"batch_size {self.batch_size} must divide worlds x horizon, "
                f"{self.worlds} x {self.horizon} = {self.rollout}"
            )

    @property
    def rollout(self) -> int:
        """Samples between two updates."""
        return self.worlds * self.horizon


FROM_SCRATCH = PPOConfig()
FINE_TUNING = replace(
    FROM_SCRATCH,
    steps=49_152,
    learning_rate=3e-5,
    entropy_weight=0.0,
    target_kl=0.02,
    critic_steps=8192,
)
