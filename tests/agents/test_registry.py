"""``make_agent`` and the ``Agent`` protocol."""

import sys
import types

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env  # noqa: F401  # registers the ids
from agents import Agent, Expert, make_agent


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


@pytest.mark.parametrize("spec", ["exprt", "", ":", "my_drivers:", ":coasting"])
def test_a_spec_of_no_known_form_is_refused_with_the_forms(spec, env, drivers):
    with pytest.raises(ValueError, match=r"'expert' or 'module:factory'") as error:
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
