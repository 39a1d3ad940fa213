from __future__ import annotations

import signal
import sys

import pytest

from benchmarks.cli import main
from benchmarks.ray_pool import check_ray, ray_cluster
from benchmarks.runner import run_jobs
from benchmarks.suites import Job

DEADLY_DRIVER = """
import os
from agents import Expert

class Deadly(Expert):
    def act(self, observation):
        os._exit(7)
"""


@pytest.mark.slow
def test_a_ray_cluster_gives_the_results_of_this_machine_and_a_dead_process_fails(
    tmp_path, monkeypatch
):
    pytest.importorskip("ray", reason="the executor ray needs the package ray (extra [ray])")
    (tmp_path / "toy_ray_driver.py").write_text(DEADLY_DRIVER, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    drives = [("ipm", "bc", 0), ("ground_truth", "expert", 2)]
    drives.insert(1, ("ground_truth", "toy_ray_driver:Deadly", 0))
    jobs = [Job("Town02", "episode", k, bev, agent, 0, "test") for bev, agent, k in drives]
    before = signal.getsignal(signal.SIGTERM)
    with ray_cluster(None, 2) as execute:
        assert signal.getsignal(signal.SIGTERM) is before
        found = run_jobs(jobs, tmp_path / "ray", 2, moments=True, execute=execute)
    assert [result.job for result in found] == jobs
    assert "the process that drove it died" in found[1].failure
    assert found == run_jobs(jobs, tmp_path / "here", 2, moments=True)
    assert len(list((tmp_path / "ray" / "moments").glob("*.npz"))) == 1


def test_an_address_without_a_cluster_is_a_mistake_and_nothing_is_written(tmp_path, capsys):
    pytest.importorskip("ray", reason="the executor ray needs the package ray (extra [ray])")
    arguments = ["run", "--town", "Town02", "--executor", "ray", "--ray-address", "127.0.0.1:1"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert "no Ray cluster at '127.0.0.1:1'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_without_the_package_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install 'bev-driving-env\[ray\]'"):
        check_ray()
