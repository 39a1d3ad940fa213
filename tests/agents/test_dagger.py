"""DAgger: who drives, what is written down, which routes."""

import numpy as np
import pytest

import agents.dagger
from agents import Expert
from agents.beta_agent import BetaAgent
from agents.collect import EpisodeJob, log_settings
from agents.dagger import Rescue, drive_labelled, drive_round, round_routes
from agents.network import NetworkConfig
from agents.training import new_policy
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.settings import EnvSettings

SHORT = log_settings("Town01", EnvSettings.from_keywords({"time_limit_s": 1.5}))


@pytest.fixture(scope="module")
def policy():
    untrained = new_policy(NetworkConfig(), seed=4)
    untrained.set_training_mode(False)
    return untrained


@pytest.fixture
def base():
    return LogHeader("Town01", SHORT, control_hz=10, physics_hz=20, seed=0, levels=(0.0,))


def test_the_policy_drives_where_it_is_near_the_route_and_moving():
    rescue = Rescue(0.1)
    assert not any(rescue.needed(2.9, 5.0, 0.5) for _ in range(100))


def test_the_expert_takes_over_far_from_the_route_and_stays_until_it_is_back():
    rescue = Rescue(0.1)
    assert rescue.needed(3.1, 5.0, 0.0)
    # not yet back: however long it takes
    assert all(rescue.needed(0.6, 5.0, 0.0) for _ in range(200))
    # back: three seconds more
    back = [rescue.needed(0.2, 5.0, 0.0) for _ in range(40)]
    assert sum(back) == pytest.approx(30, abs=1)
    assert not back[-1]


def test_the_expert_takes_over_after_two_seconds_of_standing_where_it_would_drive():
    rescue = Rescue(0.1)
    assert [rescue.needed(0.0, 0.0, 0.3) for _ in range(25)].index(True) == pytest.approx(20, abs=1)


def test_a_policy_may_stand_where_the_expert_stands_too():
    rescue = Rescue(0.1)
    assert not any(rescue.needed(0.0, 0.0, -0.2) for _ in range(200))


def test_every_state_holds_what_the_expert_would_do_and_what_the_policy_did(policy):
    env = BEVTownEnv("Town01", **SHORT)
    job = EpisodeJob(collection=0, route=3, level=0.0, collection_seed=11)
    log = drive_labelled(env, policy, job)
    assert log.header.outcome == "time_limit"
    assert len(log) == 15
    again = BEVTownEnv("Town01", **SHORT)
    observation, _ = again.reset(seed=job.seeds[0], options={"route": 3})
    expert, agent = Expert(again), BetaAgent(policy, again)
    for step in range(len(log)):
        assert (log.clean[step] == expert.act()).all()
        assert (log.applied[step] == agent.act(observation)).all()
        observation = again.step(log.applied[step])[0]
    assert (log.clean != log.applied).any()


def test_the_log_of_a_round_shows_what_the_policy_saw(policy, base, tmp_path, monkeypatch):
    monkeypatch.setattr(agents.dagger, "LEVELS", (0.0,))
    monkeypatch.setattr(agents.dagger, "ROUTES_A_ROUND", 1)
    states = drive_round(tmp_path / "round_00", base, policy, number=0, seed=2)
    log = DriveLog(tmp_path / "round_00")
    assert states == len(log) == 15 * len(log.episodes)
    agent = BetaAgent(policy, BEVTownEnv("Town01"))
    for index in (0, 7, 14):
        seen = {"bev": log.bev(index), "measurements": log.measurements(index)}
        assert (agent.act(seen) == log.actions(np.array([index]), applied=True)[0]).all()


def test_a_round_that_was_interrupted_drives_only_what_is_missing(
    policy, base, tmp_path, monkeypatch
):
    driven = []

    def noted(env, policy, job):
        driven.append(job.name)
        return drive_labelled(env, policy, job)

    monkeypatch.setattr(agents.dagger, "drive_labelled", noted)
    folder = tmp_path / "round"
    drive_round(folder, base, policy, number=0, seed=2)
    first = list(driven)
    lost = folder / "episodes" / f"{first[1]}.steps.parquet"
    lost.unlink()
    drive_round(folder, base, policy, number=0, seed=2)
    assert driven == [*first, first[1]]


def test_the_folder_of_another_round_is_refused(policy, base, tmp_path, monkeypatch):
    monkeypatch.setattr(agents.dagger, "LEVELS", (0.0,))
    drive_round(tmp_path, base, policy, number=0, seed=2)
    with pytest.raises(LogError, match="seed"):
        drive_round(tmp_path, base, policy, number=1, seed=2)


def test_rounds_take_turns_on_all_routes_but_the_one_of_validation():
    driven = [route for number in range(3) for route in round_routes("Town01", number, 5, 3)]
    assert sorted(driven) == list(range(1, 10))
    assert round_routes("Town01", 3, 5, 3) == round_routes("Town01", 0, 5, 3)
    assert len(round_routes("Town01", 0, 5, 30)) == 9
