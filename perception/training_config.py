"""How predictors are trained: ``TrainingConfig``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bev_driving_env.checks import is_number, require_positive
from bev_driving_env.training.kde import BANDWIDTH, FINEST
from bev_driving_env.training.settings import PRECISIONS, TrainingSettings

LOSSES = ("bce", "bce_dice")
LOOKS = ("log", "random", "wild")
WEIGHTINGS = ("none", "kde", "actors", "kde+actors")


@dataclass(frozen=True)
class TrainingConfig(TrainingSettings):
    """How to train a predictor; sized for an hour or two on a laptop's processor.

    Attributes beside those of every training:
        precision: Beside ``"fp32"`` and ``"bf16"``, ``"auto"``: bf16 where it is faster.
        loss: ``"bce"`` as in the paper, or ``"bce_dice"``.
        weighting: ``"none"``; ``"kde"``, by the density of the expert's actions as in the paper;
            ``"actors"``, in the actors' channels by how many of them there are; or
            ``"kde+actors"``, both.
        bandwidth: Of the KDE, in units of the action.
        clip: Largest weight of the KDE, in means; None: no limit.
        temper: Exponent of the KDE's weights, 1 as in the paper, 0 makes all equal.
        looks: ``"random"``: every sample has a look of its own, drawn from those for training;
            ``"wild"``: one with any colours and light; ``"log"``: that of the drive.
        flips: Whether half of the samples are mirrored.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    precisions: ClassVar[tuple[str, ...]] = ("auto", *PRECISIONS)

    steps: int = 10_000
    batch_size: int = 8
    learning_rate: float = 1.5e-3
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
        super().__post_init__()
        require_positive("bandwidth", self.bandwidth)
        choices = {"loss": LOSSES, "weighting": WEIGHTINGS, "looks": LOOKS}
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
