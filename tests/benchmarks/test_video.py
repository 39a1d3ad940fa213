from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks import video as video_module
from benchmarks.cli import main
from benchmarks.drive import drive
from benchmarks.runner import run_jobs
from benchmarks.suites import Job
from benchmarks.video import VideoWriter

SHORT = """
import numpy as np

class Swerves:
    def __init__(self, env): pass
    def reset(self, seed): self.steps = 0
    def act(self, observation): return np.array([1.0, 0.4], np.float32)

class Fails(Swerves):
    def act(self, observation):
        self.steps += 1
        if self.steps > 4: raise RuntimeError("out of ideas")
        return np.array([1.0, 0.0], np.float32)
"""


@pytest.fixture
def drivers(tmp_path, monkeypatch):
    (tmp_path / "toy_short_drivers.py").write_text(SHORT, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)


def job_of(agent="toy_short_drivers:Swerves", index=0):
    return Job("Town02", "episode", index, "ground_truth", agent, 0, "test")


def frames_of(path):
    """The frames of a video as RGB, and its rate."""
    capture = cv2.VideoCapture(str(path))
    frames = []
    while True:
        there, frame = capture.read()
        if not there:
            break
        frames.append(frame[..., ::-1])
    rate = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return frames, rate


def test_a_video_holds_the_frames_it_was_given_in_order_and_colour(tmp_path):
    path = tmp_path / "deep" / "toy.mp4"
    colours = [(200, 30, 30), (30, 200, 30), (30, 30, 200), (250, 250, 250)]
    with VideoWriter(path, 10) as film:
        for colour in colours:
            film.add(np.full((96, 128, 3), colour, np.uint8))
            assert not path.exists()
    frames, rate = frames_of(path)
    assert rate == pytest.approx(10.0)
    assert [frame.shape for frame in frames] == [(96, 128, 3)] * 4
    for frame, colour in zip(frames, colours, strict=True):
        np.testing.assert_allclose(frame.mean(axis=(0, 1)), colour, atol=12.0)
    assert [entry.name for entry in path.parent.iterdir()] == ["toy.mp4"]


def test_what_was_filmed_before_an_error_is_kept_and_nothing_leaves_nothing(tmp_path):
    def film(path, frames):
        with VideoWriter(path, 10) as writer:
            for _ in range(frames):
                writer.add(np.zeros((64, 64, 3), np.uint8))
            raise KeyError("stop")

    for frames in (3, 0):
        with pytest.raises(KeyError):
            film(tmp_path / f"{frames}.mp4", frames)
    assert [entry.name for entry in tmp_path.iterdir()] == ["3.mp4"]
    assert len(frames_of(tmp_path / "3.mp4")[0]) == 3


@pytest.mark.usefixtures("drivers")
def test_an_episodes_video_has_a_frame_for_the_start_and_one_for_each_step(tmp_path):
    path = tmp_path / "episode.mp4"
    result = drive(job_of(), path)
    frames, rate = frames_of(path)
    assert len(frames) == result.steps + 1
    assert rate == pytest.approx(10.0)
    assert not np.array_equal(frames[0], frames[-1])
    # filming changes nothing about the drive
    assert drive(job_of()) == result


@pytest.mark.usefixtures("drivers")
def test_the_video_of_a_failed_episode_ends_where_it_failed(tmp_path):
    path = tmp_path / "episode.mp4"
    result = drive(job_of("toy_short_drivers:Fails"), path)
    assert result.failure == "RuntimeError: out of ideas"
    assert len(frames_of(path)[0]) == result.steps + 1 == 5


@pytest.mark.usefixtures("drivers")
def test_an_episode_without_its_video_is_driven_again_and_the_others_are_kept(
    tmp_path,
):
    jobs = [job_of(index=index) for index in range(2)]
    out = tmp_path / "out"
    plain = run_jobs(jobs, out, workers=1)
    assert not (out / "videos").exists()
    filmed = run_jobs(jobs, out, workers=1, videos=True)
    assert filmed == plain
    films = [out / "videos" / f"{job.key}.mp4" for job in jobs]
    assert sorted((out / "videos").iterdir()) == sorted(films)
    rows = [out / "episodes" / f"{job.key}.json" for job in jobs]
    before = [path.stat().st_mtime_ns for path in (*rows, films[1])]
    films[0].unlink()
    assert run_jobs(jobs, out, workers=1, videos=True) == plain
    assert films[0].exists()
    after = [path.stat().st_mtime_ns for path in (*rows, films[1])]
    assert after[0] > before[0]
    assert after[1:] == before[1:]


@pytest.mark.usefixtures("drivers")
def test_the_command_films_every_episode_and_overwriting_discards_the_films(tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["run", "--town", "Town02", "--agent", "toy_short_drivers:Swerves"]
    arguments += ["--out", str(out), "--workers", "1", "--video"]
    assert main(arguments) == 0
    films = sorted((out / "videos").iterdir())
    assert len(films) == 5
    assert {film.stem for film in films} == {row.stem for row in (out / "episodes").iterdir()}
    assert all(len(frames_of(film)[0]) > 5 for film in films)
    (out / "videos" / "mine.txt").write_text("kept?", encoding="utf-8")
    without = [argument for argument in arguments if argument != "--video"]
    assert main([*without, "--overwrite"]) == 0
    assert not (out / "videos").exists()


@pytest.mark.usefixtures("drivers")
def test_a_video_that_cannot_be_written_is_not_the_drivers_fault(tmp_path, monkeypatch):
    class Broken:
        fourcc = staticmethod(cv2.VideoWriter.fourcc)

        def __init__(self, *_):
            pass

        def isOpened(self):  # noqa: N802
            return False

        def release(self):
            pass

    monkeypatch.setattr(video_module.cv2, "VideoWriter", Broken)
    with pytest.raises(OSError, match="video"):
        drive(job_of(), tmp_path / "episode.mp4")
