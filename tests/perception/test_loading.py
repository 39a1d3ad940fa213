"""Batches of samples: their order, their workers, how long they are waited for."""

import time

import pytest
import torch

from bev_driving_env.logs.order import open_logs
from perception.loading import BatchPlan, Waited, batches_in_order, sample_loader
from perception.samples import BEVSamples

NEEDS = frozenset({"ground", "route_map"})


@pytest.fixture(scope="module")
def logs(log_folder):
    return open_logs([log_folder])


@pytest.fixture(scope="module")
def samples(logs):
    return BEVSamples(logs, "train", NEEDS, looks="random")


def plan(steps, **changes):
    return BatchPlan(**{"count": 30, "size": 8, "seed": 5, **changes}, steps=steps)


def assert_same(batch, other):
    assert torch.equal(batch.numbers, other.numbers)
    assert torch.equal(batch.bits, other.bits)
    assert set(batch.inputs) == set(other.inputs)
    for name, values in batch.inputs.items():
        assert torch.equal(values, other.inputs[name])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": 0}, "size must be an int of at least 1"),
        ({"rank": 2, "ranks": 2}, "rank must be from 0 to 1"),
        ({"ranks": 3}, "multiple of the 3 ranks, got 8"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        plan((0, 1), **changes)


def test_steps_run_forwards():
    with pytest.raises(ValueError, match="first <= end"):
        plan((3, 2))


def test_every_epoch_is_a_permutation_with_new_looks_and_flips():
    keys = [key for batch in plan((0, 15)) for key in batch]
    for epoch in range(4):
        numbers = [key.number for key in keys[30 * epoch : 30 * (epoch + 1)]]
        assert sorted(numbers) == list(range(30))
    assert len({key.look_seed for key in keys}) == len(keys) == 120
    assert 35 < sum(key.flip for key in keys) < 85
    assert not any(key.flip for batch in plan((0, 15), flips=False) for key in batch)


def test_the_keys_of_a_step_depend_on_seed_and_step_alone():
    whole = list(plan((0, 12)))
    assert list(plan((7, 12))) == whole[7:]
    assert len(plan((7, 12))) == 5
    assert plan((0, 1)).keys(9) == whole[9]
    assert list(plan((0, 12), seed=6)) != whole


def test_the_shares_of_all_ranks_make_up_the_batch():
    whole = plan((0, 4)).keys(3)
    shares = [plan((0, 4), rank=rank, ranks=2).keys(3) for rank in (0, 1)]
    assert shares == [whole[::2], whole[1::2]]


def test_training_that_goes_on_sees_what_it_would_have_seen(samples):
    whole = list(sample_loader(samples, plan((0, 4), size=4), workers=0))
    resumed = list(sample_loader(samples, plan((2, 4), size=4), workers=0))
    assert len(resumed) == 2
    for batch, other in zip(whole[2:], resumed, strict=True):
        assert_same(batch, other)
    assert not torch.equal(whole[0].bits, whole[1].bits)


def test_a_worker_process_renders_the_same_in_the_same_order(samples):
    steps = plan((3, 7), size=2)
    here = list(sample_loader(samples, steps, workers=0))
    waited = Waited(sample_loader(samples, steps, workers=1))
    there = list(waited)
    assert len(there) == 4
    for batch, other in zip(here, there, strict=True):
        assert_same(batch, other)
    assert there[0].target().shape == (2, 6, 192, 192)
    assert 0.0 < waited.waiting_share <= 1.0


def test_a_loader_leaves_the_random_numbers_of_training_alone(samples):
    torch.manual_seed(3)
    wanted = torch.rand(2)
    torch.manual_seed(3)
    next(iter(sample_loader(samples, plan((0, 1), size=1), workers=0)))
    assert torch.equal(torch.rand(2), wanted)


def test_evaluation_goes_through_samples_in_order(logs):
    samples = BEVSamples(logs, "val", {"route_map"})
    loader = sample_loader(samples, batches_in_order(range(5, 12), 3), workers=0)
    assert [batch.numbers.tolist() for batch in loader] == [[5, 6, 7], [8, 9, 10], [11]]


def test_the_waiting_share_is_the_time_in_which_nothing_was_done(monkeypatch):
    now = 100.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)

    def slow():
        nonlocal now
        for _ in range(4):
            now += 1.0
            yield "batch"

    waited = Waited(slow())
    for _ in waited:
        now += 3.0
    assert waited.waiting_share == pytest.approx(0.25)
    assert waited.total_s == pytest.approx(16.0)
    assert Waited([]).waiting_share == 0.0
