from __future__ import annotations

import importlib
import multiprocessing

import pytest

from benchmarks.pool import in_processes

CALLED = """
import os

def halve(number):
    if number < 0:
        raise ValueError(f"{number} is below 0")
    if number == 13:
        os._exit(7)  # as a segmentation fault in a library would
    return number / 2

def process_id(_):
    return os.getpid()
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """A module that workers find too."""
    (tmp_path / "toy_calls.py").write_text(CALLED, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("toy_calls")


def test_a_call_whose_process_dies_has_no_result_and_the_others_have_theirs(toy):
    calls = [(4,), (13,), (6,), (8,), (13,), (10,)]
    found = dict(in_processes(toy.halve, calls, 2))
    assert found == {0: 2.0, 1: None, 2: 3.0, 3: 4.0, 4: None, 5: 5.0}
    assert not multiprocessing.active_children()


def test_what_a_call_raises_is_raised_and_no_worker_is_left(toy):
    with pytest.raises(ValueError, match="-1 is below 0"):
        list(in_processes(toy.halve, [(-1,), *[(4,)] * 3], 2))
    for worker in multiprocessing.active_children():
        worker.join(timeout=10.0)
    assert not multiprocessing.active_children()


def test_calls_share_processes_unless_they_are_to_be_apart(toy):
    calls = [(k,) for k in range(3)]
    assert len({found for _, found in in_processes(toy.process_id, calls, 1)}) == 1
    assert len({found for _, found in in_processes(toy.process_id, calls, 1, apart=True)}) == 3


def test_without_calls_no_process_is_started(toy):
    assert list(in_processes(toy.halve, [], 2)) == []
