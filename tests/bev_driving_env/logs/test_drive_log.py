"""What is rendered from a log is what was seen on the drive."""

import hashlib
import pickle
import shutil

import numpy as np
import pytest

from bev_driving_env import DriveLog
from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.renderer import CameraSettings
from bev_driving_env.cameras.rig import SURROUND, CameraRig
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.reach import within_sight

from .short_drives import STEPS, record_log


def assert_seen_again(log, seen):
    # backwards and to and fro, so that no answer depends on the one before
    for index in [*reversed(seen), *seen]:
        live = seen[index]
        np.testing.assert_array_equal(log.bev(index), live["bev"])
        frame = log.sensor_frame(index)
        for name, value in vars(live["frame"]).items():
            again = getattr(frame, name)
            assert again.dtype == value.dtype
            np.testing.assert_array_equal(again, value, err_msg=f"{name} of sample {index}")


def test_bev_measurements_route_map_and_images_are_those_of_the_drive(recorded):
    folder, seen = recorded
    log = DriveLog(folder)
    assert len(log) == 2 * STEPS
    assert any(live["bev"][3:].any() for live in seen.values())
    assert_seen_again(log, seen)


@pytest.mark.parametrize("appearance", ["test", "hard"])
def test_so_they_are_in_the_other_looks(tmp_path, appearance):
    seen = record_log(tmp_path, appearance, steps=40)
    assert_seen_again(DriveLog(tmp_path), seen)


SCRIPT = """
import hashlib
from bev_driving_env import DriveLog
log = DriveLog({folder!r}, cached_episodes=1)
for index in {indices}:
    frame = log.sensor_frame(index)
    parts = (log.bev(index), frame.images, frame.route_map, frame.measurements)
    print(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
"""


