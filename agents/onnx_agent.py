"""Agents that are an ONNX file: a policy of any framework, run by onnxruntime (an extra)."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .adapters import Adapter, describe, observation_adapter

_TYPES: dict[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
}


class TensorInfo(Protocol):
    """What a session tells about an input; symbolic dimensions are strings or None."""

    name: str
    shape: Sequence[int | str | None]
    type: str


class InferenceSession(Protocol):
    """The part of ``onnxruntime.InferenceSession`` that driving needs."""

    def get_inputs(self) -> Sequence[TensorInfo]:
        """The model's inputs."""

    def run(self, names: None, feeds: Mapping[str, NDArray[Any]]) -> Sequence[NDArray[Any]]:
        """All outputs for the given inputs."""


class ONNXAgent:
    """Drives with an ONNX model.

    Each input has a batch axis first. One that is called like a key of the observation gets that;
    any other gets what its shape says (see ``agents.adapters``). Images come as the environment
    gives them, 0 to 255, also as floats: a model that wants fractions divides by itself. The first
    output is the action; what lies beyond [-1, 1] is clipped.

    Args:
        session: The loaded model.
        env: The environment it will drive.

    Raises:
        ValueError: An input cannot be made of the environment's observations.
    """

    def __init__(self, session: InferenceSession, env: gym.Env[Any, Any]) -> None:
        self.session = session
        self._feeds = {
            info.name: _feed(info, env.observation_space) for info in session.get_inputs()
        }

    def reset(self, seed: int | None) -> None:
        """Nothing to do: a model keeps no state, and draws nothing that the seed could set."""

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """The model's action (2,); ValueError where it fails, or its output is none."""
        feeds = {name: feed(observation)[None] for name, feed in self._feeds.items()}
        try:
            output = np.asarray(self.session.run(None, feeds)[0])
        except Exception as error:  # its errors derive from nothing more specific
            shapes = ", ".join(f"{name} {array.shape}" for name, array in feeds.items())
            raise ValueError(
                f"the ONNX model cannot be run on {shapes}: {_first_line(error)}"
            ) from error
        if output.size != 2 or not np.isfinite(output).all():
            raise ValueError(
                "the first output of an ONNX agent must be one finite action (1, 2), got "
                f"{output.tolist()!r} of shape {output.shape}"
            )
        return np.clip(output.reshape(2).astype(np.float32), -1.0, 1.0)


def load_onnx_agent(path: Path, env: gym.Env[Any, Any]) -> ONNXAgent:
    """Make an agent of an ONNX file, which onnxruntime runs on one core.

    Raises:
        FileNotFoundError: There is no such file.
        ImportError: onnxruntime is not installed; the message says how to.
        ValueError: It is no ONNX model, or does not fit the environment.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        onnxruntime = importlib.import_module("onnxruntime")
    except ImportError as error:
        raise ImportError(
            "ONNX agents need onnxruntime: pip install 'bev-driving-env[onnx]'"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 4  # what it would print besides is raised too
    try:
        session = onnxruntime.InferenceSession(
            str(path), sess_options=options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # its errors derive from nothing more specific
        raise ValueError(
            f"{path} is no ONNX model that onnxruntime loads: {_first_line(error)}"
        ) from error
    return ONNXAgent(session, env)


def _feed(info: TensorInfo, given: gym.Space[Any]) -> Adapter:
    """How to make one input, without its batch axis, of an observation."""
    dtype = _TYPES.get(info.type)
    batch, *dims = info.shape or [0]
    if dtype is None or (isinstance(batch, int) and batch != 1):
        raise ValueError(
            f"input {info.name!r} of the ONNX model is {info.type} {list(info.shape)}; it must be "
            f"one of {', '.join(_TYPES)} with a batch axis of 1 or any length first"
        )
    spaces = given.spaces if isinstance(given, gym.spaces.Dict) else {}
    named = spaces.get(info.name)
    if named is not None and _matches(dims, named.shape):
        return lambda observation: np.asarray(observation[info.name], dtype)
    image = spaces.get("bev", given).shape
    if image is not None and _matches(dims, image):
        dims = list(image)
    shape = [size for size in dims if isinstance(size, int)]
    if len(shape) < len(dims):
        raise ValueError(
            f"input {info.name!r} of the ONNX model has shape {list(info.shape)}, which does not "
            f"say what it is; name it after a key of {describe(given)}"
        )
    high = 255 if dtype is np.uint8 else np.inf
    wanted = gym.spaces.Box(0, high, shape, dtype)
    try:
        return observation_adapter(wanted, given)
    except ValueError as error:
        raise ValueError(f"input {info.name!r} of the ONNX model: {error}") from error


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]


def _matches(dims: Sequence[int | str | None], shape: tuple[int, ...] | None) -> bool:
    """Whether dimensions, some of them symbolic, are those of a shape."""
    return (
        shape is not None
        and len(dims) == len(shape)
        and all(not isinstance(d, int) or d == n for d, n in zip(dims, shape, strict=True))
    )
