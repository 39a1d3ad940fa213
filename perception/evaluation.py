"""How well a BEV source sees: IoU over frames of drive logs, by channel, place and distance."""

from __future__ import annotations

import functools
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.sources.registry import make_bev_source, source_name
from bev_driving_env.workers import become_worker

from .evaluation_frames import FrameKey, View, others_elsewhere, spread_keys
from .iou_counts import IoUCounts, iou_counts, range_bands
from .places import Places, log_places
from .predicting import in_order, predicted

BAND_EDGES_M = (10.0, 20.0)
BANDS = ("0-10 m", "10-20 m", "over 20 m")
THRESHOLD = 0.5
CHUNK = 8
"""Frames that are predicted at once; the last digits of a network may depend on it."""
Pair = tuple[FrameKey, FrameKey]


class TurnQuality(NamedTuple):
    """The route channel on frames before and in turns; NaN where there are none.

    Attributes:
        frames: How many frames.
        iou: Dataset-level IoU.
        quantile_05: IoU that 5 % of the frames stay under.
        median: IoU that half of the frames stay under.
        under_50: Share of the frames with an IoU under 0.5.
        under_70: Likewise under 0.7.
    """

    frames: int
    iou: float
    quantile_05: float
    median: float
    under_50: float
    under_70: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a source saw of F frames; the terms are those of ``metrics.py``.

    Attributes:
        source: Name of the source.
        channels: Channels that it predicts, in the order of ``CHANNELS``.
        counts: Pixels by frame, band of distance and channel.
        places: What kind of place each frame was taken at.
        keys: What each frame was.
        others: The frame elsewhere that each one was mixed with, if the view says so.
        view: How the frames were shown.
    """

    source: str
    channels: tuple[str, ...]
    counts: IoUCounts
    places: Places
    keys: tuple[FrameKey, ...]
    others: tuple[FrameKey, ...]
    view: View

    def __len__(self) -> int:
        return len(self.keys)

    def chosen(self, place: str) -> NDArray[np.bool_]:
        """Which frames (F,) were taken at a kind of place, one of ``PLACES``."""
        return self.places.chosen(place)

    def iou(self, place: str = "all", band: int | None = None) -> dict[str, float]:
        """Dataset-level IoU of each channel.

        Args:
            place: One of ``PLACES``.
            band: Number of a band of ``BANDS``; None: everywhere.
        """
        bands = None if band is None else [band]
        counts = self.counts.subset(self.chosen(place), bands)
        return self._by_channel(counts.dataset_iou()[:, 0])

    def mean_frame_iou(self, place: str = "all") -> dict[str, float]:
        """Mean over frames of the IoU of each channel."""
        counts = self.counts.subset(self.chosen(place))
        return self._by_channel(counts.mean_frame_iou()[:, 0])

    def route_iou(self) -> NDArray[np.float64]:
        """IoU of the route channel in each frame (F,); NaN where its union is empty.

        Raises:
            ValueError: The source does not predict it.
        """
        if "route" not in self.channels:
            raise ValueError(f"{self.source} does not predict the route")
        return self.counts.frame_iou()[:, self.channels.index("route"), 0]

    def turns(self) -> TurnQuality | None:
        """The route channel before and in turns; None if the source does not predict it."""
        if "route" not in self.channels:
            return None
        iou = self.route_iou()[self.places.turn]
        iou = iou[np.isfinite(iou)]
        if not len(iou):
            return TurnQuality(0, *[float("nan")] * 5)
        low, median = np.quantile(iou, [0.05, 0.5]).tolist()
        under = (float((iou < limit).mean()) for limit in (0.5, 0.7))
        return TurnQuality(len(iou), self.iou("turn")["route"], low, median, *under)

    def _by_channel(self, values: NDArray[np.float64]) -> dict[str, float]:
        return dict(zip(self.channels, values.tolist(), strict=True))


def evaluate(
    source: Any,
    logs: Sequence[DriveLog],
    split: str = "all",
    *,
    samples: int = 500,
    appearance: str = "test",
    change: str = "none",
    motion: bool = True,
    seed: int = 0,
    pool: Executor | None = None,
    progress: Callable[[int], object] = lambda frames: None,
) -> Evaluation:
    """Run a BEV source over frames of drive logs, and count what it hits and misses.

    The frames lie evenly spread over the split and are rendered anew. Each is shown as the first
    of an episode: a source that remembers starts afresh.

    Args:
        source: What ``make_bev_source`` takes: a name, a path, ``"module:factory"``, or a source.
        logs: Drive logs, opened with one BEV geometry.
        split: ``"all"``, ``"train"`` or ``"val"`` (route 0).
        samples: How many frames.
        appearance: What they look like; see ``View``.
        change: What is changed in them, one of ``CHANGES``: with ``"black"`` or
            ``"other_images"`` a predictor that sees can do no better than one that is blind, and
            with ``"no_map"`` or ``"other_map"`` it cannot tell the route at a turn.
        motion: Whether body and mounting of the cameras move.
        seed: Decides looks and which other frames are shown.
        pool: From :func:`worker_pool`; the result does not depend on it. It makes sources anew:
            objects must pickle, and names registered in this process are unknown there.
        progress: Called with the number of frames each time that some are done.

    Returns:
        What was counted.

    Raises:
        LogError: A log is damaged, or the split is empty.
        ValueError: An argument is unknown or out of range, or the source cannot be made.
        BEVSourceError: The source fails, or returns something that is not a BEV.
    """
    made = make_bev_source(source)
    keys = spread_keys(logs, split, samples, seed)
    geometry = _common_geometry(source, made, logs)
    view = View(appearance, change, motion, getattr(made, "camera_size", None))
    others = others_elsewhere(logs, keys, seed) if view.needs_others else keys
    pairs = list(zip(keys, others, strict=True))
    chunks = [pairs[first : first + CHUNK] for first in range(0, len(pairs), CHUNK)]
    if pool is None:
        name = source_name(source)
        done = (_count(name, made, logs, view, geometry, chunk) for chunk in chunks)
    else:
        spec = _Job(source, tuple(log.folder for log in logs), view, geometry)
        done = (part for part in pool.map(functools.partial(_count_job, spec), chunks))
    counted = []
    for part in done:
        counted.append(part)
        progress(len(part))
    return Evaluation(
        source=source_name(source),
        channels=in_order(made.channels),
        counts=IoUCounts.merged(counted),
        places=_places(logs, keys),
        keys=tuple(keys),
        others=tuple(others),
        view=view,
    )


@contextmanager
def worker_pool(workers: int) -> Iterator[Executor | None]:
    """Processes for :func:`evaluate`; None if one is enough."""
    if workers <= 1:
        yield None
        return
    # spawned, not forked: the parent may hold threads (progress bar, numerical libraries)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


class _Job(NamedTuple):
    spec: Any
    folders: tuple[Path, ...]
    view: View
    geometry: BEVGeometry


def _start_worker() -> None:
    become_worker()
    numba.set_num_threads(1)


def _count_job(job: _Job, pairs: Sequence[Pair]) -> IoUCounts:
    logs = [_opened(folder, job.geometry) for folder in job.folders]
    named = isinstance(job.spec, str | Path)
    source = _made(job.spec) if named else job.spec
    return _count(source_name(job.spec), source, logs, job.view, job.geometry, pairs)


@functools.lru_cache(maxsize=8)
def _opened(folder: Path, geometry: BEVGeometry) -> DriveLog:
    return DriveLog(folder, bev=geometry)


@functools.lru_cache(maxsize=2)
def _made(spec: str | Path) -> Any:
    return make_bev_source(spec)


def _count(
    name: str,
    source: Any,
    logs: Sequence[DriveLog],
    view: View,
    geometry: BEVGeometry,
    pairs: Sequence[Pair],
) -> IoUCounts:
    """Counts of some frames."""
    frames = [view.frame(logs, key, other) for key, other in pairs]
    truths = [logs[key.log].bev(key.sample) for key, _ in pairs]
    planes = predicted(name, source, frames, truths, [key.look_seed for key, _ in pairs])
    rows = [CHANNELS.index(channel) for channel in in_order(source.channels)]
    bands = range_bands(geometry, BAND_EDGES_M)
    return iou_counts(planes, np.stack(truths)[:, rows], [THRESHOLD], bands)


def _places(logs: Sequence[DriveLog], keys: Sequence[FrameKey]) -> Places:
    """Keys are in the order of the logs."""
    of_log = [[key.sample for key in keys if key.log == number] for number in range(len(logs))]
    parts = [
        log_places(log, np.array(indices, np.int64))
        for log, indices in zip(logs, of_log, strict=True)
    ]
    return Places(
        np.concatenate([part.critical for part in parts]),
        np.concatenate([part.turn for part in parts]),
    )


def _common_geometry(spec: Any, source: Any, logs: Sequence[DriveLog]) -> BEVGeometry:
    geometry = logs[0].geometry
    theirs = getattr(source, "geometry", geometry)
    if any(log.geometry != geometry for log in logs) or theirs != geometry:
        raise ValueError(
            f"bev_source {source_name(spec)!r} and all logs must have one BEV geometry: "
            f"{theirs}, {', '.join(str(log.geometry) for log in logs)}"
        )
    return geometry
