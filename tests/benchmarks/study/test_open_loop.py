"""Variants on fixed frames."""

import numpy as np
import pytest

from benchmarks.errors import OtherRunError
from benchmarks.study import open_loop
from benchmarks.study.open_loop import OpenLoop, measure, measure_all
from benchmarks.study.variants import ERRONEOUS_TRUTH, Variant
from bev_driving_env.sources.corruptions import LATENCY_FRAMES
from bev_driving_env.sources.policy_view import PolicyView
from perception.metrics import channel_iou


class Counting:
    """Steers by the number of route pixels, and tells how much less there is than in the truth."""

    def reset(self, seed):
        pass

    def act(self, observation):
        return np.array([0.0, observation["bev"][1].mean() / 255.0], np.float32)

    def divergence(self, observation, other):
        return float(self.act(observation)[1] - self.act(other)[1])


def test_frames_have_a_whole_clip_before_them_and_are_spread_over_all_drives(frames):
    (log,) = frames.logs
    steps = [log.locate(key.sample) for key in frames.keys]
    assert len(steps) == len(set(steps)) == 12
    assert min(step for _, step in steps) >= LATENCY_FRAMES
    assert {episode for episode, _ in steps} == set(range(len(log.episodes)))
    assert len({key.look_seed for key in frames.keys}) == 12
    assert len(frames.places.turn) == 12


def test_the_truth_is_worth_the_truth(frames):
    found = measure("ground_truth", Counting(), frames)
    np.testing.assert_array_equal(found.counts.dataset_iou()[:, 0], 1.0)
    assert not found.divergence.any()
    assert not found.action_gap.any()


def test_latency_shows_what_was_true_before(frames):
    (log,) = frames.logs
    found = measure("ground_truth~latency=0.4", Counting(), frames)
    before = np.stack([log.bev(key.sample - 4)[:3] for key in frames.keys])
    now = np.stack([log.bev(key.sample)[:3] for key in frames.keys])
    np.testing.assert_allclose(found.counts.dataset_iou()[:, 0], channel_iou(before, now))
    covered = [(bev[:, 1] > 0).mean(axis=(1, 2)) for bev in (now, before)]
    np.testing.assert_allclose(found.divergence, covered[0] - covered[1], atol=1e-6)
    np.testing.assert_allclose(found.action_gap[:, 1], abs(covered[0] - covered[1]), atol=1e-6)


def test_only_corrupted_channels_lose_and_each_frame_draws_its_own_errors(frames):
    found = measure("ground_truth~shift=0.3@route", Counting(), frames)
    road, route, lane = found.counts.dataset_iou()[:, 0]
    assert (road, lane) == (1.0, 1.0)
    assert 0.05 < route < 0.95
    assert len(set(found.counts.frame_iou()[:, 1, 0].tolist())) > 6


def test_agents_that_explain_nothing_have_no_divergence(frames):
    class Silent:
        reset, act = Counting.reset, Counting.act

    assert np.isnan(measure("ground_truth~shift=0.3", Silent(), frames).divergence).all()


def test_cameras_are_rendered_in_the_look_of_the_frame(frames):
    shown = []

    class Watching:
        channels = ("road",)

        def reset(self):
            pass

        def __call__(self, frame):
            shown.append(frame)
            return np.zeros((1, 192, 192), np.uint8)

    view = PolicyView(Watching(), 1, frames.logs[0].geometry)
    for key in frames.keys[:2]:
        sight = frames.seen(view, key, 2)
        assert not sight.bev.any()
        np.testing.assert_array_equal(sight.truth, frames.logs[0].bev(key.sample))
    assert len(shown) == 6
    assert shown[0].images.shape == (4, 112, 240, 3)
    means = [frame.images.mean(axis=(0, 1, 2)) for frame in shown]
    within = np.abs(means[0] - means[2]).max()
    assert within < np.abs(means[0] - means[3]).max()


def test_what_was_measured_is_kept_and_read_again(frames, tmp_path, monkeypatch):
    variants = [Variant(f"ground_truth~shift={k}", ERRONEOUS_TRUTH) for k in (0.1, 0.3)]
    monkeypatch.setattr(open_loop, "make_agent", lambda spec, env: Counting())
    first = measure_all(variants[:1], "stub", frames, tmp_path, 1)
    measured = []
    real = open_loop.measure
    monkeypatch.setattr(
        open_loop, "measure", lambda spec, *rest: measured.append(spec) or real(spec, *rest)
    )
    both = measure_all(variants, "stub", frames, tmp_path, 1)
    assert measured == ["ground_truth~shift=0.3"]
    for name in ("hits", "predicted", "actual"):
        np.testing.assert_array_equal(getattr(both[0].counts, name), getattr(first[0].counts, name))
    np.testing.assert_array_equal(both[0].divergence, first[0].divergence)


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "variant.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(OtherRunError, match=r"variant\.npz holds no such counts.*delete it"):
        OpenLoop.load(path)
