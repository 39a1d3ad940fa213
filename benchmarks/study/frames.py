"""The frames that all variants are measured on: clips of the expert's perturbed drives."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.collect import claim_folder, collect, jobs_of, log_header
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.settings import EnvSettings
from bev_driving_env.sources.corruptions import LATENCY_FRAMES
from bev_driving_env.sources.policy_view import PolicyView
from bev_driving_env.sources.protocol import SensorFrame
from perception.evaluation_frames import LOOK_SEEDS, FrameKey, View
from perception.places import Places, log_places

from ..suites import LOOKS

LEVELS = (0.0, 0.25, 0.5)
"""Perturbation: not at all, and twice within the lane, as a policy strays before it fails."""
LOG_ROUTES: Mapping[str, tuple[int, ...]] = {"Town01": (0,), "Town02": (0, 5)}
"""Town01's other routes are those that predictors are trained on; Town02 is new to them."""
LOGS = "drive_logs"


def collect_logs(
    folder: Path,
    towns: Sequence[str],
    seed: int,
    workers: int,
    *,
    routes: Mapping[str, Sequence[int]] = LOG_ROUTES,
    time_limit_s: float | None = None,
    note: Mapping[str, Any] | None = None,
) -> list[Path]:
    """Let the expert drive; episodes that are there already are not driven again.

    Args:
        folder: Where the logs go, a folder a town.
        towns: Towns.
        seed: Decides the perturbations.
        workers: Processes.
        routes: Long routes by town; for a town that is not named, the first.
        time_limit_s: Simulated seconds of an episode at most; None for the usual.
        note: Where the logs come from.

    Returns:
        Folders of the logs.

    Raises:
        LogError: A folder holds something else.
        ValueError: A town has no long routes.
    """
    paths = []
    for town in towns:
        settings = EnvSettings(appearance=LOOKS.get(town, "train"), time_limit_s=time_limit_s)
        header = log_header(town, settings, LEVELS, seed, note)
        jobs = jobs_of(header, routes.get(town, (0,)))
        path = folder / town
        claim_folder(path, header)
        collect(path, header, jobs, workers)
        paths.append(path)
    return paths


def clip_keys(logs: Sequence[DriveLog], samples: int, seed: int) -> list[FrameKey]:
    """Keys of frames that have a full clip before them, evenly spread over each log.

    Args:
        logs: The logs.
        samples: How many of each; all there are if there are fewer.
        seed: Decides their looks.

    Raises:
        ValueError: A log has no such frame.
    """
    keys: list[FrameKey] = []
    for number, log in enumerate(logs):
        last = log.windows(length=LATENCY_FRAMES + 1) + LATENCY_FRAMES
        if not len(last):
            raise ValueError(f"{log.folder} has no episode of {LATENCY_FRAMES + 1} steps")
        count = min(samples, len(last))
        chosen = last[(np.arange(count) * 2 + 1) * len(last) // (2 * count)].tolist()
        looks = np.random.default_rng([seed, number]).integers(LOOK_SEEDS, size=count).tolist()
        keys += [FrameKey(number, *pair) for pair in zip(chosen, looks, strict=True)]
    return keys


class Sight(NamedTuple):
    """A frame as a policy would see it, and the truth.

    Attributes:
        bev: (6, size, size) uint8 of a variant.
        truth: (6, size, size) uint8.
        measurements: (3,) float32.
    """

    bev: NDArray[np.uint8]
    truth: NDArray[np.uint8]
    measurements: NDArray[np.float32]


@dataclass(frozen=True)
class Frames:
    """Frames of drive logs, the same for every variant and in every process.

    Attributes:
        folders: The logs'.
        samples: How many frames of each log.
        seed: Decides their looks.
    """

    folders: tuple[Path, ...]
    samples: int
    seed: int

    @property
    def logs(self) -> tuple[DriveLog, ...]:
        """The logs, opened once in each process."""
        return _opened(self.folders)

    @property
    def keys(self) -> tuple[FrameKey, ...]:
        """What each frame is."""
        return _keys(self)

    @property
    def places(self) -> Places:
        """What kind of place each frame was taken at."""
        parts = [
            log_places(log, np.array([k.sample for k in self.keys if k.log == n], np.int64))
            for n, log in enumerate(self.logs)
        ]
        return Places(
            np.concatenate([part.critical for part in parts]),
            np.concatenate([part.turn for part in parts]),
        )

    def seen(self, view: PolicyView, key: FrameKey, remembered: int) -> Sight:
        """Show a variant the clip that ends with a frame; an episode starts with it.

        The looks are those of the drives: seen ones in Town01, held-out ones in Town02.

        Args:
            view: The variant's.
            key: The frame.
            remembered: How many frames before it the variant needs.
        """
        log = self.logs[key.log]
        shown = View(LOOKS.get(log.header.town, "train"))
        truth = log.bev(key.sample)
        bev = truth
        if not view.is_truth:
            view.reset(0, key.look_seed)
            for sample in range(key.sample - remembered, key.sample + 1):
                frame_of = functools.partial(self._frame, shown, key._replace(sample=sample))
                true = log.bev(sample)[None] if view.needs_truth else None
                bev = view.observe([0], frame_of, true)[0]
        return Sight(bev, truth, log.measurements(key.sample))

    def _frame(self, shown: View, key: FrameKey, world: int) -> SensorFrame:
        return shown.frame(self.logs, key, key)


@functools.lru_cache(maxsize=1)
def _opened(folders: tuple[Path, ...]) -> tuple[DriveLog, ...]:
    return tuple(DriveLog(folder) for folder in folders)


@functools.lru_cache(maxsize=1)
def _keys(frames: Frames) -> tuple[FrameKey, ...]:
    return tuple(clip_keys(frames.logs, frames.samples, frames.seed))
