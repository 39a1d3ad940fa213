"""The numbers of PPO."""

import pytest

from agents.ppo_config import FINE_TUNING, FROM_SCRATCH, PPOConfig


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"steps": 0}, "steps must be"),
        ({"learning_rate": 0.0}, "learning_rate must be"),
        ({"target_kl": -1.0}, "target_kl must be"),
        ({"gamma": 1.5}, "gamma must be above 0 and at most 1, got 1.5"),
        ({"entropy_weight": float("nan")}, "entropy_weight must be at least 0, got nan"),
        ({"critic_steps": -1}, "critic_steps must be at least 0, got -1"),
        ({"batch_size": 100}, "batch_size 100 must divide worlds x horizon, 16 x 128 = 2048"),
    ],
)
def test_numbers_that_make_no_sense_are_named(changed, message):
    with pytest.raises(ValueError, match=message):
        PPOConfig(**changed)


def test_fine_tuning_is_careful_with_what_drives_already():
    assert FINE_TUNING.learning_rate < FROM_SCRATCH.learning_rate
    assert FINE_TUNING.critic_steps > FROM_SCRATCH.critic_steps == 0
    assert FINE_TUNING.target_kl is not None
