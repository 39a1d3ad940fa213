"""What the policy's BEV was worth while it drove."""

import copy
import json
import math

import numpy as np
import pytest
import torch
from torch.distributions import Beta, kl_divergence

from agents import Expert, make_agent
from benchmarks.drive import drive
from benchmarks.online import OnlineMetrics, OnlineRecorder, pooled, summary
from benchmarks.suites import Job
from bev_driving_env.env import BEVTownEnv
from perception.metrics import channel_iou

STEPS = 30


@pytest.fixture(scope="module")
def driven():
    """Thirty steps of the expert in an environment whose route is shown straight."""
    env = BEVTownEnv("Town02", bev_source=HalfBlind())
    observation, _ = env.reset(seed=0, options={"episode": 1})
    recorder, expert, shown = OnlineRecorder(env, object()), Expert(env), []
    for _ in range(STEPS):
        recorder.note(observation)
        shown.append((observation["bev"].copy(), env.ground_truth_bev()))
        observation, *_ = env.step(expert.act(observation))
    return recorder.metrics(), shown


class HalfBlind:
    """Sees the road to the left only, and a route everywhere."""

    channels = ("road", "route")

    def reset(self):
        pass

    def __call__(self, frame):
        bev = np.zeros((2, 192, 192), np.uint8)
        bev[0, :, :96] = 255
        bev[1] = 255
        return bev


def test_iou_is_that_of_the_bev_and_the_truth_at_each_moment(driven):
    metrics, shown = driven
    assert len(metrics) == STEPS
    bevs, truths = (np.stack(part) for part in zip(*shown, strict=True))
    np.testing.assert_allclose(list(metrics.iou().values()), channel_iou(bevs, truths))
    for iou, (bev, truth) in zip(metrics.step_iou(), shown, strict=True):
        np.testing.assert_allclose(iou, channel_iou(bev, truth))


def test_moments_are_told_apart_by_place(driven):
    metrics, shown = driven
    told = pooled([summary(metrics)])
    assert told["straight"].moments + told["critical"].moments == told["all"].moments == STEPS
    assert told["critical"].moments >= told["turn"].moments
    straight = [pair for pair, here in zip(shown, metrics.places.straight, strict=True) if here]
    wanted = channel_iou(*(np.stack(part) for part in zip(*straight, strict=True)))
    assert told["straight"].iou["road"] == pytest.approx(wanted[0])
    assert math.isnan(told["all"].iou["vehicles"])
    assert math.isnan(told["all"].divergence)


def test_drives_add_up_by_pixels_and_moments(driven):
    metrics, _ = driven
    sums = summary(metrics)
    assert pooled([sums, None, sums])["all"].iou["road"] == pooled([sums])["all"].iou["road"]
    assert pooled([sums, sums])["all"].moments == 2 * STEPS
    other = copy.deepcopy(sums)
    other["all"]["hits"]["road"], other["all"]["union"]["road"] = 0, 10**9
    assert pooled([sums, other])["all"].iou["road"] < 0.01
    assert math.isnan(pooled([])["all"].iou["road"])


def test_metrics_survive_a_file(driven, tmp_path):
    metrics, _ = driven
    metrics.save(tmp_path / "moments.npz")
    kept = OnlineMetrics.load(tmp_path / "moments.npz")
    assert summary(kept) == summary(metrics)
    np.testing.assert_array_equal(kept.route_m, metrics.route_m)
    (tmp_path / "moments.npz").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="holds no such counts"):
        OnlineMetrics.load(tmp_path / "moments.npz")


def test_divergence_is_that_of_the_policys_betas():
    env = BEVTownEnv("Town02", bev_source=HalfBlind())
    observation, _ = env.reset(seed=0, options={"episode": 1})
    agent = make_agent("bc", env)
    recorder = OnlineRecorder(env, agent)
    recorder.note(observation)
    truth = {**observation, "bev": env.ground_truth_bev()}
    with torch.inference_mode():
        ours, theirs = (Beta(*agent._heads(each)) for each in (truth, observation))
    wanted = kl_divergence(ours, theirs).sum().item()
    assert recorder.metrics().divergence[0] == pytest.approx(wanted, rel=1e-3)
    assert wanted > 0.1


def test_true_bev_diverges_nowhere():
    env = BEVTownEnv("Town02")
    observation, _ = env.reset(seed=0, options={"episode": 1})
    recorder = OnlineRecorder(env, make_agent("bc", env))
    recorder.note(observation)
    metrics = recorder.metrics()
    assert metrics.divergence.tolist() == [0.0]
    assert metrics.iou()["road"] == 1.0


def test_a_drive_keeps_its_moments(tmp_path):
    job = Job("Town02", "episode", 1, "ipm", "expert", 0, "test")
    result = drive(job, moments=tmp_path / "m.npz")
    kept = OnlineMetrics.load(tmp_path / "m.npz")
    assert len(kept) == result.steps + 1
    assert result.online == json.loads(json.dumps(summary(kept)))
    assert 0.3 < pooled([result.online])["all"].iou["road"] < 0.95
    assert drive(job).online is None
