"""In which order training reads drive logs: a function of seed and step, so that it can go on."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .drive_log import DriveLog
from .errors import LogError

CACHED_EPISODES = 4096
"""Shuffled samples come from all episodes at once: one that is not kept is read again and again."""


def open_logs(folders: Sequence[Path]) -> list[DriveLog]:
    """Open drive logs to read them in any order.

    Raises:
        LogError: There is none, or one cannot be read.
    """
    if not folders:
        raise LogError("no data to train on: name folders that bev-agents collect wrote")
    return [DriveLog(folder, cached_episodes=CACHED_EPISODES) for folder in folders]


def batch_numbers(count: int, size: int, seed: int, step: int) -> NDArray[np.int64]:
    """Numbers (size,) of the samples of a training step.

    Every epoch goes through all samples once, in an order of its own; a batch may lie across the
    end of one.

    Args:
        count: Samples there are.
        size: Samples in a batch.
        seed: Decides the order.
        step: Batches before this one.
    """
    epoch, first = divmod(step * size, count)
    parts: list[NDArray[np.int64]] = []
    while size > 0:
        part = _order(count, seed, epoch)[first : first + size]
        parts.append(part)
        size, first, epoch = size - len(part), 0, epoch + 1
    return np.concatenate(parts)


@functools.lru_cache(maxsize=2)
def _order(count: int, seed: int, epoch: int) -> NDArray[np.int64]:
    """Order of the samples (count,) in an epoch."""
    return np.random.default_rng([seed, epoch]).permutation(count)
