"""Agents by the names that the command line uses."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym

from .expert import Expert
from .protocol import Agent

SHIPPED = ("bc", "bc_town")
"""Policies that come with BEVTown."""

FORMS = (
    "'expert', 'bc', 'bc_town', a PATH.safetensors of bev-agents, 'sb3:PATH.zip' (a pickle: only "
    "one that you trust), 'onnx:PATH', a PATH.onnx, or 'module:factory' (a callable that takes "
    "the environment)"
)

Factory = Callable[[gym.Env[Any, Any]], Any]


def make_agent(spec: str, env: gym.Env[Any, Any]) -> Agent:
    """Make an agent from its command-line name.

    Args:
        spec: One of

            * ``"expert"``, the privileged one;
            * ``"bc"`` or ``"bc_town"``, the behaviour-cloned policies that come with BEVTown, the
              latter for traffic and signals, or the path of a ``.safetensors`` file with another.
              Each may end in ``:mode``, ``:mean`` or ``:sample``, the action that it takes of its
              distribution;
            * ``"sb3:PATH.zip"``, saved by Stable-Baselines3, any algorithm. Such a file is a
              pickle and can run code: only load one that you trust;
            * ``"onnx:PATH"``, or a path that ends in ``.onnx``;
            * ``"module:factory"``, where ``factory(env)`` returns an ``Agent``.
        env: The environment it will drive.

    Returns:
        The agent.

    Raises:
        ValueError: The name has none of these forms, or does not lead to an ``Agent``.
    """
    if spec == "expert":
        return Expert(env)
    kind, rest, answer = _parsed(spec)
    factory = _load_factory(spec) if kind == "module" else _builtin_factory(kind, rest, answer)
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
    """The file that an agent comes from, a module's once it is loaded; None for the expert.

    Raises:
        ValueError: The name has no known form.
    """
    if spec == "expert":
        return None
    kind, rest, _ = _parsed(spec)
    if kind == "bc":
        return _shipped_path(rest)
    if kind != "module":
        return Path(rest)
    module = sys.modules.get(rest)
    source = getattr(module, "__file__", None)
    return None if source is None else Path(source)


def _parsed(spec: str) -> tuple[str, str, str | None]:
    """Kind of an agent, its path or module or name, and its answer if one is asked for.

    >>> _parsed("runs/bc/best.safetensors:sample")
    ('weights', 'runs/bc/best.safetensors', 'sample')
    >>> _parsed("my_driver:sample")
    ('module', 'my_driver', None)
    """
    for prefix in ("sb3", "onnx"):
        if spec.startswith(f"{prefix}:") and len(spec) > len(prefix) + 1:
            return prefix, spec[len(prefix) + 1 :], None
    if spec.endswith(".onnx"):
        return "onnx", spec, None
    # from the right: a path may hold colons of its own
    head, _, tail = spec.rpartition(":")
    name, answer = (head, tail) if tail in ("mode", "mean", "sample") else (spec, None)
    if name in SHIPPED:
        return "bc", name, answer
    if name.endswith(".safetensors"):
        return "weights", name, answer
    module_name, colon, factory_name = spec.partition(":")
    if not (colon and module_name and factory_name):
        raise ValueError(f"unknown agent {spec!r}; an agent is {FORMS}")
    return "module", module_name, None


def _builtin_factory(kind: str, rest: str, answer: str | None) -> Factory:
    """What makes an agent of a file; torch and Stable-Baselines3 are imported when it is called."""

    def make(env: gym.Env[Any, Any]) -> Any:
        path = Path(rest)
        if kind == "bc":
            path = _shipped_path(rest)
            if not path.is_file():
                raise FileNotFoundError(_how_to_train(rest, path))
        if kind == "sb3":
            from .sb3_agent import load_sb3_agent

            return load_sb3_agent(path, env)
        if kind == "onnx":
            from .onnx_agent import load_onnx_agent

            return load_onnx_agent(path, env)
        from .beta_agent import load_beta_agent

        return load_beta_agent(path, env, answer)

    return make


def _load_factory(spec: str) -> Factory:
    """The callable that ``"module:factory"`` names."""
    module_name, _, factory_name = spec.partition(":")
    try:
        factory = getattr(importlib.import_module(module_name), factory_name)
    except Exception as error:  # a foreign module may raise anything while it is imported
        raise ValueError(f"agent {spec!r} cannot be loaded: {_one_line(error)}") from error
    if not callable(factory):
        raise ValueError(f"agent {spec!r} is not callable, got {factory!r}; an agent is {FORMS}")
    return factory


def _shipped_path(name: str) -> Path:
    """Where the weights of a policy that comes with BEVTown lie."""
    return Path(__file__).parent / "weights" / f"{name}.safetensors"


def _how_to_train(name: str, path: Path) -> str:
    """What to do about a policy that should come with BEVTown and does not."""
    return (
        f"there is no {path}; train it with 'bev-agents collect --town Town01 --out data/town01' "
        f"and 'bev-agents train --data data/town01 --out runs/{name}', then name the .safetensors "
        "file in that folder as the agent"
    )


def _one_line(error: Exception) -> str:
    """Type and first line of an error."""
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
