"""Drivers that others trained, through ``bev-bench run``: Stable-Baselines3, TorchRL, any class."""

import json
import re
from pathlib import Path

import gymnasium as gym
import pytest
import torch
from stable_baselines3 import PPO

import bev_driving_env  # noqa: F401  # registers the ids
from benchmarks.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "drivers.md"

DRIVERS = """
import numpy as np

class Random:
    def __init__(self, env): self.rng = np.random.default_rng()
    def reset(self, seed): self.rng = np.random.default_rng(seed)
    def act(self, observation): return self.rng.uniform([0.0, -1.0], 1.0)

class Raises(Random):
    def act(self, observation): raise KeyError("route")

class NotANumber(Random):
    def act(self, observation): return [float("nan"), 0.0]

class Three(Random):
    def act(self, observation): return np.zeros(3)

class Unready(Random):
    def reset(self, seed): raise RuntimeError("no map")
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of a user with drivers of all kinds."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    torchrl = next(block for block in blocks if block.startswith("# my_torchrl.py"))
    (tmp_path / "my_torchrl.py").write_text(torchrl, encoding="utf-8")
    (tmp_path / "odd_drivers.py").write_text(DRIVERS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def run(folder, *agents):
    """Status and rows of the paper's suite in Town01."""
    arguments = ["--agent", *agents, "--town", "Town01", "--workers", "1"]
    status = main(["run", "--suite", "paper", *arguments, "--out", str(folder / "out")])
    results = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    assert len(results["episodes"]) == 5 * len(agents)
    return status, results["episodes"]


@pytest.mark.slow
def test_policies_of_stable_baselines3_and_torchrl_and_a_random_one_drive_the_paper(folder):
    pytest.importorskip("torchrl")
    torch.manual_seed(0)
    env = gym.make("BEVTown01-v0")
    model = PPO("MultiInputPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu")
    model.learn(8)
    model.save(folder / "ppo")
    status, rows = run(folder, "sb3:ppo.zip", "my_torchrl:make", "odd_drivers:Random")
    assert status == 0
    assert not any(row["error"] or row["failure"] for row in rows)
    assert all(row["steps"] > 5 for row in rows)
    assert sum(row["driven_m"] for row in rows if row["agent"] == "odd_drivers:Random") > 5.0


def test_what_drivers_do_wrong_fails_their_own_episodes_with_the_traceback(folder, capsys):
    wrongs = {
        "Raises": "KeyError: 'route'",
        "NotANumber": "ValueError: action must be finite numbers",
        "Three": r"ValueError: action must have shape \(2,\)",
        "Unready": "RuntimeError: no map",
    }
    status, rows = run(folder, *(f"odd_drivers:{name}" for name in wrongs), "odd_drivers:Random")
    assert status == 1
    for row in rows:
        name = row["agent"].partition(":")[2]
        if name == "Random":
            assert not row["error"]
            continue
        assert re.match(wrongs[name], row["failure"])
        assert row["error"].startswith("Traceback")
        assert not row["success"]
    assert "20 episodes failed; tracebacks are in results.json" in capsys.readouterr().err
