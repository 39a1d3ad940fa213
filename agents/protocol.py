"""What a driver is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray


@runtime_checkable
class Agent(Protocol):
    """A driver: anything with ``reset`` and ``act``."""

    def reset(self, seed: int | None) -> None:
        """Get ready for a new episode; all randomness must come from the seed."""

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        """Choose an action (2,) in [-1, 1]: acceleration (negative brakes), steering (right)."""
