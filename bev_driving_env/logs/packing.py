"""Numbers of a drive as integers that are small and compress well, exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.snap import PER_RAD, PER_UNIT

ACTOR_GRID = np.array([PER_UNIT, PER_UNIT, PER_RAD, PER_UNIT])
"""Steps of the grid per unit of x, y, heading, speed."""
SIGNALS_A_WORD = 31
"""Signals of two bits each that go into an int64 and leave its sign alone."""


def on_grid(rows: NDArray[np.float64]) -> NDArray[np.int32]:
    """Poses and speeds (V, 4) of actors as integers.

    Raises:
        ValueError: A value lies between the steps of the grid (``kernels.snap``).
    """
    scaled = rows * ACTOR_GRID
    steps = scaled.astype(np.int32)
    if not np.array_equal(steps, scaled):
        where = int(np.flatnonzero((steps != scaled).any(axis=1))[0])
        raise ValueError(f"actor {where} is not on the grid of kernels.snap: {rows[where]}")
    return steps


def differences(values: NDArray[np.int32], order: int) -> NDArray[np.int32]:
    """How a column (M,) changes, or (order 2) how its changes do, as numbers of at least 0.

    They run over the whole column: where one actor's rows end and another's begin there is a
    large one, which costs less than to keep the ends apart.

    >>> differences(np.array([100, 103, 106, 109, 111], np.int32), 2).tolist()
    [200, 193, 0, 0, 1]
    """
    padded = np.concatenate([np.zeros(order, np.int64), values.astype(np.int64)])
    change: NDArray[np.int64] = np.diff(padded, n=order).astype(np.int64)
    # small ones of either sign become small numbers, so that their high bytes are all 0
    folded = (change << 1) ^ (change >> 63)
    if len(folded) and folded.max() > np.iinfo(np.int32).max:
        raise ValueError(f"a change of {abs(change).max()} does not fit into 31 bits")
    return folded.astype(np.int32)


def summed(folded: NDArray[np.int32], order: int) -> NDArray[np.int32]:
    """The column (M,) that ``differences`` was given.

    >>> summed(differences(np.array([5, -3, 4], np.int32), 1), 1).tolist()
    [5, -3, 4]
    """
    wide = folded.astype(np.int64)
    values = (wide >> 1) ^ -(wide & 1)
    for _ in range(order):
        values = np.cumsum(values)
    return values.astype(np.int32)


def pack_signals(signals: NDArray[np.uint8]) -> NDArray[np.int64]:
    """States (T, S) of signals, 0 to 3, in words (W, T) of 31 signals."""
    steps, count = signals.shape
    words = np.zeros((-(-count // SIGNALS_A_WORD), steps), np.int64)
    for k in range(count):
        word, place = divmod(k, SIGNALS_A_WORD)
        words[word] |= signals[:, k].astype(np.int64) << (2 * place)
    return words


def unpack_signals(words: NDArray[np.int64], count: int) -> NDArray[np.uint8]:
    """States (T, S) of so many signals from words (W, T)."""
    signals = np.zeros((words.shape[1], count), np.uint8)
    for k in range(count):
        word, place = divmod(k, SIGNALS_A_WORD)
        signals[:, k] = (words[word] >> (2 * place)) & 3
    return signals
