"""What every training's numbers must be."""

from dataclasses import dataclass

import pytest

from bev_driving_env.training.settings import TrainingSettings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"batch_size": 0}, "batch_size must be"),
        ({"clip_norm": -1.0}, "clip_norm must be"),
        ({"weight_decay": float("inf")}, "weight_decay must be at least 0, got inf"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"precision": "auto"}, "precision must be one of fp32, bf16, got 'auto'"),
    ],
)
def test_numbers_out_of_range_are_named(changes, message):
    with pytest.raises(ValueError, match=message):
        TrainingSettings(**changes)


def test_a_training_may_know_more_precisions():
    @dataclass(frozen=True)
    class Other(TrainingSettings):
        precisions = ("fp8",)
        precision: str = "fp8"

    assert Other().precision == "fp8"
    with pytest.raises(ValueError, match="one of fp8, got 'fp32'"):
        Other(precision="fp32")
