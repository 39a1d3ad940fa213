from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drive import EpisodeResult, drive
from benchmarks.suites import Conditions, Job

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
    assert result.travelled_m == pytest.approx(np.hypot(*steps.T).sum(), rel=0.01)
    assert result.outside_m == 0.0
    assert result.driving_score("1.0") == result.driving_score("2.1") == 100.0


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
    assert len(result.events) == result.infractions
    first = result.events[0]
    assert (first["name"], first["route_m"]) == (result.infraction, result.infraction_m)
    assert (first["x"], first["y"], first["heading"]) == result.infraction_pose
    assert {"time_s", "speed_mps", "actor", "fault"} <= {*first}


@pytest.mark.usefixtures("drivers")
def test_what_does_not_end_an_episode_is_kept_with_the_metres_driven_outside():
    conditions = Conditions(terminate_on=("route_deviation",), rules=(("deviation_m", 30.0),))
    result = drive(replace(job_of("toy_drivers:Straight"), conditions=conditions))
    names = [event["name"] for event in result.events]
    assert names[-1] == "route_deviation"
    assert "off_road" in names[:-1]
    # straight on from x = 8.9, where the road bends away, until 30 m from the route
    assert 20.0 < result.outside_m < 40.0
    assert result.outside_m < result.travelled_m - 20.0
    statics = names.count("collision_static")
    inside = 1.0 - result.outside_m / result.travelled_m
    route_pct = 100.0 * result.driven_m / result.planned_m
    assert result.driving_score("1.0") == pytest.approx(route_pct * inside * 0.65**statics)
    assert result.driving_score("2.1") == pytest.approx(route_pct * inside / (1 + 0.6 * statics))


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


def test_a_result_survives_a_round_trip_through_json(make_result, make_event):
    result = make_result(
        infraction="off_road",
        infraction_pose=(1.0, 2.0, 3.0),
        infraction_m=5.0,
        conditions=Conditions("dense", True, ("blocked",), (("blocked_s", 180.0),), 60.0),
        events=[make_event("off_road"), make_event("collision_vehicle", actor="vehicle 12")],
        travelled_m=101.5,
        outside_m=7.25,
    )
    again = EpisodeResult.from_dict(json.loads(json.dumps(result.as_dict())))
    assert again == result
    assert again.events[1]["actor"] == "vehicle 12"
    assert again.driving_score() == result.driving_score()


def test_a_completed_route_counts_whole_though_it_ends_before_its_last_metre(make_result):
    assert make_result(driven_m=99.5).route_fraction == 1.0
    assert make_result(driven_m=99.5).driving_score() == 100.0
    assert make_result(driven_m=99.5, success=False).route_fraction == pytest.approx(0.995)
    assert make_result(driven_m=100.2, success=False).route_fraction == 1.0


def test_a_failed_episode_scores_with_the_metres_driven_so_far(make_result, make_event):
    result = make_result(
        success=False, driven_m=40.0, error="Traceback ...", events=[make_event("red_light")]
    )
    assert result.driving_score("1.0") == pytest.approx(28.0)
    assert result.driving_score("2.1") == pytest.approx(40.0 / 1.4)


def test_an_episode_that_failed_before_its_route_was_planned_scores_nothing(make_result):
    result = make_result(success=False, planned_m=0.0, driven_m=0.0, travelled_m=0.0, error="...")
    assert result.driving_score() == 0.0
    assert result.outside_fraction == 0.0


def test_counts_leave_out_what_was_the_fault_of_others(make_result, make_event):
    events = [make_event("collision_vehicle"), make_event("collision_vehicle", "other")]
    result = make_result(events=events, travelled_m=200.0, outside_m=50.0)
    assert result.counts["collision_vehicle"] == 1
    assert result.penalty("1.0") == pytest.approx(0.75 * 0.6)


def test_two_drives_of_the_same_job_are_equal():
    assert drive(job_of("expert", 0)) == drive(job_of("expert", 0))
