"""Rewinding failed drives whose cause is known."""

import pytest

from benchmarks.rewind import rewind
from benchmarks.suites import Job

CHANNELS = ("road", "route", "lane")
STRAIGHTENED = "ground_truth~straightening=1,latency=0.5@route"


@pytest.fixture(scope="module")
def rescue():
    """Town02's episode 1 has turns that cannot be driven when they are seen straight, and late."""
    return rewind(Job("Town02", "episode", 1, STRAIGHTENED, "bc", 0, "test"), CHANNELS)


def test_the_planted_channel_saves_the_drive_and_no_other(rescue):
    point = rescue.point_of_no_return
    assert point.saved_by == ("route",)
    assert point.route_m < rescue.failure_m
    assert point.step < rescue.failure_step


def test_nothing_saves_it_later(rescue):
    assert [attempt.saved_by for attempt in rescue.attempts[:-1]] == [()] * (
        len(rescue.attempts) - 1
    )
    steps = [attempt.step for attempt in rescue.attempts]
    assert steps == sorted(steps, reverse=True)


def test_a_drive_that_does_not_fail_has_nothing_to_be_saved_from():
    assert rewind(Job("Town02", "episode", 0, "ground_truth", "bc", 0, "test"), CHANNELS) is None
