"""What a predictor is shown when it is evaluated: frames of drive logs, rendered for the purpose.

With cameras or route map of another place, or with none, a predictor shows what it really uses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.cameras.look import APPEARANCES, draw_look
from bev_driving_env.cameras.renderer import CameraSettings
from bev_driving_env.checks import require_count
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.sources.protocol import SensorFrame

CHANGES = {
    "none": "",
    "black": "black cameras",
    "other_images": "cameras of another place",
    "no_map": "no route map",
    "other_map": "route map of another place",
}
"""What can be changed in frames, and how it is called in tables."""
AS_RECORDED = "log"
ELSEWHERE_M = 60.0
"""Nothing that a BEV shows can be seen from so far away."""
LOOK_SEEDS = 2**32


class FrameKey(NamedTuple):
    """All that decides what a frame is.

    Attributes:
        log: Number of the log.
        sample: Number of the sample in it.
        look_seed: Seed of its look.
    """

    log: int
    sample: int
    look_seed: int


def spread_keys(
    logs: Sequence[DriveLog], split: str, samples: int, seed: int = 0
) -> list[FrameKey]:
    """Keys of samples that lie evenly spread over a split of several logs, in their order.

    Args:
        logs: The logs.
        split: ``"train"``, ``"val"`` or ``"all"``.
        samples: How many; all there are if there are fewer.
        seed: Decides their looks.

    Raises:
        LogError: The split is empty.
        ValueError: There is no such split, or ``samples`` is not positive.
    """
    require_count("samples", samples)
    chosen = [log.indices(split) for log in logs]
    indices = np.concatenate([np.zeros(0, np.int64), *chosen])
    if not len(indices):
        folders = ", ".join(str(log.folder) for log in logs) or "the data"
        raise LogError(
            f"{folders} has no sample of split {split!r}: route 0 is for validation, the others "
            "for training; split 'all' takes both"
        )
    numbers = np.repeat(np.arange(len(logs)), [len(part) for part in chosen])
    count = min(samples, len(indices))
    places = (np.arange(count) * 2 + 1) * len(indices) // (2 * count)
    looks = np.random.default_rng([seed, 0]).integers(LOOK_SEEDS, size=count)
    columns = (numbers[places].tolist(), indices[places].tolist(), looks.tolist())
    return [FrameKey(*key) for key in zip(*columns, strict=True)]


def others_elsewhere(
    logs: Sequence[DriveLog],
    keys: Sequence[FrameKey],
    seed: int = 0,
    apart_m: float = ELSEWHERE_M,
) -> list[FrameKey]:
    """For each key another one, drawn from those of places farther away than ``apart_m``.

    Where all are nearer, it is the farthest one.

    Raises:
        ValueError: There is just one key.
    """
    if len(keys) < 2:
        raise ValueError("frames of other places need at least 2 samples")
    xy = np.array([_ego_xy(logs[key.log], key.sample) for key in keys])
    towns = np.array([logs[key.log].header.town for key in keys])
    rng = np.random.default_rng([seed, 1])
    drawn = []
    for k in range(len(keys)):
        away = np.where(towns == towns[k], np.hypot(*(xy - xy[k]).T), np.inf)
        away[k] = -1.0
        elsewhere = np.flatnonzero(away > apart_m)
        drawn.append(int(rng.choice(elsewhere)) if len(elsewhere) else int(away.argmax()))
    return [keys[number] for number in drawn]


def _ego_xy(log: DriveLog, sample: int) -> NDArray[np.float64]:
    episode, step = log.locate(sample)
    return np.asarray(log.replay(episode).log.motion[step, :2])


@dataclass(frozen=True)
class View:
    """How frames are shown.

    Attributes:
        appearance: ``"train"``, ``"test"`` or ``"hard"``: each frame has a look of its own, drawn
            from these; ``"log"``: looks of the recording.
        change: What is changed; see ``CHANGES``.
        motion: Whether the body pitches and rolls and the cameras' mounting is a little off.
        camera_size: Height and width of the images; those of the recording if None.

    Raises:
        ValueError: There is no such appearance or change.
    """

    appearance: str = "test"
    change: str = "none"
    motion: bool = True
    camera_size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for name, known in (("appearance", (*APPEARANCES, AS_RECORDED)), ("change", CHANGES)):
            if getattr(self, name) not in known:
                raise ValueError(
                    f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}"
                )

    @property
    def needs_others(self) -> bool:
        """Whether frames show something of other places."""
        return self.change in ("other_images", "other_map")

    def frame(self, logs: Sequence[DriveLog], key: FrameKey, other: FrameKey) -> SensorFrame:
        """What the predictor is shown at a sample, where ``other`` is elsewhere."""
        log = logs[key.log]
        settings = self._settings(log)
        looks_from = other if self.change == "other_images" else key
        maps_from = other if self.change == "other_map" else key
        route_map = logs[maps_from.log].route_map(maps_from.sample)
        return SensorFrame(
            images=np.zeros(settings.rig.shape, np.uint8)
            if self.change == "black"
            else self._images(logs, looks_from),
            intrinsics=settings.rig.intrinsics(),
            extrinsics=settings.rig.extrinsics(),
            route_map=np.zeros_like(route_map) if self.change == "no_map" else route_map,
            measurements=log.measurements(key.sample),
        )

    def _images(self, logs: Sequence[DriveLog], key: FrameKey) -> NDArray[np.uint8]:
        log, look = logs[key.log], None
        settings = self._settings(log)
        if self.appearance != AS_RECORDED:
            look = draw_look(self.appearance, key.look_seed, len(settings.rig.cameras))
        return log.images(key.sample, settings, look)

    def _settings(self, log: DriveLog) -> CameraSettings:
        settings = dataclasses.replace(log.camera_settings, motion=self.motion)
        if self.appearance != AS_RECORDED:
            settings = dataclasses.replace(settings, appearance=self.appearance)
        if self.camera_size is not None:
            rig = dataclasses.replace(settings.rig, size=self.camera_size)
            settings = dataclasses.replace(settings, rig=rig)
        return settings
