"""Wrappers for agents that cannot take a dict of observations."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray


class BEVOnly(gym.ObservationWrapper[NDArray[np.uint8], Any, Any]):
    """Keeps only the BEV: one ``Box(0, 255, (6, 192, 192), uint8)``, channel first.

    Args:
        env: An environment with a ``bev`` in its dict of observations.

    Raises:
        ValueError: The environment has no such observation.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        space = env.observation_space
        if not isinstance(space, gym.spaces.Dict) or "bev" not in space.spaces:
            raise ValueError(f"BEVOnly needs a dict observation with 'bev', got {space}")
        self.observation_space = space["bev"]

    def observation(self, observation: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
        """The BEV of a dict observation."""
        return observation["bev"]
