"""Batches of demonstrations, rendered from drive logs while the network trains on the last ones.

The order is a function of seed and step alone (``bev_driving_env.logs.order``), so training goes on
exactly where it was stopped.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bev_driving_env.logs.order import batch_numbers
from bev_driving_env.logs.split_samples import Recorded, SplitSamples
from bev_driving_env.training.kde import kde_weights

AHEAD = 4
"""Batches rendered before they are asked for."""
LARGEST_WEIGHT = 8.0
"""In means: a few lonely samples must not rule the gradient."""


class Demonstrations(Recorded, Protocol):
    """What is asked of a drive log: observations by index, and the actions of them all."""

    def bev(self, index: int) -> NDArray[np.uint8]:
        """The BEV (6, S, S) of a sample."""

    def measurements(self, index: int) -> NDArray[np.float32]:
        """Speed and previous commands (3,) of a sample."""


class Batch(NamedTuple):
    """Demonstrations to train on.

    Attributes:
        bev: (N, C, S, S) uint8.
        measurements: (N, 3) float32.
        actions: (N, 2) float32, the expert's.
        weights: (N,) float32, of each sample in the loss.
    """

    bev: Tensor
    measurements: Tensor
    actions: Tensor
    weights: Tensor

    def to(self, device: torch.device) -> Batch:
        """The batch on a device."""
        return Batch(*(part.to(device) for part in self))


def rare_action_weights(actions: NDArray[np.float32]) -> NDArray[np.float64]:
    """Weights (n,) of actions (n, 2) in [-1, 1]: one over the root of their density.

    Most of a drive is going straight at cruising speed, where every command is near 0; without
    weights the network learns little of starting off and of corners. The root is a compromise
    between the samples as they come and all actions alike.

    >>> cruising, braking = [[0.0, 0.0]] * 99, [[-0.5, 0.0]]
    >>> rare_action_weights(np.array(cruising + braking, np.float32))[[0, -1]].round(1)
    array([0.9, 8. ])
    """
    return kde_weights(actions, temper=0.5, clip=LARGEST_WEIGHT)


class SampleSet:
    """A split of several drive logs as one sequence of samples.

    It renders in arrays that it keeps, so one set belongs to one thread.

    Args:
        logs: The logs.
        split: ``"train"``, ``"val"`` or ``"all"``.
        channels: How many of the BEV's first channels to hand out.
        weigh: Makes weights (n,) of all actions (n, 2); all 1 if None.

    Attributes:
        actions: (n, 2) the expert's action in every sample.
        weights: (n,) of each sample in the loss, 1 on average.

    Raises:
        LogError: There is no sample.
        ValueError: The weights have another shape, are negative or not finite, or all 0.
    """

    def __init__(
        self,
        logs: Sequence[Demonstrations],
        split: str = "train",
        *,
        channels: int = 6,
        weigh: Callable[[NDArray[np.float32]], NDArray[np.float64]] | None = None,
    ) -> None:
        self._samples = SplitSamples(logs, split)
        self._channels = channels
        self.actions = self._samples.actions()
        self.weights = np.ones(len(self), np.float32)
        if weigh is not None:
            self.weights = _normalised(weigh(self.actions), len(self))

    def __len__(self) -> int:
        return len(self._samples)

    def batch(self, numbers: NDArray[np.int64]) -> Batch:
        """Render samples of the set, given their numbers (N,) in it."""
        bevs, measured = [], []
        for number in numbers:
            log, index = self._samples.locate(number)
            bevs.append(log.bev(index)[: self._channels])
            measured.append(log.measurements(index))
        return Batch(
            torch.from_numpy(np.stack(bevs)),
            torch.from_numpy(np.stack(measured)),
            torch.from_numpy(self.actions[numbers]),
            torch.from_numpy(self.weights[numbers]),
        )


def _normalised(weights: NDArray[np.float64], count: int) -> NDArray[np.float32]:
    """Weights (count,) with a mean of 1, so that the learning rate keeps its meaning."""
    weights = np.asarray(weights, np.float64)
    if weights.shape != (count,):
        raise ValueError(f"weights must have shape ({count},), got {weights.shape}")
    if not (np.isfinite(weights).all() and weights.min() >= 0.0 and weights.max() > 0.0):
        raise ValueError("weights must be finite and not negative, and some positive")
    return (weights / weights.mean()).astype(np.float32)


class RenderedBatches:
    """Batches of consecutive steps, rendered in a background thread; the kernels free the GIL.

    Use it as a context manager and iterate once: ``(step, batch)``.

    Args:
        samples: The set; the thread is its only reader.
        size: Samples in a batch over all ranks.
        seed: Decides the order.
        steps: First step, and the one after the last.
        rank: Number of this process.
        ranks: How many processes share every batch.
    """

    def __init__(
        self,
        samples: SampleSet,
        size: int,
        seed: int,
        steps: tuple[int, int],
        rank: int = 0,
        ranks: int = 1,
    ) -> None:
        self._samples = samples
        self._size, self._seed, self._rank, self._ranks = size, seed, rank, ranks
        self._steps = range(*steps)
        self._ready: queue.Queue[tuple[int, Batch] | BaseException | None] = queue.Queue(AHEAD)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._render, name="batches", daemon=True)

    def __enter__(self) -> RenderedBatches:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()

    def __iter__(self) -> Iterator[tuple[int, Batch]]:
        while (item := self._ready.get()) is not None:
            if isinstance(item, BaseException):
                raise item
            yield item

    def _render(self) -> None:
        try:
            for step in self._steps:
                numbers = batch_numbers(len(self._samples), self._size, self._seed, step)
                batch = self._samples.batch(numbers[self._rank :: self._ranks])
                if not self._put((step, batch)):
                    return
            self._put(None)
        except BaseException as error:  # raised again where the batch is waited for
            self._put(error)

    def _put(self, item: tuple[int, Batch] | BaseException | None) -> bool:
        """Hand over an item; False if nobody waits for it any more."""
        while not self._stopped.is_set():
            try:
                self._ready.put(item, timeout=0.1)
            except queue.Full:
                continue
            return True
        return False
