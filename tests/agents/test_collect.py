"""Collecting: perturbed drives that the expert saves, kept one by one."""

import dataclasses
from collections import Counter

import numpy as np
import pytest

from agents import Expert
from agents.collect import (
    EpisodeJob,
    claim_folder,
    collect,
    discard,
    drive_episode,
    jobs_of,
    log_settings,
    perturbation_levels,
)
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.kernels.layout import DISTANCE, HEADING, X, Y
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.settings import EnvSettings

TOWN = "Town02"


def settings(**keywords):
    return log_settings(TOWN, EnvSettings(**keywords))


def header(levels=(0.0, 1.0), **keywords):
    return LogHeader(TOWN, settings(time_limit_s=4.0, **keywords), 10, 20, 3, levels)


@pytest.fixture(scope="module")
def env():
    return BEVTownEnv(TOWN, **settings())


def distances(log, env):
    """Distance of the car from the nearest of the route's points, metres, by step."""
    points = env.route.points[:, :2]
    return np.array([np.hypot(*(points - place).T).min() for place in log.motion[:, :2]])


def test_unperturbed_the_expert_drives_as_if_nobody_took_it_down(env):
    job = EpisodeJob(0, 2, 0.0, 5)
    log = drive_episode(env, job)
    assert log.header.outcome == "success"
    assert log.header.infractions == ()
    np.testing.assert_array_equal(log.clean, log.applied)
    env.reset(seed=job.seeds[0], options={"route": 2})
    expert = Expert(env)
    for step in range(len(log)):
        np.testing.assert_array_equal(log.motion[step, :4], env.world.state.ego[0])
        env.step(expert.act())
    assert env.world.success[0]


def test_strong_kicks_push_the_car_off_its_lane_and_the_expert_comes_back(env):
    names, farthest = Counter(), 0.0
    for route in (0, 4):
        log = drive_episode(env, EpisodeJob(4, route, 1.0, 5))
        assert log.header.outcome == "success"
        names.update(event["name"] for event in log.header.infractions)
        away = distances(log, env)
        farthest = max(farthest, float(away.max()))
        # back at the lane's centre within ten seconds of each push
        calm = away < 0.5
        assert np.convolve(calm, np.ones(100), "valid").min() > 0
    assert farthest > 3.0
    assert names["off_road"] > 0
    assert names["route_deviation"] > 0


@pytest.mark.parametrize("right_m", [-5.0, -4.0, 3.0, 5.0])
@pytest.mark.parametrize("turned", [-1.2, 0.0, 1.2])
def test_the_expert_recovers_from_the_opposing_lane_and_from_beside_the_road(env, right_m, turned):
    env.reset(seed=0, options={"route": 1})
    expert = Expert(env)
    for _ in range(80):
        env.world.step(expert.act().astype(np.float64)[None])
    ego = env.world.state.ego[0]
    cos, sin = np.cos(ego[HEADING]), np.sin(ego[HEADING])
    ego[X], ego[Y] = ego[X] - right_m * sin, ego[Y] + right_m * cos
    ego[HEADING] += turned
    for _ in range(80):
        env.world.step(expert.act().astype(np.float64)[None])
        assert env.world.state.progress[0, DISTANCE] < 8.0
    assert env.world.state.progress[0, DISTANCE] < 0.3


def test_a_car_that_cannot_be_saved_ends_the_episode(env, monkeypatch):
    monkeypatch.setattr(Expert, "act", lambda self: np.array([0.5, 0.1], np.float32))
    log = drive_episode(env, EpisodeJob(0, 0, 0.0, 5))
    assert log.header.outcome == "lost"
    assert 7.0 < distances(log, env)[-1] < 8.5
    monkeypatch.setattr(Expert, "act", lambda self: np.array([-1.0, 0.0], np.float32))
    log = drive_episode(env, EpisodeJob(0, 0, 0.0, 5))
    assert log.header.outcome == "blocked"
    assert len(log) == pytest.approx(300, abs=5)


def test_levels_run_from_none_to_the_strongest():
    assert perturbation_levels(5) == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert perturbation_levels(1) == (0.0,)


def test_each_collection_has_a_seed_and_drives_every_route():
    jobs = jobs_of(header(levels=(0.0, 0.5, 1.0)))
    assert len(jobs) == 30
    assert len({job.collection_seed for job in jobs}) == 3
    assert len({job.seeds for job in jobs}) == 30
    assert {job.level for job in jobs if job.collection == 1} == {0.5}
    assert jobs == jobs_of(header(levels=(0.0, 0.5, 1.0)))
    assert [job.route for job in jobs_of(header(), [7])] == [7, 7]
    with pytest.raises(ValueError, match="routes 0 to 9, got 10"):
        jobs_of(header(), [10])


def contents(folder):
    return {path.name: path.read_bytes() for path in (folder / "episodes").iterdir()}


def test_an_interrupted_collection_resumes_to_the_same_bytes(tmp_path):
    mine = header(traffic="light", traffic_lights=True)
    jobs = jobs_of(mine, [0, 3])
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    for folder in (whole, parts):
        claim_folder(folder, mine)
    collect(whole, mine, jobs, 1)
    collect(parts, mine, jobs[:1], 1)
    first = next((parts / "episodes").glob("*.steps.parquet"))
    kept_since = first.stat().st_mtime_ns
    # an episode without its steps is not complete
    (parts / "episodes" / f"{jobs[1].name}.actors.parquet").write_bytes(b"half")
    claim_folder(parts, mine)
    episodes = collect(parts, mine, jobs, 1)
    assert first.stat().st_mtime_ns == kept_since
    assert contents(parts) == contents(whole)
    assert [episode.route for episode, _ in episodes] == [0, 3, 0, 3]
    assert len(DriveLog(parts)) == sum(steps for _, steps in episodes) == 160


def test_two_workers_write_what_one_does(tmp_path):
    mine = header()
    jobs = jobs_of(mine, [1, 2])
    for folder, workers in ((tmp_path / "one", 1), (tmp_path / "two", 2)):
        claim_folder(folder, mine)
        collect(folder, mine, jobs, workers)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_a_folder_of_another_log_is_left_alone(tmp_path):
    claim_folder(tmp_path, header())
    before = (tmp_path / "log.json").read_bytes()
    with pytest.raises(LogError, match=r"levels \(0.0, 1.0\), this one has \(0.5,\)"):
        claim_folder(tmp_path, header(levels=(0.5,)))
    with pytest.raises(LogError, match="appearance 'train', this one has 'hard'"):
        claim_folder(tmp_path, header(appearance="hard"))
    other = dataclasses.replace(header(), provenance={"git_commit": "abc"})
    with pytest.raises(LogError, match="git_commit None, this one has 'abc'"):
        claim_folder(tmp_path, other)
    assert (tmp_path / "log.json").read_bytes() == before


def test_episodes_of_nobody_are_left_alone(tmp_path):
    (tmp_path / "episodes").mkdir()
    with pytest.raises(LogError, match=r"holds episodes but no log\.json"):
        claim_folder(tmp_path, header())


def test_discarding_takes_the_logs_own_files_only(tmp_path):
    claim_folder(tmp_path, header())
    (tmp_path / "episodes").mkdir()
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    discard(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    (tmp_path / "log.json").write_text('{"format": "else"}', encoding="utf-8")
    with pytest.raises(LogError, match="not of a BEVTown drive log"):
        discard(tmp_path)
    assert (tmp_path / "log.json").exists()
