"""``make_agent`` and the ``Agent`` protocol."""

import subprocess
import sys
import types
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env  # noqa: F401  # registers the ids
from agents import Agent, Expert, make_agent, registry
from agents.registry import agent_source


class Coasting:
    """The least that an agent can be."""

    def __init__(self, env):
        self.env = env

    def reset(self, seed):
        pass

    def act(self, observation):
        return np.zeros(2, np.float32)


class Mute:
    def reset(self, seed):
        pass


@pytest.fixture(scope="module")
def env():
    return gym.make("BEVTown01-v0")


@pytest.fixture
def drivers(monkeypatch):
    """A module ``my_drivers`` as a user would write one."""
    module = types.ModuleType("my_drivers")
    module.coasting = Coasting
    module.mute = lambda env: Mute()
    module.number = 3
    monkeypatch.setitem(sys.modules, "my_drivers", module)


def test_expert_is_made_by_name(env):
    agent = make_agent("expert", env)
    assert type(agent) is Expert
    assert agent.env is env.unwrapped


def test_a_factory_is_found_by_module_and_name_and_given_the_environment(env, drivers):
    agent = make_agent("my_drivers:coasting", env)
    assert type(agent) is Coasting
    assert agent.env is env


def test_a_made_agent_drives(env, drivers):
    for spec in ("expert", "my_drivers:coasting"):
        agent = make_agent(spec, env)
        observation, _ = env.reset(seed=0)
        agent.reset(0)
        assert agent.act(observation) in env.action_space


@pytest.mark.parametrize("thing", [Coasting(None), Expert])
def test_anything_with_reset_and_act_is_an_agent(thing, env):
    agent = thing(env) if isinstance(thing, type) else thing
    assert isinstance(agent, Agent)


@pytest.mark.parametrize("thing", [Mute(), object(), None, lambda observation: None])
def test_anything_else_is_not(thing):
    assert not isinstance(thing, Agent)


@pytest.mark.parametrize(
    "spec", ["exprt", "", ":", "my_drivers:", ":coasting", "sb3:", "onnx:", ":sample", "runs/bc"]
)
def test_a_spec_of_no_known_form_is_refused_with_the_forms(spec, env, drivers):
    with pytest.raises(
        ValueError, match=r"'expert', 'bc', 'bc_town', .* or 'module:factory'"
    ) as error:
        make_agent(spec, env)
    assert repr(spec) in str(error.value)


@pytest.mark.parametrize(
    ("spec", "named"),
    [
        ("no_such_module_xyz:make", "no_such_module_xyz"),
        ("my_drivers:sailing", "sailing"),
        ("./my_drivers.py:coasting", "my_drivers"),
        ("my_drivers:number", "my_drivers:number"),
        ("my_drivers:mute", r"reset\(seed\) and act\(observation\), got Mute"),
    ],
)
def test_a_spec_that_leads_to_no_agent_is_refused_with_the_reason(spec, named, env, drivers):
    with pytest.raises(ValueError, match=named) as error:
        make_agent(spec, env)
    assert repr(spec) in str(error.value)


def test_an_error_inside_a_factory_is_named_with_its_agent(env, drivers):
    def broken(env):
        raise ZeroDivisionError("in the factory")

    sys.modules["my_drivers"].broken = broken
    with pytest.raises(ValueError, match=r"'my_drivers:broken'.*ZeroDivisionError: in the factory"):
        make_agent("my_drivers:broken", env)


@pytest.mark.parametrize("spec", ["bc", "bc:sample"])
def test_without_its_weights_the_cloned_policy_says_how_to_train_it(
    spec, env, tmp_path, monkeypatch
):
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "registry.py"))
    with pytest.raises(ValueError, match=r"bc\.safetensors; train it with 'bev-agents collect"):
        make_agent(spec, env)


@pytest.mark.parametrize("answer", ["", ":mode", ":mean", ":sample"])
def test_the_cloned_policy_drives_from_its_weights_and_from_a_path(
    answer, env, tmp_path, monkeypatch
):
    from agents import BetaPolicy, save_weights

    path = tmp_path / "weights" / "bc.safetensors"
    policy = BetaPolicy(env.observation_space, env.action_space, lambda _: 0.0)
    save_weights(policy, path, {})
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "registry.py"))
    observation, _ = env.reset(seed=0)
    actions = []
    for name in ("bc", str(path)):
        agent = make_agent(name + answer, env)
        assert agent.answer == (answer[1:] or "mode")
        agent.reset(3)
        actions.append(agent.act(observation))
        assert agent_source(name + answer) == path
    np.testing.assert_array_equal(*actions)
    assert actions[0] in env.action_space


def test_an_agents_file_is_known_by_its_name(drivers):
    sys.modules["my_drivers"].__file__ = "somewhere/my_drivers.py"
    sources = {
        "expert": None,
        "sb3:runs/ppo.zip": Path("runs/ppo.zip"),
        "onnx:runs/net": Path("runs/net"),
        "runs/net.onnx": Path("runs/net.onnx"),
        "runs/c:d/x.safetensors:mean": Path("runs/c:d/x.safetensors"),
        "my_drivers:coasting": Path("somewhere/my_drivers.py"),
        "not_loaded_yet:make": None,
    }
    assert {spec: agent_source(spec) for spec in sources} == sources


def test_importing_agents_loads_neither_torch_nor_stable_baselines3():
    code = """
import sys, agents
names = "torch", "stable_baselines3", "safetensors", "onnxruntime"
print("done", *[name for name in names if name in sys.modules])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.split() == ["done"]


def test_every_public_name_is_there_and_listed():
    import agents

    for name in agents.__all__:
        assert getattr(agents, name) is not None
        assert name in dir(agents)
    with pytest.raises(AttributeError, match="'agents' has no attribute 'Driver'"):
        agents.Driver  # noqa: B018
