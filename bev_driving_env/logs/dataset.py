"""``LogDataset``: a drive log as a PyTorch dataset that renders its samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from ..cameras.renderer import CameraSettings
from ..frames import CHANNELS
from .drive_log import DriveLog

Sample = dict[str, torch.Tensor]


class LogDataset(Dataset[Sample]):
    """Samples of a drive log, rendered when they are read.

    An item is a dict of tensors: ``bev`` (C, size, size) uint8, ``measurements`` (3,) float32,
    ``action`` (2,) float32, the expert's clean one; if asked for also ``images`` (cameras, H, W, 3)
    uint8 and ``route_map`` (size, size) uint8. With a ``window`` above 1 each has a first axis of
    that many consecutive steps of one episode.

    A copy of it goes to each worker of a ``DataLoader``; it carries an array of indices, and no
    object a sample.

    Args:
        log: The log, or its folder.
        split: ``"train"``, ``"val"`` or ``"all"``.
        channels: Names of the BEV's channels, in the order wanted; none renders no BEV.
        images: Also render the cameras: ``True`` as they were recorded, or settings.
        route_map: Also render the route map.
        window: Consecutive steps an item.
        stride: Steps from one item to the next.

    Raises:
        ValueError: A channel or the split does not exist, or a number is not positive.
        LogError: The log cannot be read.
    """

    def __init__(
        self,
        log: DriveLog | str | Path,
        split: str = "train",
        *,
        channels: Sequence[str] = CHANNELS[:3],
        images: bool | CameraSettings = False,
        route_map: bool = False,
        window: int = 1,
        stride: int = 1,
    ) -> None:
        self.log = log if isinstance(log, DriveLog) else DriveLog(log)
        for name in channels:
            if name not in CHANNELS:
                raise ValueError(f"unknown channel {name!r}; channels are: {', '.join(CHANNELS)}")
        self.channels = tuple(channels)
        self.window = window
        self.indices: NDArray[np.int64] = self.log.windows(split, window, stride)
        self._chosen = [CHANNELS.index(name) for name in self.channels]
        settings = self.log.camera_settings if images is True else images
        self._settings: CameraSettings | None = settings or None
        self._route_map = route_map

    def __len__(self) -> int:
        return len(self.indices)

    def __getitem__(self, item: int) -> Sample:
        first = int(self.indices[item])
        steps = range(first, first + self.window)
        renders: dict[str, Callable[[int], NDArray[np.uint8] | NDArray[np.float32]]] = {}
        if self._chosen:
            renders["bev"] = self._bev
        renders["measurements"] = self.log.measurements
        if self._settings is not None:
            renders["images"] = self._images
        if self._route_map:
            renders["route_map"] = self.log.route_map
        arrays = {name: [render(index) for index in steps] for name, render in renders.items()}
        arrays["action"] = list(self.log.actions(np.arange(first, first + self.window)))
        return {
            name: torch.from_numpy(values[0] if self.window == 1 else np.stack(values))
            for name, values in arrays.items()
        }

    def _bev(self, index: int) -> NDArray[np.uint8]:
        return self.log.bev(index)[self._chosen]

    def _images(self, index: int) -> NDArray[np.uint8]:
        return self.log.images(index, self._settings)
