"""Batches: several logs as one, the background thread."""

import threading

import numpy as np
import pytest

from agents.batches import LARGEST_WEIGHT, RenderedBatches, SampleSet, rare_action_weights
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.order import batch_numbers


class ToyLog:
    """Samples whose BEV, speed and action all tell their index."""

    def __init__(self, count, offset=0, fails_at=None):
        self.count, self.offset, self.fails_at = count, offset, fails_at
        self.rendered_in = set()

    def bev(self, index):
        if index == self.fails_at:
            raise LogError(f"sample {index} cannot be read")
        self.rendered_in.add(threading.current_thread().name)
        return np.full((6, 8, 8), index + self.offset, np.uint8)

    def measurements(self, index):
        return np.array([index + self.offset, 0.0, 0.0], np.float32)

    def actions(self):
        column = (np.arange(self.count, dtype=np.float32) + self.offset) / 100.0
        return np.stack([column, -column], axis=1)

    def indices(self, split="all"):
        first = {"all": 0, "train": 2, "val": 0}[split]
        return np.arange(first, 2 if split == "val" else self.count)


def test_several_logs_become_one_set_whose_parts_belong_together():
    samples = SampleSet([ToyLog(5), ToyLog(4, offset=50)], "train", channels=3)
    batch = samples.batch(np.array([4, 0, 3]))
    assert len(samples) == 5
    assert batch.bev.shape == (3, 3, 8, 8)
    assert batch.bev[:, 0, 0, 0].tolist() == [53, 2, 52]
    assert batch.measurements[:, 0].tolist() == [53.0, 2.0, 52.0]
    assert batch.actions[:, 0].tolist() == pytest.approx([0.53, 0.02, 0.52])
    assert batch.weights.tolist() == [1.0, 1.0, 1.0]


def test_weights_of_a_set_have_a_mean_of_one_and_go_with_their_samples():
    samples = SampleSet([ToyLog(6)], weigh=lambda actions: actions[:, 0].astype(np.float64))
    # samples 2 to 5: weights in the ratio 2 : 3 : 4 : 5
    assert samples.batch(np.arange(4)).weights.tolist() == pytest.approx(
        [2 / 3.5, 3 / 3.5, 4 / 3.5, 5 / 3.5]
    )


@pytest.mark.parametrize(
    ("weights", "message"),
    [([1.0], "shape"), ([1.0, -1.0, 1.0, 1.0], "negative"), ([0.0] * 4, "some positive")],
)
def test_weights_that_make_no_sense_are_refused(weights, message):
    with pytest.raises(ValueError, match=message):
        SampleSet([ToyLog(6)], weigh=lambda actions: np.array(weights))


def test_data_without_a_sample_of_the_split_are_refused():
    with pytest.raises(LogError, match="'train'"):
        SampleSet([ToyLog(2)], "train")


def test_batches_are_rendered_in_another_thread_in_the_order_of_their_steps():
    log = ToyLog(20)
    with RenderedBatches(SampleSet([log]), 4, seed=7, steps=(5, 9)) as batches:
        found = [(step, batch.bev[:, 0, 0, 0].tolist()) for step, batch in batches]
    wanted = [(s, (batch_numbers(18, 4, 7, s) + 2).tolist()) for s in range(5, 9)]
    assert found == wanted
    assert log.rendered_in == {"batches"}


def test_the_shares_of_all_ranks_make_up_the_batch():
    def first(rank, ranks):
        with RenderedBatches(SampleSet([ToyLog(20)]), 6, 1, (0, 1), rank, ranks) as batches:
            return next(iter(batches))[1].bev[:, 0, 0, 0].tolist()

    assert sorted(first(0, 2) + first(1, 2)) == sorted(first(0, 1))
    assert len(first(0, 2)) == len(first(1, 2)) == 3


def test_an_error_in_the_thread_is_raised_where_the_batch_is_waited_for():
    samples = SampleSet([ToyLog(20, fails_at=11)])
    with (
        RenderedBatches(samples, 6, 1, (0, 3)) as batches,
        pytest.raises(LogError, match="sample 11"),
    ):
        list(batches)


def test_leaving_early_ends_the_thread():
    with RenderedBatches(SampleSet([ToyLog(20)]), 4, 0, (0, 10_000)) as batches:
        next(iter(batches))
    assert "batches" not in {thread.name for thread in threading.enumerate()}


def test_rare_actions_weigh_more_by_the_root_of_how_rare_they_are():
    common, rare = [[0.0, 0.0]] * 900, [[0.6, -0.5]] * 100
    weights = rare_action_weights(np.array(common + rare, np.float32))
    assert weights[-1] / weights[0] == pytest.approx(3.0)
    assert np.ptp(weights[:900]) == 0.0
    assert weights.mean() == pytest.approx(1.0)


def test_no_lonely_action_weighs_more_than_eight_average_ones():
    weights = rare_action_weights(np.array([[0.0, 0.0]] * 9999 + [[0.6, -0.5]], np.float32))
    assert weights[-1] == pytest.approx(LARGEST_WEIGHT)
