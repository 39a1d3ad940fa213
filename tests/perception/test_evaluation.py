"""Evaluations of sources with planted errors, whose IoU is known."""

import numpy as np
import pytest
import torch

from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.sources.corrupted import CorruptedBEV
from bev_driving_env.sources.ipm import IPM
from bev_driving_env.sources.protocol import BEVSourceError, PrivilegedSource
from perception.evaluation import BANDS, evaluate, worker_pool
from perception.evaluation_frames import FrameKey, View
from perception.metrics import channel_iou
from perception.models.bev_unet import BEVUNetConfig
from perception.models.presets import ModelSpec
from perception.places import Places
from perception.predicting import predicted
from perception.weights import Predictor, save_predictor


class Planted(PrivilegedSource):
    """The truth without its left half, in other channels' order; the route only near by."""

    channels = ("lane", "route", "road")
    needs_frame = False
    needs_truth = True

    def perceive(self, frame, truth):
        planes = truth[[2, 1, 0]].copy()
        planes[:, :, :96] = 0
        planes[1, :110] = 0
        return planes


class FromMap:
    """A source with no images: the map is the route, whatever its value is the road."""

    channels = ("route",)

    def __init__(self):
        self.batches = []

    def reset(self):
        pass

    def __call__(self, frame):
        return frame.route_map[None]

    def predict_batch(self, frames):
        self.batches.append(len(frames))
        return np.stack([self(frame) for frame in frames])


class Counting:
    """Remembers: the first frame after a reset is right, the others are not."""

    channels = ("road",)

    def reset(self):
        self.seen = 0

    def __call__(self, frame):
        self.seen += 1
        return np.full((1, 192, 192), 255 if self.seen == 1 else 0, np.uint8)


@pytest.fixture(scope="module")
def logs(log_folder):
    return [DriveLog(log_folder)]


def truths(logs, evaluation):
    return np.stack([logs[key.log].bev(key.sample) for key in evaluation.keys])


def test_the_truth_is_perfect(logs):
    found = evaluate("ground_truth", logs, samples=5)
    assert found.channels == CHANNELS
    present = truths(logs, found).any(axis=(0, 2, 3))
    assert present[:4].all()
    for iou in (found.iou(), found.mean_frame_iou()):
        expected = [1.0 if there else np.nan for there in present]
        np.testing.assert_array_equal(list(iou.values()), expected)


def test_planted_errors_have_the_iou_that_they_must_have(logs):
    found = evaluate(Planted(), logs, samples=12)
    assert (found.source, found.channels) == ("Planted", ("road", "route", "lane"))
    truth = truths(logs, found)[:, :3]
    wrong = truth.copy()
    wrong[..., :96] = 0
    wrong[:, 1, :110] = 0
    np.testing.assert_allclose(list(found.iou().values()), channel_iou(wrong, truth))
    right = [(frame[..., 96:] > 0).sum() / (frame > 0).sum() for frame in truth[:, 0]]
    assert found.mean_frame_iou()["road"] == pytest.approx(np.mean(right))
    # what is missing of the route on the right half is beyond 8.4 m
    rows, columns = np.indices((192, 192))
    far = np.hypot(*np.moveaxis(BEVGeometry().ego_from_pixel(np.dstack([columns, rows])), -1, 0))
    for band, (low, high) in enumerate(((0, 10), (10, 20), (20, 99))):
        here = (far >= low) & (far < high)
        expected = channel_iou(wrong * here, truth * here)
        np.testing.assert_allclose(list(found.iou(band=band).values()), expected)
    assert len(BANDS) == 3


def test_figures_of_a_place_are_those_of_its_frames(logs):
    found = evaluate(Planted(), logs, samples=12)
    truth = truths(logs, found)[:, :3]
    wrong = truth.copy()
    wrong[..., :96] = 0
    wrong[:, 1, :110] = 0
    planted = Places(np.arange(12) % 3 > 0, np.arange(12) % 3 > 1)
    object.__setattr__(found, "places", planted)
    for place, frames in (
        ("straight", slice(0, None, 3)),
        ("turn", slice(2, None, 3)),
        ("critical", [1, 2, 4, 5, 7, 8, 10, 11]),
    ):
        expected = channel_iou(wrong[frames], truth[frames])
        np.testing.assert_allclose(list(found.iou(place).values()), expected)


def test_a_source_that_remembers_starts_afresh_with_every_frame(logs):
    found = evaluate(Counting(), logs, samples=9)
    shares = (truths(logs, found)[:, 0] > 0).mean(axis=(1, 2))
    np.testing.assert_allclose(found.counts.frame_iou()[:, 0, 0], shares)


def test_batched_sources_are_asked_for_batches(logs):
    source = FromMap()
    evaluate(source, logs, samples=11)
    assert source.batches == [8, 3]


