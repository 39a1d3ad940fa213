"""Many worlds under Stable-Baselines3, beside its own way to run environments side by side."""

from __future__ import annotations

import numpy as np
import pytest
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from agents.sb3_vec_env import SB3VecEnv
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.vector_env import BEVTownVectorEnv

BEV = {"size": 32, "px_per_m": 1.0, "ego_row": 24}
LIMIT_S, STEPS = 4.0, 100


def ours(worlds, **keywords):
    envs = BEVTownVectorEnv(worlds, "Town02", autoreset_mode="SameStep", bev=BEV, **keywords)
    return SB3VecEnv(envs)


def theirs(worlds, **keywords):
    def one():
        return Monitor(BEVTownEnv("Town02", bev=BEV, **keywords))

    return DummyVecEnv([one] * worlds)


def assert_same(first, second):
    assert first.keys() == second.keys()
    for key in first:
        np.testing.assert_array_equal(first[key], second[key])


def test_it_is_what_stable_baselines3_makes_of_single_environments():
    worlds = 3
    a, b = ours(worlds, time_limit_s=LIMIT_S), theirs(worlds, time_limit_s=LIMIT_S)
    a.seed(7)
    b.seed(7)
    assert_same(a.reset(), b.reset())
    rng, ended = np.random.default_rng(0), set()
    for _ in range(STEPS):
        actions = rng.uniform(-1.0, 1.0, (worlds, 2)).astype(np.float32)
        actions[0] = 1.0, 0.3  # leaves the road; the others run out of time
        (seen, rewards, dones, infos), expected = a.step(actions), b.step(actions)
        assert_same(seen, expected[0])
        np.testing.assert_array_equal(rewards, expected[1])
        np.testing.assert_array_equal(dones, expected[2])
        for info, other in zip(infos, expected[3], strict=True):
            assert ("episode" in info) == ("episode" in other)
            if "episode" in info:
                truncated = info["TimeLimit.truncated"]
                assert truncated == other["TimeLimit.truncated"]
                ended.add(truncated)
                assert_same(info["terminal_observation"], other["terminal_observation"])
                assert info["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert info["episode"]["l"] == other["episode"]["l"]
                assert info["episode_summary"]["return"] == pytest.approx(info["episode"]["r"])
    assert ended == {True, False}, "the drives should end in both ways"


def test_seeds_are_used_once():
    envs = ours(1)
    envs.seed(3)
    first = envs.reset()["bev"]
    second = envs.reset()["bev"]
    envs.seed(3)
    np.testing.assert_array_equal(envs.reset()["bev"], first)
    assert (second != first).any()


def test_worlds_that_wait_for_a_reset_are_refused():
    with pytest.raises(ValueError, match="autoreset_mode=\"SameStep\", got 'NextStep'"):
        SB3VecEnv(BEVTownVectorEnv(2, "Town02", bev=BEV))


def test_it_knows_its_worlds():
    envs = ours(3)
    assert envs.get_attr("render_mode") == [None] * 3
    assert envs.env_is_wrapped(Monitor, indices=[0, 2]) == [True, True]
    assert envs.env_is_wrapped(BEVTownEnv) == [False] * 3
    with pytest.raises(NotImplementedError):
        envs.env_method("snapshot")
    with pytest.raises(NotImplementedError):
        envs.set_attr("settings", None)
    with pytest.raises(RuntimeError, match="step_async"):
        envs.step_wait()
    envs.close()
