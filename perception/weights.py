"""Predictors on disk: safetensors with what is needed to build the network and to read its output.

The header holds the network's spec, the size of the images that it was trained on, the threshold
of each channel (tuned on the validation route), and a card: data, steps, measured IoU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from bev_driving_env.checks import is_int
from bev_driving_env.weights_file import (
    WeightsError,
    read_tensors,
    read_weights_header,
    write_weights,
)

from .models.presets import ModelSpec

__all__ = ["Predictor", "WeightsError", "load_predictor", "predictor_card", "save_predictor"]

KIND = "bevtown_predictor"
VERSION = 1


@dataclass(frozen=True)
class Predictor:
    """A trained network.

    Attributes:
        spec: What it is made of.
        model: The network.
        thresholds: Least probability, of each channel, of a cell that counts as occupied.
        camera_size: Height and width of the images it was trained on.
        card: What is known about its training.

    Raises:
        ValueError: There are more or fewer thresholds than channels, one is not in (0, 1), or
            the size is none.
    """

    spec: ModelSpec
    model: nn.Module
    thresholds: tuple[float, ...]
    camera_size: tuple[int, int]
    card: Mapping[str, Any]

    def __post_init__(self) -> None:
        channels = self.spec.config.channels
        object.__setattr__(self, "thresholds", tuple(map(float, self.thresholds)))
        object.__setattr__(self, "camera_size", tuple(self.camera_size))
        object.__setattr__(self, "card", dict(self.card))
        if len(self.camera_size) != 2 or not all(is_int(s) and s > 0 for s in self.camera_size):
            raise ValueError(f"camera_size must be (height, width), got {self.camera_size!r}")
        if len(self.thresholds) != len(channels) or not all(0 < t < 1 for t in self.thresholds):
            raise ValueError(
                f"thresholds must be {len(channels)} numbers between 0 and 1, one a channel, "
                f"got {self.thresholds!r}"
            )

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the BEV channels that it predicts."""
        return self.spec.config.channels


def save_predictor(predictor: Predictor, path: str | Path) -> None:
    """Write a predictor; an interruption leaves no half file.

    Raises:
        ValueError: A weight is not finite.
        TypeError: The card holds something that JSON cannot.
    """
    header = {
        "spec": predictor.spec.as_json(),
        "thresholds": list(predictor.thresholds),
        "camera_size": list(predictor.camera_size),
        "card": dict(predictor.card),
    }
    write_weights(Path(path), KIND, VERSION, header, predictor.model.state_dict())


def load_predictor(path: str | Path) -> Predictor:
    """Make the predictor that a file describes, in single precision and evaluation mode.

    Raises:
        FileNotFoundError: There is no such file.
        WeightsError: The file is damaged, not a predictor's, or of a newer version.
    """
    header = read_weights_header(Path(path), KIND, VERSION)
    tensors = read_tensors(Path(path))
    try:
        spec = ModelSpec.from_json(header["spec"])
        model = spec.build()
        model.load_state_dict(tensors)
        predictor = Predictor(
            spec, model, _numbers(header["thresholds"]), header["camera_size"], header["card"]
        )
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise WeightsError(
            f"{path} does not hold the predictor that it describes: {reason}"
        ) from error
    model.eval().requires_grad_(False)
    return predictor


def predictor_card(path: str | Path) -> dict[str, Any]:
    """The card of a file, without building the network; errors as in :func:`load_predictor`."""
    return dict(read_weights_header(Path(path), KIND, VERSION).get("card", {}))


def _numbers(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