def test_changed_maps_change_what_comes_from_the_map(logs):
    found = {
        change: evaluate(FromMap(), logs, samples=8, change=change)
        for change in ("none", "black", "other_images", "no_map", "other_map")
    }
    truth = truths(logs, found["none"])[:, 1:2]
    for change, keys in (
        ("none", found["none"].keys),
        ("black", found["none"].keys),
        ("other_images", found["none"].keys),
        ("other_map", found["other_map"].others),
    ):
        maps = np.stack([logs[0].route_map(key.sample) for key in keys])[:, None]
        np.testing.assert_allclose(found[change].iou()["route"], channel_iou(maps, truth))
    assert found["no_map"].iou()["route"] == 0.0
    assert found["other_map"].iou() != found["none"].iou()


def test_black_cameras_blind_a_source_that_looks(logs):
    seeing, blind = (evaluate(IPM(), logs, samples=8, change=c) for c in ("none", "black"))
    assert seeing.iou()["road"] > 0.6 > blind.iou()["road"]
    assert seeing.iou()["route"] == blind.iou()["route"]


def test_random_sources_draw_anew_for_every_frame_and_seed(logs):
    noisy = CorruptedBEV("ground_truth", pixel_dropout=0.3)
    one, same, other = (evaluate(noisy, logs, samples=3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.counts.hits, same.counts.hits)
    assert (one.counts.hits != other.counts.hits).any()


@pytest.fixture
def network(tmp_path):
    """A file with a small untrained network that was made for small images."""
    torch.manual_seed(0)
    blocks = {"widths": (8, 8), "encoder_blocks": (0, 1), "decoder_blocks": (0,)}
    spec = ModelSpec("bev_unet", BEVUNetConfig(channels=("road", "route"), **blocks))
    path = tmp_path / "toy.safetensors"
    save_predictor(Predictor(spec, spec.build(), (0.5, 0.5), (56, 120), {}), path)
    return path


def test_a_network_is_shown_images_of_the_size_it_was_made_for(logs, network):
    found = evaluate(network, logs, samples=3)
    assert found.view.camera_size == (56, 120)
    assert found.channels == ("road", "route")


def test_the_result_does_not_depend_on_the_number_of_workers(logs, network):
    noisy = CorruptedBEV("ground_truth", pixel_dropout=0.3)
    with worker_pool(2) as pool:
        for source in (network, noisy):
            alone = evaluate(source, logs, samples=17)
            shared = evaluate(source, logs, samples=17, pool=pool)
            np.testing.assert_array_equal(alone.counts.hits, shared.counts.hits)
            np.testing.assert_array_equal(alone.counts.predicted, shared.counts.predicted)
            assert alone.keys == shared.keys
    assert 0.6 < alone.iou()["road"] < 0.8


def test_progress_is_told(logs):
    told = []
    evaluate("ground_truth", logs, samples=10, progress=told.append)
    assert told == [8, 2]


def test_turns_are_told_by_pooled_iou_quantiles_and_shares(with_route_iou):
    percent = [0, 10, 30, 50, 60, 69, 70, 80, 90, 100, 5, 5, -1]
    found = with_route_iou(percent, [True] * 10 + [False] * 2 + [True])
    turns = found.turns()
    assert turns.frames == 10
    assert turns.iou == pytest.approx(sum(percent[:10]) / 1000)
    assert (turns.quantile_05, turns.median) == (pytest.approx(0.045), pytest.approx(0.645))
    assert (turns.under_50, turns.under_70) == (pytest.approx(0.3), pytest.approx(0.6))


def test_without_turns_or_without_a_route_nothing_is_told(logs, with_route_iou):
    nothing = with_route_iou([10, 20], [False, False]).turns()
    assert nothing.frames == 0
    assert np.isnan(nothing[1:]).all()
    found = evaluate(Counting(), logs, samples=2)
    assert found.turns() is None
    with pytest.raises(ValueError, match="Counting does not predict the route"):
        found.route_iou()


def test_predictions_come_in_the_order_of_channels(logs):
    truth = logs[0].bev(20)
    frame = View().frame(logs, FrameKey(0, 20, 0), FrameKey(0, 20, 0))
    (planes,) = predicted("planted", Planted(), [frame], [truth], [0])
    np.testing.assert_array_equal(planes[0, :, 96:], truth[0, :, 96:])
    np.testing.assert_array_equal(planes[2, :, 96:], truth[2, :, 96:])


def test_what_makes_no_sense_is_refused(logs, log_folder):
    class Small(FromMap):
        def predict_batch(self, frames):
            return np.zeros((len(frames), 1, 64, 64), np.uint8)

    with pytest.raises(BEVSourceError, match="'Small' returned shape"):
        evaluate(Small(), logs, samples=2)
    with pytest.raises(ValueError, match=r"unknown bev_source 'imp'.*did you mean 'ipm'"):
        evaluate("imp", logs)
    other = DriveLog(log_folder, bev=BEVGeometry(size=96, ego_row=80))
    for source, given in ((Counting(), [*logs, other]), ("ipm", [other])):
        with pytest.raises(ValueError, match="must have one BEV geometry"):
            evaluate(source, given, samples=2)
