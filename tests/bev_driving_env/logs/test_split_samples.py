"""Samples of several logs have numbers of their own, log after log."""

import numpy as np
import pytest

from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.split_samples import SplitSamples


class ToyLog:
    """A log whose first samples are for validation."""

    def __init__(self, name, validation, training):
        self.name, self._validation, self._count = name, validation, validation + training

    def indices(self, split="all"):
        first, last = (0, self._validation) if split == "val" else (self._validation, self._count)
        return np.arange(0 if split == "all" else first, self._count if split == "all" else last)

    def actions(self):
        return np.array([[ord(self.name), k] for k in range(self._count)], np.float32)


def test_samples_of_a_split_are_numbered_log_after_log():
    logs = [ToyLog("a", 2, 3), ToyLog("b", 1, 0), ToyLog("c", 0, 2)]
    samples = SplitSamples(logs, "train")
    found = [samples.locate(number) for number in range(len(samples))]
    assert [(log.name, index) for log, index in found] == [
        *(("a", 2), ("a", 3), ("a", 4)),
        *(("c", 0), ("c", 1)),
    ]
    assert [samples.log_number(number) for number in range(5)] == [0, 0, 0, 2, 2]
    assert samples.actions().tolist() == [[ord(log.name), index] for log, index in found]


def test_a_split_without_samples_says_where_to_get_some():
    with pytest.raises(LogError, match=r"no sample of split 'val': collect more"):
        SplitSamples([ToyLog("a", 0, 3)], "val")
    with pytest.raises(LogError, match="no sample"):
        SplitSamples([], "train")
