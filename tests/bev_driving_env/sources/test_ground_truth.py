"""``GroundTruth``: the source that is given the true BEV."""

import numpy as np
import pytest

from bev_driving_env.frames import CHANNELS
from bev_driving_env.sources.ground_truth import GroundTruth
from bev_driving_env.sources.protocol import BEVSourceError


def test_it_wants_the_truth_and_no_frame():
    source = GroundTruth()
    assert source.channels == CHANNELS
    assert source.needs_truth
    assert not source.needs_frame


def test_it_returns_the_truth_unchanged():
    truth = np.random.default_rng(0).integers(0, 256, (6, 16, 16), np.uint8)
    before = truth.copy()
    source = GroundTruth()
    source.reset()
    np.testing.assert_array_equal(source.perceive(None, truth), before)
    np.testing.assert_array_equal(truth, before)


def test_without_an_environment_it_says_that_it_needs_one():
    with pytest.raises(BEVSourceError, match="'ground_truth' is not a function of sensor frames"):
        GroundTruth()(None)
    with pytest.raises(BEVSourceError, match="needs the true BEV"):
        GroundTruth().perceive(None, None)
