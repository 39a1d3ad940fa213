"""What is measured of drive logs."""

import pytest

from benchmarks.speed_logs import figures, measure_log


@pytest.fixture
def short(monkeypatch):
    """Episodes of two seconds."""
    from benchmarks import speed_logs

    whole = speed_logs.log_settings
    monkeypatch.setattr(
        speed_logs, "log_settings", lambda *given: {**whole(*given), "time_limit_s": 2.0}
    )


def test_a_log_is_collected_until_it_is_long_enough_and_read(short):
    speed = measure_log("Town02", "light", samples=30, rounds=1, seconds=0.05, seed=0)
    assert speed.samples == 60
    assert 100 < speed.bytes_per_sample < 5000
    assert min(speed.collected_per_s, speed.bev_per_s, speed.cameras_per_s) > 0


def test_the_papers_size_is_scaled_up_from_what_was_measured(short):
    measured = figures(1, 0.02, samples=20)
    sizes = [figure for figure in measured if figure.unit == "MB"]
    assert len(sizes) == 2
    for figure in sizes:
        assert figure.met == (figure.value <= 50.0)
