"""What is measured of the policy."""

from __future__ import annotations

import subprocess
import sys
import time
from statistics import median

import numpy as np
import pytest
import torch

from agents import make_agent
from agents.batches import SampleSet
from agents.beta_agent import BetaAgent
from agents.network import NetworkConfig, smallest_bev_size
from benchmarks import speed_policy
from bev_driving_env.env import BEVTownEnv

SIZE = smallest_bev_size() + 1  # geometries have an even side
NETWORK = NetworkConfig(bev_size=SIZE)
BATCH = 2


class SlowLog:
    """Drawing a BEV takes ten milliseconds, more than learning from it."""

    drawing_s = 0.01

    def bev(self, index):
        time.sleep(self.drawing_s)
        return np.full((6, SIZE, SIZE), index, np.uint8)

    def measurements(self, index):
        return np.zeros(3, np.float32)

    def actions(self):
        return np.zeros((8, 2), np.float32)

    def indices(self, split="all"):
        return np.arange(8)


class CountingEnv:
    """A step takes ten milliseconds; the observation is the number of the step."""

    def reset(self, seed):
        self.steps = 0
        return self.steps, {}

    def step(self, action):
        time.sleep(0.01)
        self.steps += 1
        assert action == -self.steps + 1
        return self.steps, 0.0, False, False, {}


def test_decisions_are_timed_in_a_closed_loop_and_the_worlds_steps_are_not():
    seen = []

    def act(observation):
        time.sleep(0.002)
        seen.append(observation)
        return -observation

    mean_s = speed_policy._decisions(CountingEnv(), act, 0)(5)
    assert seen == [0, 1, 2, 3, 4]
    assert 0.002 <= mean_s < 0.01


def test_what_is_timed_drives_as_bc_does():
    env = BEVTownEnv("Town01")
    observation, _ = env.reset(seed=3)
    timed, driver = BetaAgent(speed_policy.shipped_policy(), env), make_agent("bc", env)
    np.testing.assert_array_equal(timed.act(observation), driver.act(observation))


def test_inference_is_timed_per_observation_and_leaves_torch_its_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        times = speed_policy.measure_inference(3, rounds=2, seconds=0.01)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert times.keys() == {"single", "vector"}
    assert all(len(values) == 2 and min(values) > 0.0 for values in times.values())


def test_a_log_to_train_on_is_weighed_and_leaves_the_validation_route_out(tmp_path, monkeypatch):
    whole = speed_policy.log_settings
    monkeypatch.setattr(
        speed_policy, "log_settings", lambda *given: {**whole(*given), "time_limit_s": 5.0}
    )
    samples = speed_policy.training_samples(tmp_path, NetworkConfig())
    # two routes of five seconds at 10 Hz, channels up to the last that the network sees
    assert len(samples) == 100
    assert samples.batch(np.arange(2)).bev.shape == (2, 3, 192, 192)
    assert np.ptp(samples.weights) > 0.0


def test_training_waits_for_what_is_rendered():
    times = speed_policy.measure_training(
        SampleSet([SlowLog()]), NETWORK, BATCH, rounds=2, seconds=0.06
    )
    assert len(times["training"]) == len(times["rendering"]) == 2
    assert min(times["rendering"]) >= SlowLog.drawing_s
    # nothing that was rendered before the clock started is counted
    assert min(times["training"]) > 0.9 * SlowLog.drawing_s


def test_training_is_timed_with_the_trainer_of_bev_agents(monkeypatch):
    monkeypatch.setattr(SlowLog, "drawing_s", 0.0)
    losses = []

    class Watched(speed_policy.Trainer):
        def train(self, samples, until):
            for measured in super().train(samples, until):
                losses.append(measured.loss)
                yield measured

    monkeypatch.setattr(speed_policy, "Trainer", Watched)
    speed_policy.measure_training(SampleSet([SlowLog()]), NETWORK, BATCH, rounds=1, seconds=1e-6)
    # one step that counts and AHEAD + 1 before and behind it, once to know how long it takes
    assert len(losses) == 2 * (1 + 2 * (speed_policy.AHEAD + 1)) + 2
    assert np.isfinite(losses).all()


def test_figures_are_medians_and_the_share_is_one_of_each_round(monkeypatch):
    training, rendering = [0.004, 0.010, 0.005], [0.001, 0.001, 0.002]
    monkeypatch.setattr(
        speed_policy,
        "measure_inference",
        lambda *_, **__: {"single": [0.002, 0.001, 0.004], "vector": [0.0005, 0.0005, 0.1]},
    )
    monkeypatch.setattr(speed_policy, "training_samples", lambda *_: None)
    monkeypatch.setattr(
        speed_policy,
        "measure_training",
        lambda *_, **__: {"training": training, "rendering": rendering},
    )
    measured = speed_policy.figures(3, 0.1)
    share = median([0.001 / 0.004, 0.001 / 0.010, 0.002 / 0.005])
    assert [figure.value for figure in measured] == pytest.approx([500.0, 2000.0, 200.0, share])


def test_the_command_line_starts_without_pytorch():
    code = "import sys, benchmarks.cli; assert not {'torch', 'stable_baselines3'} & {*sys.modules}"
    subprocess.run([sys.executable, "-c", code], check=True)
