from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks.suites import SUITES, Conditions, Job, Suite, added_error, jobs_of
from bev_driving_env.cameras.conditions import HARD_CONDITIONS
from bev_driving_env.settings import EnvSettings
from bev_driving_env.sources.corrupted import CORRUPTIONS
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.world.infractions import INFRACTIONS


def test_suite_town_drives_ten_long_routes_a_town_in_traffic_to_their_end():
    suite = SUITES["town"]
    jobs = list(jobs_of(suite, ["Town01", "Town02"], ["ground_truth"], ["expert"], [0]))
    assert len(jobs) == 20
    assert [job.options for job in jobs[:10]] == [{"route": index} for index in range(10)]
    assert {(job.town, job.appearance) for job in jobs} == {("Town01", "train"), ("Town02", "test")}
    assert jobs[0].conditions.keywords == {
        "traffic": "light",
        "traffic_lights": True,
        "terminate_on": ("route_deviation", "blocked"),
        "rules": {"deviation_m": 30.0, "blocked_s": 180.0},
        "time_limit_s": None,
    }
    assert suite.leaderboard


@pytest.mark.parametrize("name", sorted({*SUITES} - {"town"}))
def test_the_other_suites_drive_as_the_environment_does_by_itself(name):
    suite = SUITES[name]
    town = compiled_town("Town01")
    own = EnvSettings(**suite.conditions.keywords).world_config(town)
    assert own == EnvSettings().world_config(town)
    assert not suite.leaderboard


def test_conditions_reach_the_environment():
    keywords = replace(SUITES["town"].conditions, traffic="none", traffic_lights=False).keywords
    config = EnvSettings(**keywords).world_config(compiled_town("Town01"))
    assert set(config.terminate_on) == {"route_deviation", "blocked"} < set(INFRACTIONS)
    assert (config.rules.deviation_m, config.rules.blocked_s) == (30.0, 180.0)


def test_a_suite_with_traffic_can_be_given_other_traffic():
    suite = SUITES["town"]
    dense = suite.with_traffic("dense")
    assert dense.conditions == replace(suite.conditions, traffic="dense")
    assert dense.routes == suite.routes
    assert suite.with_traffic("none").conditions.traffic == "none"
    assert suite.with_traffic(None) == suite


def test_a_suite_without_traffic_can_not():
    with pytest.raises(ValueError, match=r"--traffic light: suite 'paper' has no traffic.* town$"):
        SUITES["paper"].with_traffic("light")
    assert SUITES["paper"].with_traffic(None) == SUITES["paper"]


@pytest.mark.parametrize(
    "changes",
    [
        {"traffic": "dense"},
        {"traffic_lights": False},
        {"terminate_on": ("blocked",)},
        {"terminate_on": None},
        {"rules": (("deviation_m", 30.0),)},
        {"time_limit_s": 100.0},
    ],
)
def test_jobs_under_other_conditions_have_other_keys(changes):
    suite = SUITES["town"]
    other = Suite("other", "route", "", replace(suite.conditions, **changes))
    arguments = (["Town02"], ["ground_truth"], ["expert"], [0])
    keys = {job.key for which in (suite, other) for job in jobs_of(which, *arguments)}
    assert len(keys) == 20


@pytest.mark.parametrize("conditions", [Conditions(), SUITES["town"].conditions])
def test_a_job_survives_a_round_trip_through_json(conditions):
    job = Job("Town02", "route", 3, "ground_truth", "expert", 0, "test", conditions)
    again = Job.from_dict(json.loads(json.dumps(job.as_dict())))
    assert again == job
    assert hash(again) == hash(job)
    assert again.key == job.key


def jobs(name: str, bevs: tuple[str, ...] = ("cvt",)) -> list[Job]:
    return list(jobs_of(SUITES[name], ["Town01", "Town02"], bevs, ["bc"], [0]))


def test_suite_appearance_drives_the_papers_episodes_under_every_look_in_both_towns():
    made = jobs("appearance")
    looks = list(dict.fromkeys(job.appearance for job in made))
    assert {"train", "test", "hard"} <= {*looks}
    plain = {(job.town, job.index) for job in jobs("paper")}
    for look in looks:
        assert {(job.town, job.index) for job in made if job.appearance == look} == plain
        assert EnvSettings(appearance=look).appearance == look
    assert len({job.key for job in made}) == len(made) == 10 * len(looks)


def test_every_held_out_condition_has_a_look_of_its_own():
    singles = {look.partition(":")[2] for look in SUITES["appearance"].appearances}
    assert {each.name.replace(" ", "_") for each in HARD_CONDITIONS} <= singles


def test_suite_corruptions_drives_every_error_model_at_every_dose_and_the_source_as_it_is():
    made = jobs("corruptions")
    paper = {replace(job, bev="") for job in jobs("paper")}
    variants = {job.bev for job in made}
    doses = SUITES["corruptions"].doses
    expected = {("cvt", model, dose) for model in CORRUPTIONS for dose in doses}
    assert {added_error(bev) for bev in variants} == {("cvt", "", None)} | expected
    for bev in variants:
        assert {replace(job, bev="") for job in made if job.bev == bev} == paper


def test_errors_are_not_added_to_what_has_some_or_is_mixed():
    for bev in ("cvt~shift=0.1", "cvt|route=ground_truth"):
        with pytest.raises(ValueError, match="errors cannot be added"):
            jobs("corruptions", (bev,))
