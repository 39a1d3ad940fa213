"""IoU per channel, against torchmetrics and scikit-learn."""

import numpy as np
import pytest
import torch
from sklearn.metrics import jaccard_score
from torchmetrics.classification import MultilabelJaccardIndex

from perception.metrics import channel_iou


def toy_planes(seed=0, frames=4, channels=3, size=12):
    """A target, and probabilities that lean towards it."""
    rng = np.random.default_rng(seed)
    target = (
        rng.random((frames, channels, size, size)) < np.linspace(0.5, 0.05, channels)[:, None, None]
    )
    noise = rng.random(target.shape).astype(np.float32)
    return np.clip(0.6 * target + 0.7 * noise - 0.1, 0.0, 1.0).astype(np.float32), target


@pytest.mark.parametrize("threshold", [0.5, 0.3, 0.85])
def test_the_iou_equals_torchmetrics(threshold):
    probabilities, target = toy_planes()
    oracle = MultilabelJaccardIndex(3, threshold=threshold, average="none")
    expected = oracle(torch.from_numpy(probabilities), torch.from_numpy(target).int())
    ours = channel_iou(probabilities, target, threshold)
    np.testing.assert_allclose(ours, expected.numpy(), rtol=1e-6)
    assert 0.05 < ours.min() < ours.max() < 1.0


def test_each_channel_has_its_threshold_and_equals_scikit_learn():
    probabilities, target = toy_planes(1)
    thresholds = (0.2, 0.5, 0.7)
    ours = channel_iou(probabilities, target, thresholds)
    for channel, threshold in enumerate(thresholds):
        expected = jaccard_score(
            target[:, channel].ravel(), probabilities[:, channel].ravel() >= threshold
        )
        assert ours[channel] == pytest.approx(expected)


def test_all_kinds_of_arrays_say_the_same():
    probabilities, target = toy_planes(2)
    mask = probabilities >= 0.5
    expected = channel_iou(mask, target)
    for prediction in (probabilities, mask * np.uint8(255), mask.astype(np.float64)):
        for truth in (target, target * np.uint8(255), target.astype(np.float16)):
            np.testing.assert_array_equal(channel_iou(prediction, truth), expected)
    np.testing.assert_array_equal(
        channel_iou(torch.from_numpy(probabilities), torch.from_numpy(target)), expected
    )


def test_one_frame_needs_no_batch_axis():
    probabilities, target = toy_planes()
    one = channel_iou(probabilities[0], target[0])
    np.testing.assert_array_equal(one, channel_iou(probabilities[:1], target[:1]))


def test_frames_are_added_up_before_dividing():
    prediction = np.zeros((2, 1, 1, 10), bool)
    target = np.zeros((2, 1, 1, 10), bool)
    prediction[0, ..., :8] = target[0, ..., :8] = True  # 8 of 8
    prediction[1, ..., :2] = True  # 0 of 2
    assert channel_iou(prediction, target).tolist() == [0.8]


def test_a_channel_that_is_empty_everywhere_is_nan_and_a_false_alarm_is_zero():
    prediction, target = np.zeros((2, 2, 3, 3, 3), bool)
    assert np.isnan(channel_iou(prediction, target)).all()
    prediction[0, 1, 0, 0] = True
    assert channel_iou(prediction, target)[1] == 0.0
    assert np.isnan(channel_iou(prediction, target)[[0, 2]]).all()


@pytest.mark.parametrize("level", [51, 127, 128, 255])
def test_a_pixel_at_the_threshold_is_occupied(level):
    prediction = np.full((1, 1, 1), level, np.uint8)
    occupied = np.ones((1, 1, 1), bool)
    assert channel_iou(prediction, occupied, level / 255) == [1.0]
    if level < 255:
        assert channel_iou(prediction, occupied, (level + 1) / 255) == [0.0]
    assert channel_iou(prediction, occupied) == [float(level >= 128)]


def test_a_threshold_forgives_the_rounding_of_its_own_type():
    occupied = np.ones((1, 1, 1), bool)
    for threshold in (12 * 0.05, float(np.float32(0.6))):  # both a little above 0.6
        assert channel_iou(np.full((1, 1, 1), 153, np.uint8), occupied, threshold) == [1.0]
    for kind in (np.float16, np.float32, np.float64):
        assert channel_iou(np.full((1, 1, 1), 0.7, kind), occupied, 0.7) == [1.0]


@pytest.mark.parametrize(
    ("prediction", "target", "threshold", "named"),
    [
        (np.zeros((1, 2, 2), bool), np.zeros((2, 2, 2), bool), 0.5, r"got \(1, 2, 2\) and \(2"),
        (np.zeros((2, 2), bool), np.zeros((2, 2), bool), 0.5, "must have one shape"),
        (np.zeros((1, 2, 2), int), np.zeros((1, 2, 2), bool), 0.5, "prediction must be .* int64"),
        (np.full((1, 2, 2), 2.5), np.zeros((1, 2, 2), bool), 0.5, "2.5 to 2.5; logits need"),
        (np.full((1, 2, 2), np.nan), np.zeros((1, 2, 2), bool), 0.5, "got nan to nan"),
        (np.zeros((1, 2, 2), bool), np.ones((1, 2, 2), np.uint8), 0.5, "target holds 0 and 1"),
        (np.zeros((1, 2, 2), bool), np.zeros((1, 2, 2), bool), 0.0, r"in \(0, 1\], got 0.0"),
        (np.zeros((1, 2, 2), bool), np.zeros((1, 2, 2), bool), [0.5, 0.5], "each of 1 channels"),
    ],
)
def test_what_has_no_iou_is_refused(prediction, target, threshold, named):
    with pytest.raises(ValueError, match=named):
        channel_iou(prediction, target, threshold)
