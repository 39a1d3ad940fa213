"""Drivers: the ``Agent`` protocol, the privileged expert, the Beta policy, agents by name.

What needs torch and Stable-Baselines3 is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .expert import Expert
from .protocol import Agent
from .registry import make_agent

if TYPE_CHECKING:
    from .beta import beta_nll
    from .checkpoint import load_weights, save_weights
    from .policy import BetaPolicy
    from .sb3_vec_env import SB3VecEnv

__all__ = [
    "Agent",
    "BetaPolicy",
    "Expert",
    "SB3VecEnv",
    "beta_nll",
    "load_weights",
    "make_agent",
    "save_weights",
]

_HOMES = {
    "BetaPolicy": "policy",
    "SB3VecEnv": "sb3_vec_env",
    "beta_nll": "beta",
    "load_weights": "checkpoint",
    "save_weights": "checkpoint",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
