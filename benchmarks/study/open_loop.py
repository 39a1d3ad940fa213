"""What a variant is worth open loop: on frames that others drove, the same for all variants."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents import Agent, make_agent
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.sources.policy_view import PolicyView
from perception.evaluation import BAND_EDGES_M
from perception.iou_counts import IoUCounts, iou_counts, range_bands
from perception.places import Places

from ..count_files import OCCUPIED, load_counts, save_counts
from ..errors import OtherRunError
from ..online import Explaining
from ..pool import results_of
from .frames import Frames, Sight
from .variants import STATIC, Variant, remembered_frames

STATIC_ROWS = slice(0, len(STATIC))


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """A variant on F frames.

    Attributes:
        counts: Pixels by frame, band of distance (see ``perception.evaluation``), and channel:
            road, route, lane.
        places: What kind of place each frame was taken at.
        divergence: (F,) nats from the agent's answer to the truth to its answer to the variant;
            NaN for agents that give none.
        action_gap: (F, 2) how far the agent's acceleration and steering commands are from those
            that it gives on the truth.
    """

    counts: IoUCounts
    places: Places
    divergence: NDArray[np.float32]
    action_gap: NDArray[np.float32]

    def save(self, path: Path) -> None:
        """Write to an ``.npz`` file, which appears when all is written."""
        save_counts(
            path,
            self.counts,
            self.places,
            divergence=self.divergence,
            action_gap=self.action_gap,
        )

    @classmethod
    def load(cls, path: Path) -> OpenLoop:
        """Read what :meth:`save` wrote.

        Raises:
            OtherRunError: The file holds something else.
        """
        try:
            counts, places, more = load_counts(path, "divergence", "action_gap")
        except ValueError as error:
            raise OtherRunError(f"{error}; delete it") from error
        return cls(counts, places, *more)


def measure_all(
    variants: Sequence[Variant], agent: str, frames: Frames, folder: Path, workers: int
) -> list[OpenLoop]:
    """Measure all variants that are not measured yet.

    Args:
        variants: The variants.
        agent: Whose answers are compared.
        frames: What they are measured on.
        folder: Where each variant's ``.npz`` file goes.
        workers: Processes.

    Returns:
        In the order of the variants.

    Raises:
        BEVSourceError: A variant fails.
        OtherRunError: A file holds something else.
    """
    paths = [folder / f"{file_stem(variant)}.npz" for variant in variants]
    calls = [
        (variant.spec, agent, frames, path)
        for variant, path in zip(variants, paths, strict=True)
        if not path.exists()
    ]
    kept = len(variants) - len(calls)
    with tqdm(total=len(variants), initial=kept, unit="variant", desc="measuring") as bar:
        for _ in results_of(measure_and_keep, calls, workers):
            bar.update()
    return [OpenLoop.load(path) for path in paths]


def file_stem(variant: Variant) -> str:
    """A file name that no other variant has."""
    name = "".join(c if c.isalnum() else "-" for c in variant.spec)
    return f"{name[:100]}__{hashlib.sha256(variant.spec.encode()).hexdigest()[:8]}"


def measure_and_keep(spec: str, agent: str, frames: Frames, path: Path) -> Path:
    """Measure a variant and write what it is worth."""
    measure(spec, _agent(agent, frames.logs[0].header.town), frames).save(path)
    return path


@functools.lru_cache(maxsize=1)
def _agent(spec: str, town: str) -> Agent:
    return make_agent(spec, BEVTownEnv(town))


def measure(spec: str, agent: Agent, frames: Frames) -> OpenLoop:
    """What a variant is worth.

    Args:
        spec: Its BEV source.
        agent: Whose answers are compared.
        frames: What it is measured on.

    Raises:
        BEVSourceError: The variant fails.
    """
    from bev_driving_env.training.threads import one_thread  # loads torch

    with one_thread():
        view = PolicyView(spec, 1, frames.logs[0].geometry)
        remembered = remembered_frames(spec)
        bands = range_bands(frames.logs[0].geometry, BAND_EDGES_M)
        sights = (frames.seen(view, key, remembered) for key in frames.keys)
        rows = [compared(sight, agent, bands) for sight in sights]
    counts, divergence, gaps = zip(*rows, strict=True)
    return OpenLoop(
        IoUCounts.merged(counts),
        frames.places,
        np.array(divergence, np.float32),
        np.array(gaps, np.float32).reshape(-1, 2),
    )


def compared(
    sight: Sight, agent: Agent, bands: NDArray[np.int64]
) -> tuple[IoUCounts, float, NDArray[Any]]:
    """Compare a variant's frame with the truth.

    Args:
        sight: The frame.
        agent: Whose answers are compared.
        bands: (size, size) band of distance of each pixel.

    Returns:
        Pixels; divergence of the agent's answers; distance (2,) of its actions.
    """
    bev, truth = sight.bev[None, STATIC_ROWS], sight.truth[None, STATIC_ROWS]
    counts = iou_counts(bev, truth, [OCCUPIED], bands)
    if np.array_equal(sight.bev, sight.truth):
        return counts, 0.0 if isinstance(agent, Explaining) else float("nan"), np.zeros(2)
    true: dict[str, NDArray[Any]] = {"bev": sight.truth, "measurements": sight.measurements}
    shown = {**true, "bev": sight.bev}
    gap = np.abs(agent.act(shown) - agent.act(true))
    divergence = agent.divergence(true, shown) if isinstance(agent, Explaining) else float("nan")
    return counts, divergence, gap
