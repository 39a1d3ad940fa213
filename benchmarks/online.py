"""What the policy's BEV was worth while it drove: IoU and policy divergence at every step.

Open-loop evaluation looks at frames of the expert's drives. Here the frames are those that the
policy itself came to, with all that its own mistakes led to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import CHANNELS
from bev_driving_env.kernels.layout import ROUTE_DONE
from perception.iou_counts import IoUCounts, iou_counts
from perception.places import PLACES, Places, places_along, stretches

from .count_files import OCCUPIED, load_counts, save_counts

NATS = 10.0 ** np.linspace(-4.0, 4.0, 81)
"""Edges of the histogram of divergences."""


@runtime_checkable
class Explaining(Protocol):
    """An agent that can tell how its answer would differ for another observation."""

    def divergence(self, observation: dict[str, Any], other: dict[str, Any]) -> float:
        """Divergence of its answer to one observation from that to another."""


@dataclass(frozen=True, eq=False)
class OnlineMetrics:
    """T moments of a drive: the start, and after each step.

    Attributes:
        route_m: (T,) route metres driven.
        places: What kind of place each moment was at.
        counts: Pixels of the policy's BEV against the truth, T frames, one region, six channels.
        divergence: (T,) of the policy's answer to the truth from that to its BEV, in nats
            (Kullback-Leibler); NaN for agents that give none.
    """

    route_m: NDArray[np.float64]
    places: Places
    counts: IoUCounts
    divergence: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.route_m)

    def iou(self, place: str = "all") -> dict[str, float]:
        """IoU of each channel over all moments at a kind of place; NaN for empty channels.

        Args:
            place: One of ``PLACES``.
        """
        values = self.counts.subset(self.places.chosen(place)).dataset_iou()[:, 0]
        return dict(zip(CHANNELS, values.tolist(), strict=True))

    def step_iou(self) -> NDArray[np.float64]:
        """IoU (T, 6) of each moment and channel; NaN where there is nothing to see."""
        return self.counts.frame_iou()[:, :, 0]

    def save(self, path: Path) -> None:
        """Write to an ``.npz`` file, which appears when all is written."""
        save_counts(
            path,
            self.counts,
            self.places,
            route_m=self.route_m,
            divergence=self.divergence,
        )

    @classmethod
    def load(cls, path: Path) -> OnlineMetrics:
        """Read what :meth:`save` wrote.

        Raises:
            ValueError: The file holds something else.
        """
        counts, places, (route_m, divergence) = load_counts(path, "route_m", "divergence")
        return cls(route_m, places, counts, divergence)


def summary(metrics: OnlineMetrics) -> dict[str, Any]:
    """Sums by kind of place, JSON-ready, so that drives can be added up; see :func:`pooled`."""
    return {place: _sums(metrics, metrics.places.chosen(place)) for place in PLACES}


def _sums(metrics: OnlineMetrics, chosen: NDArray[np.bool_]) -> dict[str, Any]:
    counts = metrics.counts.subset(chosen)
    hits = counts.hits.sum(axis=(0, 1, 3), dtype=np.int64)
    both = counts.predicted.sum(axis=(0, 1, 3), dtype=np.int64)
    union = both + counts.actual.sum(axis=(0, 1), dtype=np.int64) - hits
    known = metrics.divergence[chosen]
    known = known[np.isfinite(known)].astype(np.float64)
    return {
        "moments": int(chosen.sum()),
        "hits": dict(zip(CHANNELS, hits.tolist(), strict=True)),
        "union": dict(zip(CHANNELS, union.tolist(), strict=True)),
        "divergence": np.histogram(np.clip(known, *NATS[[0, -1]]), NATS)[0].tolist(),
    }


@dataclass(frozen=True)
class Seen:
    """What the policy's BEV was worth over all moments at a kind of place, of several drives.

    Attributes:
        moments: How many.
        iou: By channel; NaN where there was nothing to see.
        divergence: Median divergence of the policy's answer, in nats; NaN if it gives none. A mean
            would be that of the few moments at which sharp distributions do not meet.
    """

    moments: int
    iou: dict[str, float]
    divergence: float


def pooled(summaries: Iterable[Mapping[str, Any] | None]) -> dict[str, Seen]:
    """Add up the summaries of drives, by kind of place; drives without one are left out."""
    known = [each for each in summaries if each is not None]
    return {place: _seen([each[place] for each in known]) for place in PLACES}


def _seen(parts: Sequence[Mapping[str, Any]]) -> Seen:
    hits = {name: sum(part["hits"][name] for part in parts) for name in CHANNELS}
    union = {name: sum(part["union"][name] for part in parts) for name in CHANNELS}
    divergences = np.array([part["divergence"] for part in parts], np.float64)
    return Seen(
        sum(part["moments"] for part in parts),
        {name: hits[name] / union[name] if union[name] else math.nan for name in CHANNELS},
        _median(divergences.reshape(-1, len(NATS) - 1).sum(axis=0)),
    )


def _median(histogram: NDArray[np.float64]) -> float:
    """Where half of a histogram over ``NATS`` is reached; NaN for an empty one."""
    if not np.any(histogram):
        return math.nan
    reached = np.concatenate([[0.0], np.cumsum(histogram)]) / histogram.sum()
    return float(10.0 ** np.interp(0.5, reached, np.log10(NATS)))


class OnlineRecorder:
    """Notes a drive's moments as they come.

    Args:
        env: The environment.
        agent: Whoever drives; its divergence is taken if it knows one.
    """

    def __init__(self, env: BEVTownEnv, agent: object) -> None:
        self._env = env
        self._agent = agent if isinstance(agent, Explaining) else None
        self._route_m: list[float] = []
        self._counts: list[IoUCounts] = []
        self._divergence: list[float] = []

    def note(self, observation: dict[str, Any]) -> None:
        """Compare what the policy is shown at this moment with the truth."""
        env, bev = self._env, observation["bev"]
        truth = env.ground_truth_bev()
        self._route_m.append(float(env.world.state.progress[0, ROUTE_DONE]))
        self._counts.append(iou_counts(bev[None], truth[None], [OCCUPIED]))
        divergence = float("nan")
        if self._agent is not None:
            divergence = 0.0
            if not np.array_equal(bev, truth):
                divergence = self._agent.divergence({**observation, "bev": truth}, observation)
        self._divergence.append(divergence)

    def metrics(self) -> OnlineMetrics:
        """All that was noted.

        Raises:
            ValueError: Nothing was.
        """
        if not self._route_m:
            raise ValueError("nothing was noted: call note() at the start and after each step")
        route, town = self._env.route, self._env.world.town
        route_m = np.array(self._route_m)
        places = places_along(route_m, stretches(town, route.lanes, route.start_m))
        divergence = np.array(self._divergence, np.float32)
        return OnlineMetrics(route_m, places, IoUCounts.merged(self._counts), divergence)
