"""What networks are given of a sensor frame, and what a mirror would show of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.sources.ipm_ground import GroundView
from bev_driving_env.sources.protocol import SensorFrame

Arrays = dict[str, NDArray[Any]]
"""Inputs of one sample, without a batch axis."""
NEEDS = ("images", "intrinsics", "extrinsics", "route_map", "ground")
"""All that a network can ask for."""
RIG = frozenset({"intrinsics", "extrinsics"})
"""What is the same in all samples of a rig."""
LOOKING = frozenset({"images", "ground"})
"""What the cameras must be rendered for."""
SURROUND_ORDER = (0, 2, 1, 3)
"""In a mirror, the default rig's left and right cameras change places."""


class FrameInputs:
    """Makes a network's inputs of sensor frames.

    * ``"images"`` (N, H, W, 3) uint8 RGB
    * ``"intrinsics"`` (N, 3, 3) float32, pixels
    * ``"extrinsics"`` (N, 4, 4) float32 ``camera_from_ego``, metres
    * ``"route_map"`` (S, S) uint8
    * ``"ground"`` (S, S, 3) uint8 RGB: the images as they would fall on flat ground, black where no
      camera looks

    Args:
        needs: Names of the inputs wanted.
        geometry: Where the BEV lies; the paper's if None.

    Attributes:
        needs: See above.
        geometry: See above.
        looks: Whether images matter; if not, those of the frames may be black.

    Raises:
        ValueError: There is no such input.
    """

    def __init__(self, needs: Collection[str], geometry: BEVGeometry | None = None) -> None:
        unknown = [name for name in needs if name not in NEEDS]
        if unknown or not needs:
            raise ValueError(
                f"a network needs one or more of {', '.join(NEEDS)}, got {sorted(needs)}"
            )
        self.needs = frozenset(needs)
        self.geometry = geometry or BEVGeometry()
        self.looks = bool(self.needs & LOOKING)
        self._view: tuple[object, GroundView] | None = None

    def __call__(self, frame: SensorFrame) -> Arrays:
        """The inputs that a frame gives, in the order of ``NEEDS``."""
        return {
            name: self._ground(frame) if name == "ground" else getattr(frame, name)
            for name in NEEDS
            if name in self.needs
        }

    def _ground(self, frame: SensorFrame) -> NDArray[np.uint8]:
        rig = (frame.intrinsics.tobytes(), frame.extrinsics.tobytes(), frame.images.shape)
        if self._view is None or self._view[0] != rig:
            size = (frame.images.shape[1], frame.images.shape[2])
            view = GroundView(self.geometry, frame.intrinsics, frame.extrinsics, size)
            self._view = (rig, view)
        return self._view[1].project(frame.images)


def mirror_order(extrinsics: NDArray[np.floating]) -> tuple[int, ...]:
    """Which camera's mirror image takes each camera's place, if a rig is symmetric.

    Args:
        extrinsics: ``camera_from_ego`` (N, 4, 4).

    Returns:
        N numbers; each camera keeps its own place if the rig is not symmetric.

    >>> from bev_driving_env.cameras.rig import CameraRig
    >>> mirror_order(CameraRig().extrinsics()) == SURROUND_ORDER
    True
    """
    nominal = np.asarray(extrinsics, np.float64)
    differences = np.abs(_mirrored_extrinsics(nominal)[None] - nominal[:, None]).max(axis=(2, 3))
    order = tuple(int(number) for number in differences.argmin(axis=1))
    symmetric = differences.min(axis=1).max() < 1e-4 and len(set(order)) == len(order)
    return order if symmetric else tuple(range(len(order)))


def mirrored(
    inputs: Mapping[str, NDArray[Any]],
    target: NDArray[np.uint8],
    order: Sequence[int] = SURROUND_ORDER,
) -> tuple[Arrays, NDArray[np.uint8]]:
    """A sample as a mirror to the left of the car would show it.

    The car stays where it is: column c of a BEV comes from column S - c. Column 0 would come from
    outside and repeats column 1.

    Args:
        inputs: Inputs of one sample, without a batch axis.
        target: BEV (C, S, S).
        order: What ``mirror_order`` says of the rig: with it, a symmetric rig stays as it is.

    Returns:
        Inputs and target, newly made.

    Raises:
        ValueError: There are intrinsics, but no images that would tell their width.
    """
    made: Arrays = {}
    places = list(order)
    for name, values in inputs.items():
        if name == "images":
            made[name] = np.ascontiguousarray(values[places][:, :, ::-1])
        elif name == "extrinsics":
            made[name] = _mirrored_extrinsics(values)[places].astype(np.float32)
        elif name == "intrinsics":
            if "images" not in inputs:
                raise ValueError("intrinsics cannot be mirrored without images: how wide are they?")
            width = inputs["images"].shape[2]
            made[name] = _mirrored_intrinsics(values, width)[places].astype(np.float32)
        else:
            made[name] = _mirrored_columns(values, axis=1)
    return made, _mirrored_columns(target, axis=2)


def _mirrored_columns(plane: NDArray[np.uint8], axis: int) -> NDArray[np.uint8]:
    size = plane.shape[axis]
    columns = size - np.arange(size)
    columns[0] = size - 1
    return np.take(plane, columns, axis)


def _mirrored_extrinsics(extrinsics: NDArray[np.floating]) -> NDArray[np.floating]:
    """Both y of the ego frame and x of the camera frame change sign."""
    signs = np.outer([-1.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0])
    return np.asarray(extrinsics * signs)


def _mirrored_intrinsics(intrinsics: NDArray[np.floating], width: int) -> NDArray[np.floating]:
    """Column u becomes width - 1 - u."""
    made = np.array(intrinsics)
    made[:, 0, 1] *= -1.0
    made[:, 0, 2] = width - 1 - made[:, 0, 2]
    return made


def collated(samples: Iterable[Mapping[str, NDArray[Any]]]) -> dict[str, Tensor]:
    """Inputs of samples as batched tensors (B, ...) that share no memory with them.

    Intrinsics and extrinsics become (1, ...) where all samples have the same, so that networks
    work out only once where cells and pixels lie.
    """
    first, *others = samples
    return {
        name: torch.from_numpy(np.stack([values, *_more(name, values, others)]))
        for name, values in first.items()
    }


def _more(
    name: str, first: NDArray[Any], others: Sequence[Mapping[str, NDArray[Any]]]
) -> list[NDArray[Any]]:
    """The other samples' values of an input, none if they may be left out."""
    values = [other[name] for other in others]
    if name in RIG and all(np.array_equal(first, other) for other in values):
        return []
    return values
