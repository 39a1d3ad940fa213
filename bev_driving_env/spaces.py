"""Action and observation spaces, and the check of incoming actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .frames import CHANNELS, BEVGeometry


def action_space() -> gym.spaces.Box:
    """Acceleration (negative brakes) and steering (positive turns right), each in [-1, 1]."""
    return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


def observation_space(
    bev: BEVGeometry,
    max_speed_mps: float,
    min_speed_mps: float = 0.0,
    images: tuple[int, ...] | None = None,
) -> gym.spaces.Dict:
    """``bev`` (6, size, size) uint8 in 0..255 and ``measurements`` (3,) float32.

    With the shape of camera images (C, H, W, 3), also ``cameras`` uint8 and ``route_map``
    (size, size) uint8. The speeds are bounds that are never exceeded.
    """
    sensed = {}
    if images is not None:
        sensed["cameras"] = gym.spaces.Box(0, 255, images, np.uint8)
        sensed["route_map"] = gym.spaces.Box(0, 255, (bev.size, bev.size), np.uint8)
    return gym.spaces.Dict(
        {
            **sensed,
            "bev": gym.spaces.Box(0, 255, (len(CHANNELS), bev.size, bev.size), np.uint8),
            "measurements": gym.spaces.Box(
                np.array([min_speed_mps, -1.0, -1.0], np.float32),
                np.array([max_speed_mps, 1.0, 1.0], np.float32),
                dtype=np.float32,
            ),
        }
    )


def checked_actions(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Bring actions to [-1, 1], clipping what lies beyond, in the precision of the action space.

    Args:
        actions: Array-like of the expected shape.
        shape: ``(2,)`` or ``(num_envs, 2)``.

    Returns:
        float64 array of that shape.

    Raises:
        ValueError: Wrong shape, not numbers, or not finite; the message shows what came.
    """
    try:
        # through float32, so that a list and an array of the space drive alike to the last bit
        array = np.array(actions, dtype=np.float32).astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"action must be numbers of shape {shape} in [-1, 1], got {actions!r}"
        ) from error
    if array.shape != shape:
        raise ValueError(
            f"action must have shape {shape} (acceleration, steering), got shape {array.shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"action must be finite numbers in [-1, 1], got {array.tolist()}")
    return np.clip(array, -1.0, 1.0, out=array)
