"""How behaviour cloning trains: ``TrainingConfig``."""

from __future__ import annotations

from dataclasses import dataclass

from bev_driving_env.training.settings import TrainingSettings

WEIGHTINGS = ("none", "kde")


@dataclass(frozen=True)
class TrainingConfig(TrainingSettings):
    """How to train a policy; the fields are those of every training."""
