"""Agents by the names that the command line uses."""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium as gym

from .expert import Expert
from .protocol import Agent

FORMS = "'expert' or 'module:factory' (a callable that takes the environment)"


def make_agent(spec: str, env: gym.Env[Any, Any]) -> Agent:
    """Make an agent from its command-line name.

    Args:
        spec: ``"expert"``, or ``"module:factory"`` where ``factory(env)`` returns an ``Agent``.
        env: The environment it will drive.

    Returns:
        The agent.

    Raises:
        ValueError: The name has neither form, or does not lead to an ``Agent``.
    """
    if spec == "expert":
        return Expert(env)
    module_name, colon, factory_name = spec.partition(":")
    if not (colon and module_name and factory_name):
        raise ValueError(f"unknown agent {spec!r}; an agent is {FORMS}")
    try:
        factory = getattr(importlib.import_module(module_name), factory_name)
    except (ImportError, AttributeError, TypeError) as error:
        raise ValueError(f"agent {spec!r} cannot be loaded: {error}") from error
    if not callable(factory):
        raise ValueError(f"agent {spec!r} is not callable, got {factory!r}; an agent is {FORMS}")
    agent = factory(env)
    if not isinstance(agent, Agent):
        raise ValueError(
            f"agent {spec!r} must have reset(seed) and act(observation), got {type(agent).__name__}"
        )
    return agent
