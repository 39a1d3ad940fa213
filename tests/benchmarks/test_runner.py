from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from benchmarks import runner
from benchmarks.runner import (
    NOTHING,
    OtherRunError,
    longest_first,
    read_result,
    run_jobs,
)
from benchmarks.suites import Job

JOBS = [Job("Town02", "episode", index, "ground_truth", "expert", 0, "test") for index in range(3)]


def test_workers_and_one_process_give_the_same_results(tmp_path):
    alone = run_jobs(JOBS, tmp_path / "alone", workers=1)
    together = run_jobs(JOBS, tmp_path / "together", workers=2)
    assert together == alone
    assert [result.job for result in together] == JOBS


def test_finished_episodes_are_kept_and_not_driven_again(tmp_path, monkeypatch):
    first = run_jobs(JOBS[:2], tmp_path, workers=1)
    driven = []
    real = runner.drive
    monkeypatch.setattr(runner, "drive", lambda job, *kept: driven.append(job) or real(job, *kept))
    assert run_jobs(JOBS, tmp_path, workers=1)[:2] == first
    assert driven == JOBS[2:]


def test_an_interrupted_run_keeps_what_it_finished(tmp_path, monkeypatch):
    real = runner.drive

    def interrupt(job: Job, *kept):
        if job.index == 1:
            raise KeyboardInterrupt
        return real(job)

    monkeypatch.setattr(runner, "drive", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_jobs(JOBS, tmp_path, workers=1)
    # the longest first: 2, 1, 0
    assert read_result(tmp_path / "episodes", JOBS[2]) is not None
    assert read_result(tmp_path / "episodes", JOBS[1]) is None
    assert not list((tmp_path / "episodes").glob("*.tmp"))


def test_a_broken_result_file_is_named(tmp_path):
    (tmp_path / f"{JOBS[0].key}.json").write_text('{"job": ', encoding="utf-8")
    with pytest.raises(OtherRunError, match=JOBS[0].key):
        read_result(tmp_path, JOBS[0])


def test_a_result_of_another_job_under_the_same_name_is_refused(tmp_path):
    (result,) = run_jobs(JOBS[:1], tmp_path, workers=1)
    path = tmp_path / "episodes" / f"{JOBS[0].key}.json"
    row = json.loads(path.read_text(encoding="utf-8"))
    row["job"]["agent"] = "another"
    path.write_text(json.dumps(row), encoding="utf-8")
    with pytest.raises(OtherRunError, match="another job"):
        read_result(tmp_path / "episodes", result.job)


def test_jobs_that_differ_have_different_file_names():
    jobs = [
        Job(town, routes, index, bev, agent, seed, "train")
        for town in ("Town01", "Town02")
        for routes in ("val", "test")
        for index in (0, 1, 10)
        for bev in ("a", "b")
        for agent in ("expert", "m.n:f", "m_n:f")
        for seed in (0, 1)
    ]
    assert len({job.key for job in jobs}) == len(jobs)


SLOW_DRIVER = """
import time
from agents import Expert

class Slow(Expert):
    def reset(self, seed):
        time.sleep(0.4)
        super().reset(seed)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("executor", ["processes", "ray"])
def test_a_killed_run_starts_again_where_it_was_and_leaves_no_workers(
    executor, how, tmp_path, monkeypatch
):
    if executor == "ray":
        pytest.importorskip("ray", reason="the executor ray needs the package ray (extra [ray])")
        monkeypatch.delenv("RAY_ADDRESS", raising=False)
    (tmp_path / "toy_slow_driver.py").write_text(SLOW_DRIVER, encoding="utf-8")
    command = [sys.executable, "-m", "benchmarks.cli", "run", "--town", "Town02", "--workers", "2"]
    command += ["--executor", executor, "--agent", "toy_slow_driver:Slow", "--out", "out"]
    episodes = tmp_path / "out" / "episodes"
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120.0
    while len(list(episodes.glob("*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(how)
    # ends only when every process that holds the pipe has ended
    _, stderr = process.communicate(timeout=30)
    kept = {path.name: path.read_text(encoding="utf-8") for path in episodes.glob("*.json")}
    assert 2 <= len(kept) < 5
    if how != signal.SIGKILL:
        assert process.returncode == 143
        assert "resumes" in stderr
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "5/5" in done.stdout
    for name, content in kept.items():
        assert (episodes / name).read_text(encoding="utf-8") == content
    whole = [*command[:-1], "whole"]
    subprocess.run(whole, cwd=tmp_path, capture_output=True, check=True)
    again, at_once = (
        json.loads((tmp_path / name / "results.json").read_text(encoding="utf-8"))
        for name in ("out", "whole")
    )
    assert again["episodes"] == at_once["episodes"]
    assert again["scores"] == at_once["scores"]
    tables = [(tmp_path / n / "table.md").read_text(encoding="utf-8") for n in ("out", "whole")]
    # but for the command and the date
    assert tables[0].partition("Suite ")[0] == tables[1].partition("Suite ")[0]


DEADLY_DRIVER = """
import os
from agents import Expert

class Deadly(Expert):
    def reset(self, seed):
        super().reset(seed)
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        if self.steps == 5:
            os._exit(7)  # as a segmentation fault in a library would
        return super().act(observation)
"""


def test_a_driver_that_brings_its_process_down_fails_its_own_episodes_alone(tmp_path, monkeypatch):
    (tmp_path / "toy_deadly_driver.py").write_text(DEADLY_DRIVER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    agents = ("expert", "toy_deadly_driver:Deadly", "expert")
    routes = zip(agents, (0, 0, 2), strict=True)
    jobs = [Job("Town02", "episode", k, "ground_truth", agent, 0, "test") for agent, k in routes]
    results = run_jobs(jobs, tmp_path / "out", workers=2)
    assert [result.job for result in results] == jobs
    assert [result.success for result in results] == [True, False, True]
    dead = results[1]
    assert "the process that drove it died" in dead.failure
    assert dead.error
    assert (dead.driven_m, dead.planned_m) == (0.0, results[0].planned_m)
    assert read_result(tmp_path / "out" / "episodes", jobs[1]) == dead


CRASHING_PREDICTORS = """
import os, signal, sys
import numpy as np

class Predictor:
    channels = ("road",)

    def reset(self):
        self.frames = 0

    def __call__(self, frame):
        self.frames += 1
        if self.frames == 4:
            self.crash()
        return np.zeros((1, 192, 192), np.uint8)

class Raises(Predictor):
    def crash(self):
        raise ZeroDivisionError("no road")

class Exits(Predictor):
    def crash(self):
        sys.exit("enough")

class Dies(Predictor):
    def crash(self):
        os._exit(0)

class Segfaults(Predictor):
    def crash(self):
        os.kill(os.getpid(), signal.SIGSEGV)
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_predictor_that_crashes_fails_its_episodes_and_no_other(workers, tmp_path, monkeypatch):
    (tmp_path / "toy_crashes.py").write_text(CRASHING_PREDICTORS, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    crashes = {
        "Raises": "ZeroDivisionError: no road",
        "Exits": "SystemExit: enough",
        "Dies": "the process that drove it died",
        "Segfaults": "the process that drove it died",
    }
    bevs = ["ground_truth", *(f"toy_crashes:{name}" for name in crashes)]
    jobs = [Job("Town02", "episode", 0, bev, "expert", 0, "test") for bev in bevs]
    found = run_jobs(jobs, tmp_path / "all", workers)
    assert [result.job for result in found] == jobs
    for result, failure in zip(found[1:], crashes.values(), strict=True):
        assert failure in result.failure
        assert result.error
        assert not result.success
        assert result.planned_m == found[0].planned_m
    assert found[:1] == run_jobs(jobs[:1], tmp_path / "alone", 1)
    # they have failed once and for all
    assert run_jobs(jobs, tmp_path / "all", workers) == found


def test_a_result_that_was_written_elsewhere_is_not_counted(tmp_path):
    def on_another_machine(function, calls, workers, *, apart=False):
        for number, (job, _, wanted) in enumerate(calls):
            yield number, function(job, tmp_path / "elsewhere", wanted)

    with pytest.raises(OtherRunError, match="all machines of the cluster share"):
        run_jobs(JOBS[:1], tmp_path, 2, execute=on_another_machine)


def test_the_longest_routes_come_first_source_by_source():
    bevs = ("ipm", "ground_truth")
    jobs = [replace(job, bev=bev) for bev in bevs for job in JOBS]
    order = [(job.bev, job.index) for job, _ in longest_first([(job, NOTHING) for job in jobs])]
    # 108, 118 and 140 m
    assert order == [(bev, index) for bev in bevs for index in (2, 1, 0)]
