"""What a BEV source makes of frames that have nothing to do with each other."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.frames import CHANNELS
from bev_driving_env.sources.checked import checked_planes, predict, predict_batch
from bev_driving_env.sources.protocol import BatchedBEVSource, PrivilegedSource, SensorFrame


def predicted(
    name: str,
    source: Any,
    frames: Sequence[SensorFrame],
    truths: Sequence[NDArray[np.uint8]],
    seeds: Sequence[int],
) -> NDArray[np.uint8]:
    """What a source makes of frames that have nothing to do with each other.

    Args:
        name: Name of the source, for messages.
        source: The source.
        frames: What it is shown.
        truths: The true BEV (6, size, size) of each, for sources that may see it.
        seeds: For sources that draw random numbers.

    Returns:
        (N, C, size, size) uint8, the source's channels in the order of ``CHANNELS``.

    Raises:
        BEVSourceError: The source fails, or returns something that is not a BEV.
    """
    size = truths[0].shape[-1]
    with _one_thread():
        if isinstance(source, BatchedBEVSource) and not isinstance(source, PrivilegedSource):
            source.reset()
            planes = predict_batch(name, source, frames, size)
        else:
            alone = zip(frames, truths, seeds, strict=True)
            planes = np.stack([_predicted_alone(name, source, *each, size) for each in alone])
    order = [tuple(source.channels).index(channel) for channel in in_order(source.channels)]
    return planes[:, order]


def in_order(channels: Sequence[str]) -> tuple[str, ...]:
    """Channels in the order of ``CHANNELS``."""
    return tuple(channel for channel in CHANNELS if channel in channels)


def _predicted_alone(
    name: str, source: Any, frame: SensorFrame, truth: NDArray[np.uint8], seed: int, size: int
) -> NDArray[np.uint8]:
    if hasattr(source, "seed"):
        source.seed(seed)
    source.reset()
    if not isinstance(source, PrivilegedSource):
        return predict(name, source, frame, size)
    planes = source.perceive(
        frame if source.needs_frame else None, truth if source.needs_truth else None
    )
    return checked_planes(name, source.channels, planes, size)


def _one_thread() -> AbstractContextManager[None]:
    """The last digits of a network may depend on the number of threads."""
    if "torch" not in sys.modules:
        return nullcontext()
    from bev_driving_env.training.threads import one_thread

    return one_thread()
