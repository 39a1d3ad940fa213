"""Metrics of frames counted by hand."""

import math

import numpy as np
import pytest

from benchmarks.online import NATS
from benchmarks.study.metrics import METRICS, ONLINE, OPEN_LOOP, online_metrics, open_loop_metrics
from benchmarks.study.open_loop import OpenLoop
from perception.iou_counts import IoUCounts
from perception.places import PLACES, Places

NAMES = {
    family: {metric.name for metric in METRICS if metric.family == family}
    for family in (OPEN_LOOP, ONLINE)
}


@pytest.fixture
def found():
    """Two frames, the second at a turn, of which the far route is missed, and the near one halved.

    Each channel covers 10 pixels in each of the three bands of distance.
    """
    actual = np.full((2, 3, 3), 10, np.int32)
    predicted = np.full((2, 3, 3, 1), 10, np.int32)
    hits = predicted.copy()
    hits[1, 0, 1], hits[1, 2, 1] = 5, 0
    predicted[1, 0, 1], predicted[1, 2, 1] = 5, 0
    counts = IoUCounts(np.full((3, 1), 0.5), hits, predicted, actual)
    places = Places(np.array([False, True]), np.array([False, True]))
    return OpenLoop(counts, places, np.array([0.0, 4.0]), np.array([[0.5, 0.0], [0.5, 0.2]]))


def test_open_loop_metrics_are_what_one_counts_by_hand(found):
    values = open_loop_metrics(found)
    assert set(values) == NAMES[OPEN_LOOP]
    expected = {
        "iou_road": 1.0,
        "iou_route": 45 / 60,
        "mean_iou": (2 + 45 / 60) / 3,
        "iou_route_turn": 0.5,
        "iou_route_critical": 0.5,
        "mean_iou_turn": 2.5 / 3,
        "iou_route_near": 15 / 20,
        "iou_route_far": 10 / 20,
        "mean_iou_near": (2 + 15 / 20) / 3,
        "mean_iou_frame": (2 + 0.75) / 3,
        "route_turn_median": 0.5,
        "route_turn_good": 0.0,
        "divergence": 2.0,
        "divergence_turn": 4.0,
        "divergence_q95": 3.8,
        "steering_gap": 0.1,
        "steering_gap_turn": 0.2,
    }
    assert {name: values[name] for name in expected} == pytest.approx(expected)


def test_without_turns_and_divergence_their_metrics_are_unknown(found):
    nowhere = Places(found.places.critical, np.zeros(2, bool))
    silent = np.full(2, np.nan)
    values = open_loop_metrics(OpenLoop(found.counts, nowhere, silent, found.action_gap))
    for name in ("iou_route_turn", "route_turn_good", "steering_gap_turn", "divergence"):
        assert math.isnan(values[name]), name
    assert values["mean_iou"] == pytest.approx((2 + 45 / 60) / 3)


def test_online_metrics_add_up_the_drives():
    def part(hits, union):
        counts = {"road": 4, "route": hits, "lane": 4}
        whole = {"road": 4, "route": union, "lane": 8}
        rest = dict.fromkeys(("vehicles", "pedestrians", "lights"), 0)
        histogram = [0] * (len(NATS) - 1)
        histogram[40] = 2
        return {
            "moments": 1,
            "hits": {**counts, **rest},
            "union": {**whole, **rest},
            "divergence": histogram,
        }

    drives = [{place: part(*pixels) for place in PLACES} for pixels in ((1, 4), (3, 4))]
    values = online_metrics("blind", [*drives, None])
    assert set(values) == NAMES[ONLINE]
    assert values["online_iou_route"] == pytest.approx(0.5)
    assert values["online_mean_iou"] == pytest.approx((1.0 + 0.5 + 0.5) / 3)
    assert 1.0 <= values["online_divergence"] <= 10.0**0.1


def test_the_truth_needs_no_summaries_and_failed_variants_have_none():
    truth = online_metrics("ground_truth", [None, None])
    assert set(truth) == NAMES[ONLINE]
    assert (truth["online_mean_iou"], truth["online_divergence"]) == (1.0, 0.0)
    assert all(math.isnan(value) for value in online_metrics("blind", [None]).values())


def test_divergence_is_turned_so_that_more_is_better():
    by_name = {metric.name: metric for metric in METRICS}
    values = np.array([1.0, 2.0])
    assert by_name["divergence"].oriented(values).tolist() == [-1.0, -2.0]
    assert by_name["mean_iou"].oriented(values).tolist() == [1.0, 2.0]
