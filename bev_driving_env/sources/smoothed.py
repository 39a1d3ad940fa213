"""``SmoothedBEV``: a BEV source whose static channels remember what was seen just before.

A remedy, not an error: what a predictor sees for a frame or two and then no more is taken back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..checks import is_number
from ..frames import BEVGeometry
from ..world.config import VehicleModel, WorldConfig
from .checked import predict
from .protocol import PrivilegedSource, SensorFrame
from .registry import make_bev_source, source_name

STATIC = ("road", "route", "lane")
"""Channels that stay where they are while the car moves."""
_GEOMETRY = BEVGeometry()


class EgoMotion(NamedTuple):
    """How the car moved in a step, in the ego frame before it.

    Attributes:
        forward_m: Ahead.
        left_m: To the left.
        turn_rad: To the left.
    """

    forward_m: float
    left_m: float
    turn_rad: float


def ego_motion(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    vehicle: VehicleModel,
    step_s: float,
) -> EgoMotion:
    """Dead reckoning from two frames' measurements by the kinematic bicycle.

    Args:
        before: (3,) measurements: speed in m/s, last commands for acceleration and steering.
        after: (3,) those of a step later.
        vehicle: The car.
        step_s: Seconds between them.
    """
    speed = 0.5 * (float(before[0]) + float(after[0]))
    slip = math.atan(0.5 * math.tan(float(after[2]) * vehicle.max_steering_rad))
    # a steering command above 0 turns to the right
    turn = -speed * math.sin(slip) / (0.5 * vehicle.length_m) * step_s
    course = -slip + 0.5 * turn
    return EgoMotion(speed * math.cos(course) * step_s, speed * math.sin(course) * step_s, turn)


def moved(
    plane: NDArray[np.float32], motion: EgoMotion, geometry: BEVGeometry
) -> NDArray[np.float32]:
    """A plane (S, S) of things that stay where they are, after the car has moved.

    What the old one did not show is 0.
    """
    size = geometry.size
    corners = np.array([[0.0, 0.0], [size, 0.0], [0.0, size]], np.float64)  # columns and rows
    ego = geometry.ego_from_pixel(corners)
    cosine, sine = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
    turned = ego @ np.array([[cosine, sine], [-sine, cosine]])
    old = geometry.pixel_from_ego(turned + np.array([motion.forward_m, motion.left_m]))
    matrix = cv2.getAffineTransform(corners.astype(np.float32), old.astype(np.float32))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(plane, matrix, (size, size), flags=flags), np.float32)


class SmoothedBEV:
    """A BEV source with an exponential memory of road, route and lane, moved with the car.

    Args:
        source: What ``bev_source`` takes, and no source that starts from the truth.
        memory: Weight of what was seen before, from 0, which changes nothing, to below 1.
        channels: Names of the channels that are remembered.
        geometry: BEV of the source.
        vehicle: The car.
        step_s: Seconds between frames; the environment's if None.

    Attributes:
        channels: Names of the channels of the source.
        geometry: See above.

    Raises:
        ValueError: The memory is out of range, or the source is unknown or starts from the truth.
    """

    def __init__(
        self,
        source: object,
        memory: float,
        *,
        channels: Iterable[str] = STATIC,
        geometry: BEVGeometry = _GEOMETRY,
        vehicle: VehicleModel | None = None,
        step_s: float | None = None,
    ) -> None:
        if not (is_number(memory) and 0.0 <= memory < 1.0):
            raise ValueError(f"memory must be from 0 to below 1, got {memory!r}")
        inner = make_bev_source(source)
        self._name = source_name(source)
        if isinstance(inner, PrivilegedSource):
            raise ValueError(f"{self._name!r} starts from the truth, which needs no memory")
        self._inner = inner
        self.channels: tuple[str, ...] = tuple(inner.channels)
        self.geometry = geometry
        self._memory = float(memory)
        wanted = set(channels)
        self._rows = [k for k, name in enumerate(self.channels) if name in wanted]
        self._vehicle = vehicle or VehicleModel()
        self._step_s = WorldConfig().step_s if step_s is None else step_s
        self._kept: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None

    def __repr__(self) -> str:
        return f"SmoothedBEV({self._name!r}, memory={self._memory:g})"

    def seed(self, number: int) -> None:
        """Take the episode's seed; called before :meth:`reset`."""
        if hasattr(self._inner, "seed"):
            self._inner.seed(number)

    def reset(self) -> None:
        """Forget everything: an episode starts."""
        self._kept = None
        self._inner.reset()

    def __call__(self, frame: SensorFrame) -> NDArray[np.uint8]:
        """Predict (C, size, size) uint8; remembered channels are 0 or 255."""
        measurements = np.array(frame.measurements)  # the source may change the frame
        planes = predict(self._name, self._inner, frame, self.geometry.size)
        seen = planes[self._rows].astype(np.float32)
        if self._kept is not None:
            before, old = self._kept
            motion = ego_motion(before, measurements, self._vehicle, self._step_s)
            shown = moved(np.ones(old.shape[1:], np.float32), motion, self.geometry)
            trust = self._memory * shown
            for new, plane in zip(seen, old, strict=True):
                new += trust * (moved(plane, motion, self.geometry) - new)
        self._kept = measurements, seen
        planes[self._rows] = np.where(seen >= 127.5, 255, 0)
        return planes

    def snapshot(self) -> tuple[object, object]:
        """What is remembered now."""
        inner = self._inner.snapshot() if hasattr(self._inner, "snapshot") else None
        return self._kept, inner

    def restore(self, state: tuple[object, object]) -> None:
        """Go back to a snapshot."""
        self._kept, inner = state  # type: ignore[assignment]
        if hasattr(self._inner, "restore"):
            self._inner.restore(inner)
