from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from benchmarks.drive import drive_moments, make_env
from benchmarks.report import replay, replay_store
from benchmarks.report.failures import failures_of, shot_of
from benchmarks.report_command import read_run
from bev_driving_env.render import bev_panel


@pytest.fixture
def failed(run_folder):
    """The first drive of a run whose driver never steers."""
    return read_run(run_folder)[0][0]


def test_the_last_seconds_end_at_the_recorded_infraction_and_show_the_truth(failed):
    (seen,) = replay.last_seconds(failed.job)
    assert seen.names == tuple(event["name"] for event in failed.events)
    assert seen.time_s == pytest.approx(failed.events[0]["time_s"])
    most = round(replay.SECONDS / (0.1 * replay.EVERY_STEPS)) + 1
    assert 1 < len(seen.frames) <= most
    env = make_env(failed.job)
    for _ in drive_moments(env, failed.job):
        pass
    truth = bev_panel(env.world.config, env.ground_truth_bev(), replay.SIDE_PX)
    # beyond the line between the pictures
    np.testing.assert_array_equal(seen.frames[-1][:, replay.SIDE_PX + 1 :], truth[:, 1:])
    np.testing.assert_array_equal(seen.frames[-1][:, : replay.SIDE_PX], truth)
    np.testing.assert_array_equal(seen.cameras, env.sensor_frame().images)


def test_a_film_has_its_frames_below_one_another():
    frames = np.zeros((3, 10, 20, 3), np.uint8)
    frames[1] = 200
    with Image.open(io.BytesIO(replay.film(frames))) as image:
        rows = np.asarray(image.convert("L")).mean(axis=1)
    assert len(rows) == 30
    assert rows[12:18].min() > 150
    assert max(rows[:8].max(), rows[22:].max()) < 50


def test_cameras_stand_two_beside_each_other():
    cameras = np.zeros((3, 40, 60, 3), np.uint8)
    with Image.open(io.BytesIO(replay.tiles(cameras, ("a", "b", "c")))) as image:
        assert image.size == (120, 80)


def test_a_replay_is_kept_and_made_anew_for_other_pictures(failed, tmp_path, monkeypatch):
    key, first = replay_store.replayed(failed.job, tmp_path)
    assert key == failed.job.key
    assert shot_of(failures_of(failed)[0], first) is first.shots[0]

    def never(job):
        raise AssertionError("driven again")

    monkeypatch.setattr(replay, "last_seconds", never)
    assert replay_store.replayed(failed.job, tmp_path)[1] == first
    monkeypatch.setattr(replay, "FILM_QUALITY", 31)
    assert replay_store.replayed(failed.job, tmp_path)[1].failure == "AssertionError: driven again"


def test_a_damaged_replay_is_made_anew(failed, tmp_path):
    (tmp_path / f"{failed.job.key}.json").write_text("{", encoding="utf-8")
    assert replay_store.replayed(failed.job, tmp_path)[1].failure == ""
