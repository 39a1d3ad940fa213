"""Pictures of predictions: which frames, and what is drawn."""

import cv2
import numpy as np
import pytest

from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.sources.registry import make_bev_source
from perception.evaluation import evaluate
from perception.mosaics import DARK, INVENTED, MISSED, TILE_PX, difference, mosaic_of, picks, png


def test_the_worst_and_the_middle_of_the_critical_frames_are_picked(with_route_iou):
    percent = [90, 10, 50, -1, 70, 30, 20, 1, 60]  # -1: no route anywhere
    found = picks(with_route_iou(percent, [True] * 7 + [False, True]), 2)
    assert [pick.name for pick in found] == ["worst_1", "worst_2", "median_1", "median_2"]
    # critical ones in order: 10, 20, 30, 50, 60, 70, 90
    assert [pick.number for pick in found[:2]] == [1, 6]
    assert [pick.route_iou for pick in found[2:]] == [pytest.approx(0.3), pytest.approx(0.5)]
    (_, middle) = picks(with_route_iou(percent, [True] * 7 + [False, True]), 1)
    assert middle.route_iou == pytest.approx(0.5)


def test_there_may_be_fewer_critical_frames_than_asked_for(with_route_iou):
    assert len(picks(with_route_iou([50, 60], [True, False]), 3)) == 2
    assert picks(with_route_iou([50, 60], [False, False]), 3) == []
    assert picks(with_route_iou([50, 60], [True, True]), 0) == []


def test_a_difference_shows_what_is_missed_and_what_is_invented():
    truth, bev = np.zeros((2, 2, 4, 4), np.uint8)
    truth[1, 0, 0] = bev[1, 0, 1] = 255  # the route
    truth[0, 1, 0] = bev[0, 1, 1] = 128  # the road
    truth[0, 2, 0], bev[0, 2, 0] = 255, 200  # found
    bev[0, 0, 0] = 255  # a road that is not there, under the missed route
    image = difference(truth, bev, ("road", "route"))
    assert image[0, 0].tolist() == list(MISSED)
    assert image[0, 1].tolist() == list(INVENTED)
    assert DARK < image[1, 0, 0] < MISSED[0]
    assert DARK < image[1, 1, 2] < INVENTED[2]
    assert (image[2:] == DARK).all()


def test_a_perfect_prediction_differs_in_nothing(log_folder):
    logs, source = [DriveLog(log_folder)], make_bev_source("ground_truth")
    found = evaluate(source, logs, samples=2)
    image = mosaic_of(found, 1, source, logs)
    assert image.shape == (2 * TILE_PX, 3 * TILE_PX, 3)
    below = image[TILE_PX + 30 : -1]  # without captions
    truth, bev, wrong = np.split(below, 3, axis=1)
    np.testing.assert_array_equal(truth[:, :-1], bev[:, :-1])
    assert (wrong[:, :-1] == DARK).all()
    assert len(np.unique(image[:TILE_PX, :TILE_PX].reshape(-1, 3), axis=0)) > 1000
    read = cv2.imdecode(np.frombuffer(png(image), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(read[..., ::-1], image)
