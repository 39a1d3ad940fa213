"""How training is configured."""

import pytest

from perception import losses, samples
from perception.training_config import LOOKS, LOSSES, TrainingConfig


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 0}, "steps must be an int of at least 1, got 0"),
        ({"patience": 0}, "patience"),
        ({"learning_rate": 0.0}, "learning_rate must be a positive number"),
        ({"weight_decay": -1.0}, "weight_decay must be at least 0"),
        ({"seed": -1}, "seed must be at least 0"),
        ({"precision": "fp8"}, "precision must be one of auto, fp32, bf16, got 'fp8'"),
        ({"loss": "mse"}, "loss must be one of bce, bce_dice, got 'mse'"),
        ({"weighting": "all"}, "weighting must be one of none, kde, actors"),
        ({"looks": "any"}, "looks must be one of log, random"),
        ({"bandwidth": 0.001}, "bandwidth must be at least 0.01, got 0.001"),
        ({"clip": 0.5}, "clip must be at least 1"),
        ({"temper": 2.0}, "temper must be from 0 to 1, got 2.0"),
    ],
)
def test_a_value_out_of_range_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        TrainingConfig(**changes)


def test_its_choices_are_those_of_losses_and_samples():
    assert losses.KINDS == LOSSES
    assert samples.LOOKS == LOOKS
