"""``ModelSource``: a trained network as a BEV source."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.sources.protocol import SensorFrame

from .inputs import FrameInputs, collated
from .metrics import least_level
from .precision import resolved_precision
from .weights import Predictor, load_predictor

OUTPUTS = ("masks", "probabilities")
CHUNK = 8
"""Frames that go through the network at once: more do not fit the processor's caches."""


class ModelSource:
    """Predicts the BEV with a network.

    It remembers nothing from frame to frame, so one serves all worlds of a vector environment.

    Args:
        predictor: The network, or the file that it is in.
        output: ``"masks"``: 255 where a channel's probability reaches its threshold, else 0, like
            the ground truth that policies are trained on; ``"probabilities"``: times 255.
        precision: ``"bf16"``, ``"fp32"``, or ``"auto"``: bf16 where the processor multiplies
            matrices in it.

    Attributes:
        geometry: The BEV that it predicts.
        channels: Names of the channels.

    Raises:
        ValueError: There is no such output or precision.
        FileNotFoundError: There is no such file.
        WeightsError: The file holds no predictor.
    """

    def __init__(
        self, predictor: Predictor | str | Path, output: str = "masks", precision: str = "auto"
    ) -> None:
        if output not in OUTPUTS:
            raise ValueError(f"output must be one of {', '.join(OUTPUTS)}, got {output!r}")
        self._half = resolved_precision(precision) == "bf16"
        loaded = predictor if isinstance(predictor, Predictor) else load_predictor(predictor)
        self.predictor = loaded
        self.channels = loaded.channels
        self.geometry = BEVGeometry()
        self._output = output
        self._inputs = FrameInputs(loaded.model.needs, self.geometry)  # type: ignore[arg-type]
        self._levels = least_level(np.array(loaded.thresholds)).astype(np.uint8)

    @property
    def camera_size(self) -> tuple[int, int]:
        """Height and width of the images that it must be shown."""
        return self.predictor.camera_size

    def reset(self) -> None:
        """Nothing is remembered but tables that depend on the rig alone."""

    def __call__(self, frame: SensorFrame) -> NDArray[np.uint8]:
        """Predict (C, 192, 192) uint8."""
        return self.predict_batch([frame])[0]

    def predict_batch(self, frames: Sequence[SensorFrame]) -> NDArray[np.uint8]:
        """Predict (N, C, 192, 192) uint8 for N frames."""
        parts = [
            self.probabilities(frames[first : first + CHUNK])
            for first in range(0, len(frames), CHUNK)
        ]
        bev = np.concatenate(parts)
        if self._output == "masks":
            return (bev >= self._levels[:, None, None]).astype(np.uint8) * np.uint8(255)
        return bev

    def probabilities(self, frames: Sequence[SensorFrame]) -> NDArray[np.uint8]:
        """Probabilities times 255 (N, C, 192, 192) uint8 for frames that go through at once."""
        size = self.predictor.camera_size
        for frame in frames:
            if self._inputs.looks and frame.images.shape[1:3] != size:
                raise ValueError(
                    f"the network was trained on images of {size[0]} x {size[1]} px, got "
                    f"{frame.images.shape[1]} x {frame.images.shape[2]}: set camera_size={size}"
                )
        inputs = collated(self._inputs(frame) for frame in frames)
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=self._half):
            logits = self.predictor.model(inputs)
            return (
                torch.sigmoid(logits.float()).mul_(255.0).round_().to(torch.uint8).numpy(force=True)
            )
