"""Observations in the form that third-party policies were trained on.

A policy says what it wants as a Gymnasium space; :func:`observation_adapter` finds the function
that makes it of BEVTown's dict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

Observation = Mapping[str, NDArray[Any]]
Adapter = Callable[[Observation], Any]

_POLICY_KEYS = ("bev", "measurements")


def observation_adapter(wanted: gym.Space[Any], given: gym.Space[Any]) -> Adapter:
    """Find how to turn observations of one space into another.

    Args:
        wanted: What the policy was trained on: a ``Dict`` of some of the keys, or a ``Box``
            that is the BEV alone, one flat vector of everything (``FlattenObservation``), of the
            BEV, or the measurements. A float BEV with bounds 0 and 1 is divided by 255.
        given: The environment's observation space: the ``Dict``, or a ``Box`` where a wrapper
            has made one of it.

    Returns:
        A function of an observation.

    Raises:
        ValueError: No such way is known; the message shows both spaces, or the bounds.
    """
    if isinstance(wanted, gym.spaces.Dict) and isinstance(given, gym.spaces.Dict):
        picked = _picked(wanted, given)
        if picked is not None:
            return picked
    elif isinstance(wanted, gym.spaces.Box):
        made = _boxed(wanted, given)
        if made is not None:
            return made
    raise ValueError(
        f"the policy was trained on {describe(wanted)} and the environment gives "
        f"{describe(given)}; known are a Dict of its keys, its bev alone, and flat vectors of "
        "all, of the bev or of the measurements"
    )


def describe(space: gym.Space[Any]) -> str:
    """Kind, shapes and types of a space in a few words, without its bounds."""
    if isinstance(space, gym.spaces.Dict):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in space.spaces.items()) + "}"
    return f"{type(space).__name__}{space.shape} {space.dtype}"


def _picked(wanted: gym.spaces.Dict, given: gym.spaces.Dict) -> Adapter | None:
    """Some keys of a dict, each as the policy wants it."""
    adapters: dict[str, Adapter] = {}
    for key, space in wanted.spaces.items():
        if not isinstance(space, gym.spaces.Box) or key not in given.spaces:
            return None
        if space.shape != given[key].shape:
            return None
        adapters[key] = _cast(space, given[key], key)
    return lambda observation: {key: take(observation) for key, take in adapters.items()}


def _boxed(wanted: gym.spaces.Box, given: gym.Space[Any]) -> Adapter | None:
    """One array made of an observation."""
    if not isinstance(given, gym.spaces.Dict):
        return _cast(wanted, given) if wanted.shape == given.shape else None
    for key in _POLICY_KEYS:
        if key in given.spaces and given[key].shape == wanted.shape:
            return _cast(wanted, given[key], key)
    if len(wanted.shape) != 1:
        return None
    if "bev" in given.spaces and wanted.shape[0] == _length(given["bev"]):
        take = _cast(wanted, given["bev"], "bev")
        return lambda observation: take(observation).reshape(-1)
    return _flattened(wanted, given)


def _flattened(wanted: gym.spaces.Box, given: gym.spaces.Dict) -> Adapter | None:
    """One vector of all keys, or of those that every BEVTown environment has, sorted by name."""
    dtype = wanted.dtype
    for keys in (tuple(given.spaces), _POLICY_KEYS):
        if not set(keys) <= set(given.spaces):
            continue
        part = gym.spaces.Dict({key: given[key] for key in keys})  # sorts its keys
        if wanted.shape[0] == gym.spaces.flatdim(part):
            names = tuple(part.spaces)
            return lambda observation: np.concatenate(
                [np.asarray(observation[key], dtype).reshape(-1) for key in names]
            )
    return None


def _cast(wanted: gym.spaces.Box, given: gym.Space[Any], key: str | None = None) -> Adapter:
    """An array, of one key if given, in the wanted type and scale.

    Raises:
        ValueError: The wanted array is scaled in a way that its bounds do not tell.
    """
    dtype, is_bytes = wanted.dtype, given.dtype == np.uint8
    low, high = float(wanted.low.min()), float(wanted.high.max())
    # bytes become fractions where the policy's bounds say so, as after a rescaling wrapper
    is_fraction = is_bytes and dtype.kind == "f" and low >= 0.0 and high <= 1.0
    if is_bytes and not is_fraction and (low > 0.0 or high < 255.0):
        raise ValueError(
            f"the policy was trained on {key or 'observations'} from {low:g} to {high:g}, as "
            "VecNormalize makes them, and the environment gives 0 to 255: scale them alike in an "
            "agent of your own, 'module:factory'"
        )

    def adapt(observation: Any) -> NDArray[Any]:
        array = observation if key is None else observation[key]
        if is_fraction:
            return np.asarray(array, dtype) / dtype.type(255.0)
        return np.asarray(array, dtype)

    return adapt


def _length(space: gym.Space[Any]) -> int:
    """Number of values in an array space."""
    return int(np.prod(space.shape or (0,)))
