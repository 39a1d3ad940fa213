"""Agents by the names that the command line uses."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
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
    except Exception as error:  # a foreign module may raise anything while it is imported
        raise ValueError(f"agent {spec!r} cannot be loaded: {_one_line(error)}") from error
    if not callable(factory):
        raise ValueError(f"agent {spec!r} is not callable, got {factory!r}; an agent is {FORMS}")
    try:
        agent = factory(env)
    except Exception as error:
        raise ValueError(f"agent {spec!r} cannot be made: {_one_line(error)}") from error
    if not isinstance(agent, Agent):
        raise ValueError(
            f"agent {spec!r} must have reset(seed) and act(observation), got {type(agent).__name__}"
        )
    return agent


def agent_source(spec: str) -> Path | None:
    """The file that an agent named ``"module:factory"`` comes from; None for built-in ones."""
    module_name, colon, _ = spec.partition(":")
    module = sys.modules.get(module_name) if colon else None
    source = getattr(module, "__file__", None)
    return None if source is None else Path(source)


def _one_line(error: Exception) -> str:
    """Type and first line of an error."""
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
