"""Which frames are shown to a predictor, and what is changed in them."""

import dataclasses

import numpy as np
import pytest

from bev_driving_env.cameras.look import draw_look
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.errors import LogError
from perception.evaluation_frames import FrameKey, View, others_elsewhere, spread_keys


@pytest.fixture(scope="module")
def logs(log_folder):
    return [DriveLog(log_folder)]


def test_samples_lie_evenly_spread(logs):
    assert [key.sample for key in spread_keys(logs, "all", 6)] == [5, 15, 25, 35, 45, 55]
    assert [key.sample for key in spread_keys(logs, "val", 3)] == [5, 15, 25]
    both = spread_keys([*logs, *logs], "train", 4)
    assert [(key.log, key.sample) for key in both] == [(0, 37), (0, 52), (1, 37), (1, 52)]
    assert len({key.look_seed for key in both}) == 4


def test_all_samples_are_taken_if_there_are_fewer(logs):
    keys = spread_keys(logs, "train", 1000)
    assert [key.sample for key in keys] == list(range(30, 60))


def test_the_seed_decides_the_looks_alone(logs):
    one, same, other = (spread_keys(logs, "all", 5, seed) for seed in (1, 1, 2))
    assert one == same
    assert [key.sample for key in one] == [key.sample for key in other]
    assert all(a.look_seed != b.look_seed for a, b in zip(one, other, strict=True))


def test_other_frames_are_of_places_out_of_sight(logs):
    keys = spread_keys(logs, "all", 12)
    others = others_elsewhere(logs, keys, apart_m=30.0)
    places = np.array(
        [[logs[0].state(k.sample).ego[0, :2] for k in keys_] for keys_ in (keys, others)]
    )
    assert (np.hypot(*(places[0] - places[1]).T) > 30.0).all()
    assert set(others) <= set(keys)
    assert len(set(others)) > 4
    assert others == others_elsewhere(logs, keys, apart_m=30.0)
    assert others != others_elsewhere(logs, keys, 1, apart_m=30.0)


def test_without_places_out_of_sight_the_farthest_is_taken(logs):
    keys = spread_keys(logs, "val", 30)
    start = logs[0].state(keys[0].sample).ego[0, :2]
    away = [np.hypot(*(logs[0].state(key.sample).ego[0, :2] - start)) for key in keys]
    assert others_elsewhere(logs, keys)[0] == keys[int(np.argmax(away))]
    with pytest.raises(ValueError, match="at least 2 samples"):
        others_elsewhere(logs, keys[:1])


@pytest.mark.parametrize("change", ["none", "black", "other_images", "no_map", "other_map"])
def test_a_change_touches_cameras_or_map_and_nothing_else(logs, change):
    key, other = FrameKey(0, 3, 17), FrameKey(0, 50, 18)
    log = logs[0]
    plain = View().frame(logs, key, other)
    elsewhere = View().frame(logs, other, key)
    shown = View(change=change).frame(logs, key, other)
    images = {"black": np.zeros_like(plain.images), "other_images": elsewhere.images}
    maps = {"no_map": np.zeros_like(plain.route_map), "other_map": elsewhere.route_map}
    np.testing.assert_array_equal(shown.images, images.get(change, plain.images))
    np.testing.assert_array_equal(shown.route_map, maps.get(change, plain.route_map))
    np.testing.assert_array_equal(shown.measurements, log.measurements(3))
    assert (plain.route_map != elsewhere.route_map).any()


def test_frames_look_as_asked(logs):
    log, key = logs[0], FrameKey(0, 3, 17)
    settings = dataclasses.replace(log.camera_settings, appearance="test")
    wanted = log.images(3, settings, draw_look("test", 17))
    np.testing.assert_array_equal(View("test").frame(logs, key, key).images, wanted)
    np.testing.assert_array_equal(View("log").frame(logs, key, key).images, log.images(3))
    still = View("log", motion=False).frame(logs, key, key)
    assert (still.images != log.images(3)).mean() > 0.1
    small = View(camera_size=(32, 64)).frame(logs, key, key)
    assert small.images.shape == (4, 32, 64, 3)
    assert small.intrinsics[0, 0, 2] == pytest.approx(31.5)


def test_what_makes_no_sense_is_refused(logs):
    with pytest.raises(ValueError, match="appearance must be one of train, test, hard, log"):
        View("night")
    with pytest.raises(ValueError, match="change must be one of none, black"):
        View(change="blind")
    with pytest.raises(ValueError, match="samples must be"):
        spread_keys(logs, "all", 0)
    with pytest.raises(ValueError, match="unknown split 'test'"):
        spread_keys(logs, "test", 1)
    with pytest.raises(LogError, match="no sample of split 'all'"):
        spread_keys([], "all", 5)
