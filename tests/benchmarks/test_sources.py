from __future__ import annotations

import hashlib
import json
import sys

import pytest

from benchmarks.cli import main
from benchmarks.drive import drive
from benchmarks.suites import Job

SOURCES = """
import numpy as np
from bev_driving_env import CorruptedBEV

class Blank:
    channels = ("road", "route", "lane")
    def reset(self): pass
    def __call__(self, frame): return np.zeros((3, 192, 192), np.float32)

class Tires(Blank):
    def reset(self): self.frames = 0
    def __call__(self, frame):
        self.frames += 1
        if self.frames > 4: raise LookupError("eyes closed")
        return super().__call__(frame)

class Narrow(Blank):
    def __call__(self, frame): return np.zeros((3, 96, 96), np.float32)

def faulty():
    return CorruptedBEV("ground_truth", latency=0.5)

def unmade():
    raise RuntimeError("no weights here")

not_a_factory = 3
"""
SWERVES = """
import numpy as np

class Swerves:
    def __init__(self, env): pass
    def reset(self, seed): pass
    def act(self, observation): return np.array([1.0, 0.4], np.float32)

class Looks(Swerves):
    def reset(self, seed): self.seen = []
    def act(self, observation):
        self.seen.append(observation["bev"])
        assert not observation["bev"][3:].any()
        return super().act(observation)
"""


@pytest.fixture
def toys(tmp_path, monkeypatch):
    (tmp_path / "toy_sources.py").write_text(SOURCES, encoding="utf-8")
    (tmp_path / "toy_swerving.py").write_text(SWERVES, encoding="utf-8")
    for name in ("toy_sources", "toy_swerving"):
        # one of another test would be found instead of this one's file
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def arguments(out, *sources, agent="toy_swerving:Swerves"):
    command = ["run", "--town", "Town02", "--agent", agent, "--workers", "1"]
    return [*command, "--out", str(out), "--bev", *sources]


def content_of(out, name="results.json"):
    return json.loads((out / name).read_text(encoding="utf-8"))


def test_predictors_of_a_module_drive_beside_the_ground_truth(toys, capsys):
    out = toys / "out"
    sources = ("ground_truth", "toy_sources:Blank", "toy_sources:faulty")
    assert main(arguments(out, *sources)) == 0
    printed = capsys.readouterr().out
    rows = content_of(out)["episodes"]
    assert [row["bev"] for row in rows] == [source for source in sources for _ in range(5)]
    assert all(source in printed for source in sources)
    # this driver looks at nothing, so what it is shown changes nothing
    drives = [[row["driven_m"] for row in rows if row["bev"] == source] for source in sources]
    assert drives[0] == drives[1] == drives[2]


def test_the_hash_of_the_modules_file_is_kept_and_a_changed_file_is_another_run(toys, capsys):
    out = toys / "out"
    command = arguments(out, "toy_sources:Blank", "ground_truth")
    assert main(command) == 0
    digest = hashlib.sha256((toys / "toy_sources.py").read_bytes()).hexdigest()
    kept = content_of(out, "run.json")
    for hashes in (kept["identity"]["hashes"], kept["provenance"]["hashes"]):
        assert hashes["toy_sources:Blank"] == digest
        assert "ground_truth" not in hashes
    assert main(command) == 0
    with (toys / "toy_sources.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    capsys.readouterr()
    assert main(command) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "hashes" in line


def test_a_predictor_that_fails_is_in_its_rows_and_the_exit_is_1(toys, capsys):
    out = toys / "out"
    assert main(arguments(out, "toy_sources:Tires", "ground_truth")) == 1
    printed = capsys.readouterr()
    assert "toy_sources:Tires" in printed.err
    assert "eyes closed" in printed.err
    rows = content_of(out)["episodes"]
    failed = [row for row in rows if row["bev"] == "toy_sources:Tires"]
    assert len(failed) == 5
    for row in failed:
        assert row["failure"].startswith("BEVSourceError")
        assert "LookupError: eyes closed" in row["failure"]
        # the whole chain, down to the line that raised
        assert 'raise LookupError("eyes closed")' in row["error"]
        assert not row["success"]
        # the fifth view is that of the fourth step
        assert row["steps"] == 4
    assert not any(row["failure"] for row in rows if row["bev"] == "ground_truth")
    assert "0/5" in printed.out


def test_a_predictor_that_fails_at_the_first_look_fails_its_episode_at_the_start(toys):
    job = Job("Town02", "episode", 0, "toy_sources:Narrow", "expert", 0, "test")
    result = drive(job)
    assert result.steps == 0
    assert result.driven_m == 0.0
    assert len(result.trajectory) == 1
    assert all(word in result.failure for word in ("Narrow", "(3, 96, 96)", "(3, 192, 192)"))


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("xray", ["xray", "ground_truth"]),
        ("ground_thruth", ["did you mean 'ground_truth'"]),
        ("no_such_module:make", ["no_such_module"]),
        ("toy_sources:nothing", ["toy_sources:nothing"]),
        ("toy_sources:unmade", ["toy_sources:unmade", "no weights here"]),
        ("toy_sources:not_a_factory", ["toy_sources:not_a_factory", "3"]),
        ("missing.pt2", ["missing.pt2", "no such file"]),
    ],
)
def test_a_source_that_cannot_be_had_is_one_line_before_anything_is_written(
    toys, source, names, capsys
):
    out = toys / "out"
    assert main(arguments(out, "ground_truth", source)) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert all(name in line for name in names), line
    assert not out.exists()


def test_the_driver_is_shown_what_the_predictor_says_and_nothing_else(toys):
    job = Job("Town02", "episode", 0, "toy_sources:Blank", "toy_swerving:Looks", 0, "test")
    assert drive(job).failure == ""
    truth = Job("Town02", "episode", 0, "ground_truth", "expert", 0, "test")
    assert drive(truth).clean
