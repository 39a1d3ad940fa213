from __future__ import annotations

import numpy as np
import pytest

from benchmarks.count_files import OCCUPIED, load_counts, save_counts
from perception.iou_counts import iou_counts
from perception.places import Places


def test_counts_come_back_as_they_were(tmp_path):
    rng = np.random.default_rng(3)
    predicted = rng.random((5, 3, 16, 16), np.float32)
    truth = (rng.random((5, 3, 16, 16)) > 0.5).astype(np.float32)
    counts = iou_counts(predicted, truth, [OCCUPIED])
    places = Places(np.arange(5) > 2, np.arange(5) > 3)
    save_counts(tmp_path / "c.npz", counts, places, speed=np.arange(5.0))
    kept, where, (speed,) = load_counts(tmp_path / "c.npz", "speed")
    np.testing.assert_array_equal(kept.dataset_iou(), counts.dataset_iou())
    np.testing.assert_array_equal(kept.thresholds, counts.thresholds)
    np.testing.assert_array_equal(where.turn, places.turn)
    assert speed.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    with pytest.raises(ValueError, match=r"c\.npz holds no such counts.*height"):
        load_counts(tmp_path / "c.npz", "height")


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 half of one"])
def test_another_file_is_named(tmp_path, content):
    (tmp_path / "c.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"c\.npz holds no such counts"):
        load_counts(tmp_path / "c.npz")
