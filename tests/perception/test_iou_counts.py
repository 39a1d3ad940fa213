"""Counts for IoU by frame, region and threshold, against counting each question anew."""

import time

import numpy as np
import pytest
from sklearn.metrics import jaccard_score

from bev_driving_env.frames import BEVGeometry
from perception.iou_counts import (
    THRESHOLDS,
    IoUCounts,
    best_thresholds,
    iou_counts,
    range_bands,
)
from perception.metrics import channel_iou


def toy_planes(seed=0, frames=5, channels=2, size=10):
    rng = np.random.default_rng(seed)
    target = rng.random((frames, channels, size, size)) < 0.3
    noisy = 90.0 * target + rng.uniform(0.0, 165.0, target.shape)
    return noisy.astype(np.uint8), target


def test_every_threshold_gives_what_thresholding_first_would():
    prediction, target = toy_planes()
    counts = iou_counts(prediction, target)
    expected = [channel_iou(prediction / 255.0, target, threshold) for threshold in THRESHOLDS]
    np.testing.assert_allclose(counts.dataset_iou(), np.stack(expected, axis=1))
    assert counts.thresholds.shape == (2, 19)
    assert counts.thresholds[0, 9] == 0.5


def test_per_frame_iou_equals_scikit_learn():
    prediction, target = toy_planes(1)
    ours = iou_counts(prediction, target, [0.5]).frame_iou()
    for frame, channel in np.ndindex(5, 2):
        expected = jaccard_score(
            target[frame, channel].ravel(), prediction[frame, channel].ravel() >= 128
        )
        assert ours[frame, channel, 0] == pytest.approx(expected)


def test_frames_with_nothing_to_see_are_left_out_of_the_mean():
    prediction, target = np.zeros((2, 3, 2, 1, 4), bool)
    prediction[0, 0, 0, :2] = target[0, 0, 0, :1] = True  # 1 of 2
    prediction[1, 0, 0, :1] = True  # a false alarm: 0 of 1
    counts = iou_counts(prediction, target, [0.5])
    assert np.isnan(counts.frame_iou()[2, 0, 0])
    assert counts.mean_frame_iou()[0].tolist() == [0.25]
    assert np.isnan(counts.mean_frame_iou()[1]).all()
    assert np.isnan(counts.dataset_iou()[1]).all()


def test_batches_merge_to_the_counts_of_all():
    prediction, target = toy_planes(2)
    parts = [iou_counts(prediction[:2], target[:2]), iou_counts(prediction[2:], target[2:])]
    merged, whole = IoUCounts.merged(parts), iou_counts(prediction, target)
    assert len(merged) == 5
    for name in ("hits", "predicted", "actual"):
        np.testing.assert_array_equal(getattr(merged, name), getattr(whole, name))


def test_counts_of_other_thresholds_do_not_merge():
    prediction, target = toy_planes()
    with pytest.raises(ValueError, match="other thresholds"):
        IoUCounts.merged([iou_counts(prediction, target), iou_counts(prediction, target, [0.5])])
    with pytest.raises(ValueError, match="no counts"):
        IoUCounts.merged([])


def test_a_subset_of_frames_gives_what_these_frames_give():
    prediction, target = toy_planes(3)
    counts = iou_counts(prediction, target)
    mask = np.array([True, False, True, True, False])
    expected = iou_counts(prediction[mask], target[mask]).dataset_iou()
    np.testing.assert_array_equal(counts.subset(mask).dataset_iou(), expected)
    np.testing.assert_array_equal(counts.subset([0, 2, 3]).dataset_iou(), expected)
    assert np.isnan(counts.subset(~mask & mask).dataset_iou()).all()
    with pytest.raises(ValueError, match=r"shape \(5,\), got \(4,\)"):
        counts.subset(mask[:4])


def test_regions_give_what_blanking_the_rest_gives():
    prediction, target = toy_planes(4)
    regions = np.random.default_rng(0).integers(-1, 3, (10, 10))
    counts = iou_counts(prediction, target, regions=regions)
    for region in range(3):
        inside = regions == region
        expected = iou_counts(prediction * inside, target & inside).dataset_iou()
        np.testing.assert_array_equal(counts.region_iou()[region], expected)
        np.testing.assert_array_equal(counts.subset(regions=[region]).dataset_iou(), expected)
    inside = regions >= 0
    expected = iou_counts(prediction * inside, target & inside)
    np.testing.assert_array_equal(counts.dataset_iou(), expected.dataset_iou())
    np.testing.assert_array_equal(counts.frame_iou(), expected.frame_iou())


def test_the_best_threshold_of_each_channel_is_found_and_can_be_taken():
    target = np.zeros((1, 3, 1, 4), bool)
    target[..., :2] = True
    target[:, 2] = False
    prediction = np.zeros(target.shape)
    prediction[0, 0] = [0.95, 0.32, 0.28, 0.0]  # only 0.3 separates
    prediction[0, 1] = [0.90, 0.90, 0.10, 0.0]  # many do: the one nearest 0.5
    counts = iou_counts(prediction, target)
    best = best_thresholds(counts)
    np.testing.assert_allclose(best, [0.3, 0.5, 0.5])
    assert counts.at(best).dataset_iou()[:2, 0].tolist() == [1.0, 1.0]
    assert np.isnan(counts.at(best).dataset_iou()[2, 0])
    np.testing.assert_array_equal(channel_iou(prediction, target, best)[:2], [1.0, 1.0])
    with pytest.raises(ValueError, match="nothing was counted at"):
        counts.at([0.3, 0.5, 0.51])
    with pytest.raises(ValueError, match="each of 3 channels"):
        counts.at([0.3])


def test_channels_can_be_counted_at_thresholds_of_their_own():
    prediction, target = toy_planes(5)
    counts = iou_counts(prediction, target, [[0.3], [0.6]])
    expected = channel_iou(prediction, target, [0.3, 0.6])
    np.testing.assert_array_equal(counts.dataset_iou()[:, 0], expected)


def test_range_bands_are_rings_around_the_ego():
    bands = range_bands(BEVGeometry(), [10.0, 20.0])
    assert bands[152, 96] == bands[152 - 49, 96] == bands[152, 96 - 49] == 0
    assert bands[152 - 50, 96] == bands[152 - 99, 96] == bands[152, 0] == 1
    assert bands[152 - 100, 96] == bands[0, 0] == 2
    for edges in ([10.0, 10.0], [0.0, 5.0], [[1.0]]):
        with pytest.raises(ValueError, match="edges_m must be positive and rising"):
            range_bands(BEVGeometry(), edges)


@pytest.mark.parametrize(
    ("regions", "named"),
    [
        (np.zeros((3, 3), int), r"shape \(10, 10\), got int64 of shape \(3, 3\)"),
        (np.zeros((10, 10)), "must be integers .* got float64"),
        (np.full((10, 10), -2), "from 0 to 1000, or -1"),
    ],
)
def test_other_regions_are_refused(regions, named):
    with pytest.raises(ValueError, match=named):
        iou_counts(*toy_planes(), regions=regions)


def test_a_full_frame_is_counted_in_a_millisecond():
    prediction, target = toy_planes(6, frames=4, channels=6, size=192)
    bands = range_bands(BEVGeometry(), [10.0, 20.0])
    iou_counts(prediction, target, regions=bands)  # compiles
    taken = []
    for _ in range(10):
        started = time.process_time()
        iou_counts(prediction, target, regions=bands)
        taken.append((time.process_time() - started) / 4)
    assert min(taken) < 0.001
