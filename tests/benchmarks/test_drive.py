from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks.drive import EpisodeResult, drive
from benchmarks.suites import Job

DRIVERS = """
import numpy as np

class Straight:
    def __init__(self, env): self.steps = 0
    def reset(self, seed): self.steps = 0
    def act(self, observation): return np.array([0.3, 0.0], np.float32)

class Fails(Straight):
    def act(self, observation):
        self.steps += 1
        if self.steps > 5: raise RuntimeError("out of ideas")
        return super().act(observation)

class Quits(Straight):
    def act(self, observation): raise SystemExit(3)

class Sends(Straight):
    def act(self, observation): return np.array([np.nan, 0.0])

class Sleeps(Straight):
    def act(self, observation): return np.zeros(2, np.float32)
"""


@pytest.fixture
def drivers(tmp_path, monkeypatch):
    (tmp_path / "toy_drivers.py").write_text(DRIVERS, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)


def job_of(agent: str, index: int = 2) -> Job:
    return Job("Town01", "episode", index, "ground_truth", agent, 0, "train")


def test_the_expert_completes_an_episode_and_its_trajectory_is_as_long_as_its_metres():
    result = drive(job_of("expert"))
    assert result.clean
    assert result.planned_m == pytest.approx(110.0, abs=0.1)
    steps = np.diff(np.array(result.trajectory), axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(result.driven_m, rel=0.01)
    assert result.time_s == pytest.approx(result.steps / 10)


@pytest.mark.usefixtures("drivers")
def test_straight_on_at_the_corner_is_reported_with_place_and_name():
    result = drive(job_of("toy_drivers:Straight"))
    assert not result.clean
    assert result.infraction in ("off_road", "route_deviation", "wrong_lane")
    assert result.infractions >= 1
    x, y, heading = result.infraction_pose
    # the route heads west along y = -2 and bends south at x = 8.9
    assert x < 8.9
    assert y == pytest.approx(-2.0, abs=0.01)
    assert math.cos(heading) == pytest.approx(-1.0)
    assert 25.0 < result.infraction_m < 50.0


@pytest.mark.usefixtures("drivers")
def test_an_agent_that_raises_fails_its_episode_with_the_traceback_and_the_metres_so_far():
    result = drive(job_of("toy_drivers:Fails"))
    assert not result.success
    assert "RuntimeError: out of ideas" in result.error
    assert result.failure == "RuntimeError: out of ideas"
    assert result.steps == 5
    assert 0.0 < result.driven_m < 5.0


@pytest.mark.usefixtures("drivers")
def test_an_agent_that_exits_does_not_end_the_benchmark():
    assert drive(job_of("toy_drivers:Quits")).failure == "SystemExit: 3"


@pytest.mark.usefixtures("drivers")
def test_an_action_that_is_not_a_number_fails_the_episode():
    result = drive(job_of("toy_drivers:Sends"))
    assert "ValueError" in result.error
    assert "nan" in result.error


@pytest.mark.usefixtures("drivers")
def test_a_driver_that_never_moves_is_blocked_after_thirty_seconds():
    result = drive(job_of("toy_drivers:Sleeps"))
    assert result.infraction == "blocked"
    assert result.time_s == pytest.approx(30.1, abs=0.11)
    assert result.driven_m == 0.0


def test_a_result_survives_a_round_trip_through_json(make_result):
    result = make_result(infraction="off_road", infraction_pose=(1.0, 2.0, 3.0), infraction_m=5.0)
    assert EpisodeResult.from_dict(json.loads(json.dumps(result.as_dict()))) == result


def test_two_drives_of_the_same_job_are_equal():
    assert drive(job_of("expert", 0)) == drive(job_of("expert", 0))
