"""The order in which training reads logs."""

import numpy as np
import pytest

from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.order import batch_numbers, open_logs


def test_an_epoch_takes_every_sample_once_across_uneven_batches():
    taken = np.concatenate([batch_numbers(10, 4, seed=3, step=step) for step in range(5)])
    assert sorted(taken[:10]) == sorted(taken[10:]) == list(range(10))
    assert list(taken[:10]) != list(taken[10:])


def test_a_batch_larger_than_the_set_takes_samples_again():
    assert np.bincount(batch_numbers(3, 7, seed=0, step=0)).tolist() in (
        [3, 2, 2],
        [2, 3, 2],
        [2, 2, 3],
    )


def test_the_order_depends_on_the_seed_and_on_nothing_that_came_before():
    late = batch_numbers(50, 8, seed=1, step=9)
    for step in range(9):
        batch_numbers(50, 8, seed=2, step=step)
    assert (late == batch_numbers(50, 8, seed=1, step=9)).all()
    assert (late != batch_numbers(50, 8, seed=2, step=9)).any()


def test_no_data_at_all_and_folders_without_a_log_are_refused(tmp_path):
    with pytest.raises(LogError, match="no data"):
        open_logs([])
    with pytest.raises(LogError, match="not a drive log"):
        open_logs([tmp_path])
