"""``BEVSamples``: drive logs as what a network is given and what it should answer.

A sample is a pure function of its key, whichever process renders it and whatever came before.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from bev_driving_env.cameras.look import Look, draw_look
from bev_driving_env.cameras.randomisation import randomised_look
from bev_driving_env.cameras.renderer import CameraSettings
from bev_driving_env.cameras.rig import CameraRig
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.split_samples import SplitSamples
from bev_driving_env.sources.protocol import SensorFrame

from .inputs import Arrays, FrameInputs, mirror_order, mirrored
from .training_config import LOOKS

HELD_OUT = ("test", "hard")
"""Appearances that no network may be trained on."""
DRAWN: dict[str, Callable[[int, int], Look]] = {
    "random": functools.partial(draw_look, "train"),
    "wild": randomised_look,
}
"""What draws the look of each sample, by seed and number of cameras."""


class SampleKey(NamedTuple):
    """All that decides what a sample is.

    Attributes:
        number: Which sample of the set.
        look_seed: Seed of its look; without meaning where the looks are those of the log.
        flip: Whether it is mirrored.
    """

    number: int
    look_seed: int = 0
    flip: bool = False


class Sample(NamedTuple):
    """One sample.

    Attributes:
        number: Which one of the set.
        inputs: What the network needs, without a batch axis.
        bits: (6, S, S / 8) uint8: the true BEV, eight cells a byte.
    """

    number: int
    inputs: Arrays
    bits: NDArray[np.uint8]


class BEVSamples(Dataset[Sample]):
    """A split of several drive logs as one set of samples, whose items are asked for by key.

    A copy goes to each worker of a loader. It carries arrays of indices, and no object a sample.

    Args:
        logs: The logs; see ``logs.order.open_logs``.
        split: ``"train"``, ``"val"`` or ``"all"``.
        needs: What the network needs; see ``FrameInputs``.
        looks: ``"log"``: everything looks as it did on the drive; ``"random"``: each sample has a
            look of its own, drawn from those for training; ``"wild"``: one that varies far more,
            see ``randomised_look``.
        rig: Cameras instead of those of the recording.

    Raises:
        LogError: There is no sample.
        ValueError: An argument is unknown, or a network would be trained on looks that are kept
            for testing.
    """

    def __init__(
        self,
        logs: Sequence[DriveLog],
        split: str,
        needs: Collection[str],
        *,
        looks: str = "log",
        rig: CameraRig | None = None,
    ) -> None:
        if looks not in LOOKS:
            raise ValueError(f"looks must be one of {', '.join(LOOKS)}, got {looks!r}")
        self._samples = SplitSamples(logs, split)
        self._looks = looks
        self._settings = [self._settings_of(log, rig) for log in logs]
        held_out = [s.appearance for s in self._settings if s.set_name in HELD_OUT]
        if split == "train" and held_out:
            raise ValueError(
                f"a log has the appearance {held_out[0]!r}, which is kept for testing: train on it "
                'with looks="random"'
            )
        geometries = {log.geometry for log in logs}
        if len(geometries) > 1:
            raise ValueError("all logs must be opened with the same BEV geometry")
        self._inputs = FrameInputs(needs, geometries.pop())
        self._orders = [mirror_order(settings.rig.extrinsics()) for settings in self._settings]

    def _settings_of(self, log: DriveLog, rig: CameraRig | None) -> CameraSettings:
        settings = log.camera_settings
        if rig is not None:
            settings = dataclasses.replace(settings, rig=rig)
        return (
            dataclasses.replace(settings, appearance="train") if self._looks != "log" else settings
        )

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def needs(self) -> frozenset[str]:
        """What is rendered for the network."""
        return self._inputs.needs

    @property
    def geometry(self) -> BEVGeometry:
        """Where the BEV lies."""
        return self._inputs.geometry

    def locate(self, number: int) -> tuple[DriveLog, int]:
        """Log and index in it of a sample."""
        return self._samples.locate(number)

    def actions(self) -> NDArray[np.float32]:
        """The expert's action (n, 2) in every sample."""
        return self._samples.actions()

    def __getitem__(self, key: SampleKey | tuple[int, int, bool]) -> Sample:
        number, look_seed, flip = key
        log, index = self.locate(number)
        settings = self._settings[self._samples.log_number(number)]
        look = None
        if self._looks != "log":
            draw = DRAWN[self._looks]
            look = draw(look_seed, len(settings.rig.cameras))
        inputs = self._inputs(self._frame(log, index, settings, look))
        bev = log.bev(index)
        if flip:
            inputs, bev = mirrored(inputs, bev, self._orders[self._samples.log_number(number)])
        return Sample(number, inputs, packed(bev))

    def _frame(
        self, log: DriveLog, index: int, settings: CameraSettings, look: Look | None
    ) -> SensorFrame:
        if self._inputs.looks:
            return log.sensor_frame(index, settings, look)
        return SensorFrame(
            np.zeros(settings.rig.shape, np.uint8),  # nobody looks
            settings.rig.intrinsics(),
            settings.rig.extrinsics(),
            log.route_map(index),
            log.measurements(index),
        )


def packed(bev: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A BEV (..., S) of 0 and 255 with eight cells of a row in each byte, the first one highest.

    Raises:
        ValueError: Rows are no whole bytes.
    """
    if bev.shape[-1] % 8:
        raise ValueError(f"the BEV's side must be a multiple of 8 px, got {bev.shape[-1]}")
    return np.packbits(bev >= 128, axis=-1)


def unpacked(bits: Tensor) -> Tensor:
    """Inverse of ``packed``: (..., S / 8) uint8 to (..., S) uint8, 0 or 255."""
    places = torch.tensor([128, 64, 32, 16, 8, 4, 2, 1], dtype=torch.uint8, device=bits.device)
    cells = (bits[..., None] & places) > 0
    return cells.flatten(-2).to(torch.uint8) * 255
