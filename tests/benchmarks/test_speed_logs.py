"""What is measured of drive logs."""

import pytest

from benchmarks import speed_logs
from benchmarks.speed_logs import figures, log_length, measure_log

pytestmark = pytest.mark.usefixtures("short_logs")


def test_a_log_is_collected_until_it_is_long_enough_and_read():
    speed = measure_log("Town02", "light", samples=30, rounds=1, seconds=0.05, seed=0)
    assert speed.samples == 60
    assert 100 < speed.bytes_per_sample < 5000
    assert min(speed.collected_per_s, speed.bev_per_s, speed.cameras_per_s) > 0


def test_the_papers_size_is_scaled_up_from_what_was_measured():
    measured = figures(1, 0.02, samples=20)
    sizes = [figure for figure in measured if figure.unit == "MB"]
    assert len(sizes) == 2
    for figure in sizes:
        assert figure.met == (figure.value <= 50.0)


def test_a_quick_look_collects_less_and_the_default_enough_to_judge_the_size():
    assert log_length(0.01) < log_length(0.1) < log_length(0.5)
    assert log_length(0.5) == log_length(60.0) == speed_logs.LONG_LOG


def test_only_a_long_log_is_held_against_the_papers_size(monkeypatch):
    def sizes():
        return [figure for figure in figures(1, 0.01, samples=20) if figure.unit == "MB"]

    assert all(not size.target for size in sizes())
    monkeypatch.setattr(speed_logs, "LONG_LOG", 40)
    assert all(size.target == "at most 50" for size in sizes())
