"""The learning rate over a training."""

import numpy as np
import pytest

from bev_driving_env.training.schedule import one_cycle


def test_the_learning_rate_rises_to_its_peak_and_falls_to_almost_nothing():
    rates = [one_cycle(step, 200, 2e-3) for step in range(200)]
    assert rates[0] == pytest.approx(2e-3 / 25)
    assert int(np.argmax(rates)) == 30
    assert max(rates) == pytest.approx(2e-3)
    assert (np.diff(rates[:31]) > 0).all()
    assert (np.diff(rates[30:]) < 0).all()
    assert rates[-1] < 2e-6
