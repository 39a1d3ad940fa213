"""``BEVSource`` and ``SensorFrame``: what a predictor is given, and what it must return."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Planes = NDArray[np.uint8] | NDArray[np.floating]
"""BEV planes (C, size, size): uint8 in 0..255, or float in [0, 1]."""


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """What the car senses at one moment, and nothing else: no ground truth can be reached from it.

    The arrays are the receiver's own: it may keep and change them. Ego frame: metres, x forward,
    y left, z up from the ground, origin at the centre of the footprint. Camera frame: x right,
    y down, z forward; integer pixel coordinates are pixel centres.

    Attributes:
        images: (4, H, W, 3) uint8 RGB: front, left, right, rear; of another rig, its cameras.
        intrinsics: (4, 3, 3) float32, pixels.
        extrinsics: (4, 4, 4) float32 ``camera_from_ego``, nominal: the same in every frame,
            whatever the body and the mounting really do.
        route_map: (192, 192) uint8, the sparse plan in the BEV frame.
        measurements: (3,) float32: speed in m/s, last acceleration and steering commands.
    """

    images: NDArray[np.uint8]
    intrinsics: NDArray[np.float32]
    extrinsics: NDArray[np.float32]
    route_map: NDArray[np.uint8]
    measurements: NDArray[np.float32]

    def copy(self) -> SensorFrame:
        """A frame with arrays of its own."""
        return SensorFrame(
            self.images.copy(),
            self.intrinsics.copy(),
            self.extrinsics.copy(),
            self.route_map.copy(),
            self.measurements.copy(),
        )


@runtime_checkable
class BEVSource(Protocol):
    """Turns sensor frames into bird's-eye views.

    Three methods are optional. ``predict_batch(frames)`` returns (N, C, size, size) for a list of
    N frames; a source that has it is shared by all worlds of a vector environment, so it must not
    remember anything from frame to frame. ``snapshot()`` and ``restore(state)`` let a source that
    does remember something take part in rewinding. ``seed(number)``, called before ``reset()``
    with a number made from the episode's seed (from which no one can tell the hidden errors of
    cameras and GPS), lets a random source draw differently in each episode.

    Attributes:
        channels: Names of the channels it predicts, in the order of its output; of
            ``frames.CHANNELS``. The others are 0.
    """

    channels: tuple[str, ...]

    def reset(self) -> None:
        """Forget everything: an episode starts."""

    def __call__(self, frame: SensorFrame) -> Planes:
        """Predict (len(channels), size, size): uint8 in 0..255 or float in [0, 1]."""


@runtime_checkable
class BatchedBEVSource(BEVSource, Protocol):
    """A source that predicts many frames in one call."""

    def predict_batch(self, frames: Sequence[SensorFrame]) -> Planes:
        """Predict (N, len(channels), size, size) for N frames."""


class PrivilegedSource:
    """Base of sources that may see the true BEV: ``GroundTruth``, and ``CorruptedBEV`` around it.

    Only subclasses are given the truth, whatever methods another class has: a predictor cannot come
    by it unawares.

    Attributes:
        channels: Names of the channels it returns, in order.
        needs_frame: Whether it wants a sensor frame too (rendering one takes time).
        needs_truth: Whether it wants the true BEV.
    """

    channels: tuple[str, ...]
    needs_frame: bool
    needs_truth: bool

    def reset(self) -> None:
        """Forget everything: an episode starts."""

    def perceive(
        self, frame: SensorFrame | None, truth: NDArray[np.uint8] | None
    ) -> NDArray[np.uint8]:
        """Planes (len(channels), size, size) uint8, given what it asked for."""
        raise NotImplementedError


class BEVSourceError(RuntimeError):
    """A BEV source failed, or returned something that is not a BEV.

    Attributes:
        source: Name of the source.
    """

    def __init__(self, source: str, message: str) -> None:
        super().__init__(f"BEV source {source!r} {message}")
        self.source = source

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        # exceptions are pickled by their arguments; the message is already complete
        prefix = f"BEV source {self.source!r} "
        return type(self), (self.source, str(self).removeprefix(prefix))