def test_so_they_are_in_another_process(recorded, tmp_path, printed_elsewhere):
    folder, seen = recorded
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(folder=str(folder), indices=list(seen)), encoding="utf-8")
    expected = []
    for live in seen.values():
        frame = live["frame"]
        parts = (live["bev"], frame.images, frame.route_map, frame.measurements)
        expected.append(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
    assert printed_elsewhere(script) == expected


def test_states_are_those_of_the_drive_where_anything_shows(recorded):
    folder, seen = recorded
    log = DriveLog(folder)
    left_out = 0
    for index, live in seen.items():
        state, then = log.state(index), live["state"]
        for name in ("ego", "command", "attitude", "signals", "steps", "episode_seed"):
            np.testing.assert_array_equal(getattr(state, name), getattr(then, name), err_msg=name)
        for name in ("route_points", "plan_points"):
            mine, theirs = getattr(state, name)[0], getattr(then, name)[0]
            np.testing.assert_array_equal(mine, theirs[: len(mine)], err_msg=name)
        actors = np.concatenate([state.vehicles[0], state.pedestrians[0]])
        all_then = np.concatenate([then.vehicles[0], then.pedestrians[0]])
        near = within_sight(then.ego[0], then.vehicles[0], then.pedestrians[0])
        np.testing.assert_array_equal(actors[near], all_then[near])
        assert not actors[~near].any()
        left_out += int((~near).sum())
    assert left_out > 0


def test_a_state_is_the_callers_own(recorded):
    log = DriveLog(recorded[0])
    before = log.bev(5)
    state = log.state(5)
    state.ego[:] = 0.0
    log.bev(6)
    np.testing.assert_array_equal(state.ego, 0.0)
    np.testing.assert_array_equal(log.bev(5), before)


def test_clean_and_applied_actions_are_told_apart(recorded):
    folder, seen = recorded
    log = DriveLog(folder)
    indices = np.array(list(seen))
    clean = np.stack([live["clean"] for live in seen.values()])
    applied = np.stack([live["applied"] for live in seen.values()])
    assert (clean != applied).any()
    np.testing.assert_array_equal(log.actions(indices), clean)
    np.testing.assert_array_equal(log.actions(indices, applied=True), applied)
    assert log.actions().shape == (len(log), 2)
    # the last command is what was applied a step before
    np.testing.assert_array_equal(log.measurements(11)[1:], log.actions(applied=True)[10])
    np.testing.assert_array_equal(log.measurements(STEPS)[1:], 0.0)


def test_other_cameras_and_other_views_can_be_asked_for(recorded):
    log = DriveLog(recorded[0], bev=BEVGeometry(size=96, px_per_m=2.5, ego_row=76))
    assert log.bev(0).shape == (6, 96, 96)
    assert log.route_map(0).shape == (96, 96)
    settings = CameraSettings(CameraRig(SURROUND[:2], (40, 60)), 3, False)
    assert log.images(0, settings).shape == (2, 40, 60, 3)
    assert log.sensor_frame(0, settings).intrinsics.shape == (2, 3, 3)


def test_a_sample_can_be_seen_in_another_look(recorded):
    log = DriveLog(recorded[0])
    look = draw_look("train", 3)
    seen = log.images(0, look=look)
    same = CameraSettings(log.camera_settings.rig, 3, log.camera_settings.motion)
    np.testing.assert_array_equal(seen, log.images(0, same))
    np.testing.assert_array_equal(seen, log.sensor_frame(0, look=look).images)
    assert (seen != log.images(0)).any()


def test_splits_and_windows_keep_to_their_episodes(recorded):
    log = DriveLog(recorded[0])
    assert [episode.route for episode in log.episodes] == [0, 3]
    assert log.indices("val").tolist() == list(range(STEPS))
    assert log.indices("train").tolist() == list(range(STEPS, 2 * STEPS))
    assert log.windows("all", length=60, stride=5).tolist() == [0, 5, 10, 70, 75, 80]
    assert len(log.windows("all", length=STEPS + 1)) == 0
    with pytest.raises(ValueError, match="unknown split 'test'; splits are: all, train, val"):
        log.indices("test")
    with pytest.raises(ValueError, match="stride must be an int of at least 1"):
        log.windows(stride=0)


def test_indices_count_from_the_end_too_and_end_somewhere(recorded):
    log = DriveLog(recorded[0])
    np.testing.assert_array_equal(log.measurements(-1), log.measurements(len(log) - 1))
    assert log.locate(np.int64(STEPS)) == (1, 0)
    for index in (len(log), -len(log) - 1, 1.5):
        with pytest.raises(IndexError, match="has 140 samples"):
            log.bev(index)


def test_a_pickled_log_is_small_and_renders_the_same(recorded):
    log = DriveLog(recorded[0])
    view = log.images(3)
    content = pickle.dumps(log)
    assert len(content) < 100_000
    np.testing.assert_array_equal(pickle.loads(content).images(3), view)


def files_of(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("ending", ["steps", "actors"])
def test_a_truncated_episode_is_named_and_nothing_is_written(copied, ending):
    path = next(copied.glob(f"episodes/*_03.{ending}.parquet"))
    path.write_bytes(path.read_bytes()[:500])
    before = files_of(copied)
    with pytest.raises(LogError, match=rf"route_03\.{ending}\.parquet is truncated"):
        DriveLog(copied).bev(-1)
    assert files_of(copied) == before


def test_a_missing_or_exchanged_file_of_actors_is_named(copied):
    first, second = sorted(copied.glob("episodes/*.actors.parquet"))
    shutil.copy(first, second)
    with pytest.raises(LogError, match=r"route_03\.actors\.parquet does not belong to"):
        DriveLog(copied).bev(-1)
    second.unlink()
    with pytest.raises(LogError, match=r"route_03\.actors\.parquet is missing"):
        DriveLog(copied).bev(-1)


def test_an_episode_under_the_name_of_another_is_named(copied):
    """It would be read twice, and the other one never."""
    for ending in ("steps", "actors"):
        first, second = sorted(copied.glob(f"episodes/*.{ending}.parquet"))
        shutil.copy(first, second)
    with pytest.raises(LogError, match=r"route_03.* was written as .*route_00\.steps\.parquet"):
        DriveLog(copied)


def all_that_is_read(folder):
    """Every value that a log gives out, as bytes; names of folders aside."""
    log = DriveLog(folder)
    parts = [repr((log.header, log.episodes)).encode(), log.actions().tobytes()]
    for episode in range(len(log.episodes)):
        recorded = vars(log.replay(episode).log)
        parts += [value.tobytes() for value in recorded.values() if isinstance(value, np.ndarray)]
    return b"".join(parts)


def test_whatever_byte_is_damaged_the_log_is_refused_or_read_as_it_was(copied):
    rng = np.random.default_rng(0)
    whole, files, refused = all_that_is_read(copied), files_of(copied), 0
    for path, content in sorted(files.items()) * 40:
        # the last bytes of a table describe it
        start = max(0, len(content) - int(rng.choice([2500, len(content)])))
        spoilt = bytearray(content)
        spoilt[rng.integers(start, len(content))] ^= 1 << rng.integers(8)
        path.write_bytes(spoilt if rng.random() < 0.8 else spoilt[: rng.integers(len(content))])
        try:
            assert all_that_is_read(copied) == whole, path
        except LogError as error:
            assert path.name in str(error)  # noqa: PT017  # sometimes there is none
            refused += 1
        path.write_bytes(content)
    assert refused > 150


def test_a_log_whose_first_episode_is_still_being_driven_is_empty(copied):
    shutil.rmtree(copied / "episodes")
    log = DriveLog(copied)
    assert len(log) == 0
    assert log.actions().shape == (0, 2)
    assert len(log.indices("train")) == 0
    with pytest.raises(IndexError, match="has 0 samples"):
        log.bev(0)
