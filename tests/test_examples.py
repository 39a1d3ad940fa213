"""The examples run as the documentation says."""

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torch")

ROOT = Path(__file__).resolve().parents[1]
SOURCE = "examples.my_predictor:make"


@pytest.fixture(scope="module")
def predictor():
    from examples.my_predictor import MyPredictor

    return MyPredictor()


def test_the_example_runs_as_a_script():
    done = subprocess.run(
        [sys.executable, "examples/my_predictor.py"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "IoU of the road channel" in done.stdout
    metres, overlap = float(done.stdout.split()[0]), float(done.stdout.split()[-1])
    assert metres > 1.0
    assert 0.0 <= overlap <= 1.0


def test_the_example_predicts_probabilities_of_its_channels(predictor):
    env = gym.make("bev_driving_env:BEVTown02-v0", bev_source=predictor).unwrapped
    observation, _ = env.reset(seed=0)
    predictor.reset()
    planes = predictor(env.sensor_frame())
    assert planes.shape == (3, 192, 192)
    assert planes.dtype == np.float32
    np.testing.assert_array_equal(observation["bev"][:3], np.rint(planes * 255.0))
    assert not observation["bev"][3:].any()


def test_the_example_is_found_by_the_name_its_documentation_gives():
    env = gym.make("bev_driving_env:BEVTown02-v0", bev_source=SOURCE)
    first, _ = env.reset(seed=1)
    again, _ = gym.make("bev_driving_env:BEVTown02-v0", bev_source=SOURCE).reset(seed=1)
    np.testing.assert_array_equal(first["bev"], again["bev"])
    text = (ROOT / "examples" / "my_predictor.py").read_text(encoding="utf-8")
    assert f"bev-bench run --bev {SOURCE}" in text


def test_ppo_in_one_file_learns_something_from_every_batch():
    arguments = ["--steps", "256", "--worlds", "2", "--horizon", "64", "--epochs", "1"]
    done = subprocess.run(
        [sys.executable, "examples/ppo.py", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["128", "256"]
    action = [float(word.strip("[],")) for word in lines[-1].split()[-2:]]
    assert all(-1.0 <= value <= 1.0 for value in action)
