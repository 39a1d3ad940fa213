"""What importing the package does, and what it leaves alone."""

import importlib
import os
import subprocess
import sys

import gymnasium as gym
import pytest

import bev_driving_env

HEAVY = ("torch", "stable_baselines3", "pygame", "matplotlib", "highway_env", "numba", "cv2")


def run_python(code):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_the_import_registers_each_town_for_single_and_vector_environments(town):
    spec = gym.spec(f"BEV{town}-v0")
    assert spec.entry_point == "bev_driving_env.env:BEVTownEnv"
    assert spec.vector_entry_point == "bev_driving_env.vector_env:BEVTownVectorEnv"
    assert spec.kwargs == {"town": town}


def test_importing_twice_is_harmless():
    before = dict(gym.registry)
    importlib.reload(bev_driving_env)
    assert gym.registry == before


def test_the_module_prefix_replaces_the_import_in_a_fresh_process():
    code = """
import gymnasium
env = gymnasium.make("bev_driving_env:BEVTown01-v0")
observation, info = env.reset(seed=0)
print(observation["bev"].shape[0], info["episode_id"])
"""
    assert run_python(code) == ["6", "Town01/random"]


def test_importing_the_package_loads_nothing_heavy():
    code = f"""
import sys, bev_driving_env
print(*[name for name in {HEAVY} if name in sys.modules])
print("done", *bev_driving_env.__all__)
"""
    first, *names = run_python(code)
    assert first == "done"
    assert "BEVTownEnv" in names


def test_what_a_predictor_needs_is_at_the_top_and_loads_no_environment():
    code = """
import sys
from bev_driving_env import BEVSource, BEVSourceError, SensorFrame
from bev_driving_env import make_bev_source, register_bev_source

class Mine:
    channels = ("road",)
    def reset(self): pass
    def __call__(self, frame): return None

register_bev_source("mine", Mine)
assert type(make_bev_source("mine")) is Mine
assert isinstance(Mine(), BEVSource)
assert issubclass(BEVSourceError, RuntimeError)
heavy = "torch", "highway_env", "numba", "cv2", "scipy", "bev_driving_env.env"
print("done", *[name for name in heavy if name in sys.modules])
"""
    assert run_python(code) == ["done"]


def test_the_contracts_names_for_predictors_are_exported():
    assert {
        "BEVSource",
        "BEVSourceError",
        "CorruptedBEV",
        "SensorFrame",
        "make_bev_source",
        "register_bev_source",
    } <= set(bev_driving_env.__all__)


@pytest.mark.parametrize("name", sorted(bev_driving_env.__all__))
def test_every_public_name_is_there_and_listed(name):
    assert getattr(bev_driving_env, name) is not None
    assert name in dir(bev_driving_env)


def test_a_name_that_does_not_exist_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'BEVCity'"):
        bev_driving_env.BEVCity  # noqa: B018
