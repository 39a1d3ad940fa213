"""Recorded drives, driven again."""

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest

from agents.collect import log_settings
from agents.drive_again import drive_again, reset_arguments
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.logs.drive_log import EPISODES, DriveLog
from bev_driving_env.logs.episode import read_episode
from bev_driving_env.logs.errors import LogError
from bev_driving_env.settings import EnvSettings

from .finished_drives import GIVEN_UP_AFTER, TOWN, record_log


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    record_log(folder)
    return DriveLog(folder)


@pytest.fixture(scope="module")
def env(log):
    return BEVTownEnv(TOWN, **log.header.settings)


def whole(env, log, number):
    (part,) = drive_again(env, log, number)
    return part


@pytest.mark.parametrize("number", [0, 1, 2])
def test_what_is_seen_again_is_what_the_log_shows(number, env, log):
    part = whole(env, log, number)
    indices = np.arange(log.starts[number], log.starts[number + 1])
    assert len(part.bev) == len(indices) + 1
    for row, index in enumerate(indices.tolist()):
        np.testing.assert_array_equal(part.bev[row], log.bev(index))
        np.testing.assert_array_equal(part.measurements[row], log.measurements(index))
    np.testing.assert_array_equal(part.actions, log.actions(indices, applied=True))
    np.testing.assert_array_equal(part.clean[:-1], log.actions(indices))
    assert np.isnan(part.clean[-1]).all()
    assert (part.actions != part.clean[:-1]).any()
    # the last state is in no log: the commands that led to it show that it is the right one
    np.testing.assert_array_equal(part.measurements[-1, 1:], part.actions[-1])


def test_rewards_are_those_of_the_environment(env, log):
    """By hand: reset, then the applied actions one after the other."""
    part = whole(env, log, 1)
    other = gym.make(f"BEV{TOWN}-v0", **log.header.settings)
    other.reset(**reset_arguments(log.episodes[1]))
    rewards = [other.step(action)[1] for action in part.actions]
    np.testing.assert_array_equal(part.rewards, rewards)
    assert len(set(rewards)) > 20


def test_arriving_terminates_and_giving_up_truncates(env, log):
    assert [episode.outcome for episode in log.episodes] == ["lost", "success", "success"]
    ends = []
    for number in range(3):
        part = whole(env, log, number)
        assert not part.terminations[:-1].any()
        assert not part.truncations[:-1].any()
        ends.append((bool(part.terminations[-1]), bool(part.truncations[-1])))
    assert ends == [(False, True), (True, False), (True, False)]


def test_parts_are_the_whole_cut_into_pieces(env, log):
    full, parts = whole(env, log, 0), list(drive_again(env, log, 0, 10))
    assert [part.first_step for part in parts] == [0, 10, 20]
    assert [len(part.rewards) for part in parts] == [10, 10, GIVEN_UP_AFTER - 20]
    for name in ("actions", "rewards", "terminations"):
        pieces = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(pieces, getattr(full, name))
    for part in parts:
        rows = slice(part.first_step, part.first_step + len(part.bev))
        np.testing.assert_array_equal(part.bev, full.bev[rows])
        np.testing.assert_array_equal(part.measurements, full.measurements[rows])
        assert part.truncations.tolist() == [False] * (len(part.rewards) - 1) + [True]


def test_another_drive_than_the_recorded_one_is_told(tmp_path, env):
    record_log(tmp_path)
    path = sorted((tmp_path / EPISODES).glob("*.steps.parquet"))[0]
    recorded = read_episode(path)
    motion = recorded.motion.copy()
    motion[7, 0] = np.nextafter(motion[7, 0], np.inf)
    dataclasses.replace(recorded, motion=motion).write(tmp_path / EPISODES)
    with pytest.raises(LogError, match=r"differs \(from step 7 on .* commit abc on a PC: collect"):
        list(drive_again(env, DriveLog(tmp_path), 0))


def test_a_drive_that_now_ends_early_is_told(log):
    text = json.dumps(log_settings(TOWN, EnvSettings(traffic="light", traffic_lights=True)))
    settings = {**json.loads(text), "time_limit_s": 1.0}
    with pytest.raises(LogError, match="from step 9 on"):
        list(drive_again(BEVTownEnv(TOWN, **settings), log, 0))
