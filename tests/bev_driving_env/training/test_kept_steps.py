"""A training is kept after the step that was done last, and stops only then."""

import threading

import pytest

from bev_driving_env.training.kept_steps import kept_steps


def test_what_a_signal_stops_is_kept_with_all_that_was_done_in_the_step():
    done, kept, flag = [], [], threading.Event()

    def train():
        for step in kept_steps(range(5), lambda: kept.append(list(done)), flag, 1e9):
            if step == 2:
                flag.set()
            done.append(step)

    with pytest.raises(KeyboardInterrupt):
        train()
    assert done == [0, 1, 2]
    assert kept == [[0, 1, 2]]


def test_a_training_is_kept_at_intervals(monkeypatch):
    seconds = iter(range(0, 1000, 40))
    monkeypatch.setattr("time.monotonic", lambda: next(seconds))
    done, kept = [], []
    for step in kept_steps(range(6), lambda: kept.append(len(done)), threading.Event(), 60.0):
        done.append(step)
    assert done == list(range(6))
    assert kept == [2, 4, 6]
