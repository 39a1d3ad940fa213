"""Drivers: the ``Agent`` protocol, the privileged expert, and agents by name."""

from .expert import Expert
from .protocol import Agent
from .registry import make_agent

__all__ = ["Agent", "Expert", "make_agent"]
