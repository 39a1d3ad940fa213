"""What is measured of predictors."""

import time

import numpy as np
import pytest

from benchmarks import speed_predictors
from bev_driving_env.frames import CHANNELS
from perception.models.bev_unet import BEVUNetConfig
from perception.models.presets import PRESETS, ModelSpec


class SlowSource:
    """A batch of any size takes thirty milliseconds."""

    channels = CHANNELS

    def __init__(self):
        self.batches = []

    def reset(self):
        pass

    def __call__(self, frame):
        raise AssertionError("asked for single frames")

    def predict_batch(self, frames):
        self.batches.append(len(frames))
        time.sleep(0.03)
        return np.zeros((len(frames), 6, 192, 192), np.uint8)


def test_a_step_contains_the_prediction_and_that_of_a_batch_is_shared_by_its_worlds():
    source = SlowSource()
    times = speed_predictors.measure_steps({"slow": source}, 3, rounds=2, seconds=0.05)["slow"]
    assert [len(values) for values in times.values()] == [2, 2]
    assert min(times["single"]) >= 0.03
    assert min(times["vector"]) >= 0.01
    assert set(source.batches) == {1, 3}


def test_a_presets_frame_is_timed(monkeypatch):
    config = BEVUNetConfig(widths=(4, 4), encoder_blocks=(0, 0), decoder_blocks=(0,))
    monkeypatch.setitem(PRESETS, "tiny", ModelSpec("bev_unet", config))
    assert 0.0 < speed_predictors.preset_ms("tiny", 3) < 1000.0


def test_rows_name_targets_and_whether_they_are_met(monkeypatch):
    times = {
        "cvt_kde": {"single": [0.02, 0.04, 0.04], "vector": [0.03, 0.02, 0.02]},
        "ipm_unet_kde": {"single": [0.01], "vector": [0.02]},
    }
    monkeypatch.setattr(speed_predictors, "measure_steps", lambda *_, **__: times)
    monkeypatch.setattr(speed_predictors, "preset_ms", lambda *_: 900.0)
    rows = speed_predictors.figures(3, 0.1)
    assert [row.value for row in rows] == pytest.approx([25.0, 0.5, 100.0, 2.0, 900.0])
    assert [row.met for row in rows] == [False, True, True, False, True]
