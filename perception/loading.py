"""Batches of samples: their keys in a fixed order, rendered by worker processes.

The keys of a step are a pure function of seed and step, so training that was stopped goes on with
the very batches that it would have seen.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from bev_driving_env.checks import is_int, require_count
from bev_driving_env.logs.order import batch_numbers
from bev_driving_env.workers import become_worker

from .inputs import collated
from .samples import BEVSamples, Sample, SampleKey, unpacked

LOOK_SEEDS = 2**32


class SampleBatch(NamedTuple):
    """A batch of samples.

    Attributes:
        numbers: (B,) int64, which ones of the set.
        inputs: What the network needs, batched.
        bits: (B, 6, S, S / 8) uint8: the true BEVs, eight cells a byte.
    """

    numbers: Tensor
    inputs: dict[str, Tensor]
    bits: Tensor

    def to(self, device: torch.device) -> SampleBatch:
        """The batch on a device."""
        inputs = {
            name: values.to(device, non_blocking=True) for name, values in self.inputs.items()
        }
        bits = self.bits.to(device, non_blocking=True)
        return SampleBatch(self.numbers.to(device, non_blocking=True), inputs, bits)

    def target(self) -> Tensor:
        """The true BEVs (B, 6, S, S) uint8, 0 or 255."""
        return unpacked(self.bits)


@dataclass(frozen=True)
class BatchPlan:
    """Keys of the batches of a range of training steps; a batch sampler.

    Every epoch is a permutation of the set. The keys of a step depend on seed and step alone, and
    the shares of all ranks make up the batch.

    Attributes:
        count: Samples there are.
        size: Samples in a batch over all ranks.
        seed: Decides order, looks and flips.
        steps: First step, and the one after the last.
        flips: Whether half of the samples, chosen at random, are mirrored.
        rank: Number of this process.
        ranks: How many processes share every batch.

    Raises:
        ValueError: A number is out of range; the message shows it.
    """

    count: int
    size: int
    seed: int
    steps: tuple[int, int]
    flips: bool = True
    rank: int = 0
    ranks: int = 1

    def __post_init__(self) -> None:
        for name in ("count", "size", "ranks"):
            require_count(name, getattr(self, name))
        if not (is_int(self.seed) and self.seed >= 0):
            raise ValueError(f"seed must be an int of at least 0, got {self.seed!r}")
        first, end = self.steps
        if not (is_int(first) and is_int(end) and 0 <= first <= end):
            raise ValueError(f"steps must be two ints, 0 <= first <= end, got {self.steps!r}")
        if not (is_int(self.rank) and 0 <= self.rank < self.ranks):
            raise ValueError(f"rank must be from 0 to {self.ranks - 1}, got {self.rank!r}")
        if self.size % self.ranks:
            raise ValueError(
                f"the batch size must be a multiple of the {self.ranks} ranks, got {self.size}"
            )

    def keys(self, step: int) -> list[SampleKey]:
        """This rank's keys of a step."""
        numbers = batch_numbers(self.count, self.size, self.seed, step)
        rng = np.random.Generator(np.random.Philox(key=[self.seed, step]))
        look_seeds = rng.integers(LOOK_SEEDS, size=self.size)
        flips = (rng.random(self.size) < 0.5) & self.flips
        columns = (numbers.tolist(), look_seeds.tolist(), flips.tolist())
        drawn = [SampleKey(*key) for key in zip(*columns, strict=True)]
        return drawn[self.rank :: self.ranks]

    def __len__(self) -> int:
        return self.steps[1] - self.steps[0]

    def __iter__(self) -> Iterator[list[SampleKey]]:
        return map(self.keys, range(*self.steps))


def batches_in_order(numbers: Iterable[int], size: int) -> list[list[SampleKey]]:
    """Keys of samples one after the other, never mirrored, in batches: for evaluation."""
    keys = [SampleKey(int(number), int(number)) for number in numbers]
    return [keys[first : first + size] for first in range(0, len(keys), size)]


def sample_loader(
    samples: BEVSamples,
    batches: BatchPlan | Sequence[list[SampleKey]],
    *,
    workers: int,
    prefetch: int = 4,
    pinned: bool = False,
) -> DataLoader[SampleBatch]:
    """Batches, rendered by worker processes while the network trains on the last ones.

    Args:
        samples: The set.
        batches: Keys of each batch.
        workers: Worker processes; 0 renders in this one.
        prefetch: Batches that each worker renders ahead.
        pinned: Whether to put them where a GPU fetches them fastest.
    """
    return DataLoader(
        samples,  # type: ignore[arg-type]  # what is asked for and what comes out differ
        batch_sampler=batches,
        num_workers=workers,
        collate_fn=batched,
        pin_memory=pinned,
        prefetch_factor=prefetch if workers else None,
        # a fork would copy the locks of the threads that numba and PyTorch keep
        multiprocessing_context="spawn" if workers else None,
        worker_init_fn=_start_worker if workers else None,
        # its seed for workers, which draw nothing, would else come from the global generator, and
        # training that goes on would draw other numbers than training that was never stopped
        generator=torch.Generator(),
        persistent_workers=workers > 0,
    )


def batched(samples: Sequence[Sample]) -> SampleBatch:
    """Samples as a batch."""
    return SampleBatch(
        torch.tensor([sample.number for sample in samples]),
        collated(sample.inputs for sample in samples),
        torch.from_numpy(np.stack([sample.bits for sample in samples])),
    )


def _start_worker(_: int) -> None:
    become_worker()
    torch.set_num_threads(1)
    numba.set_num_threads(1)


class Waited:
    """Passes batches on and measures how long they had to be waited for.

    Args:
        batches: Where they come from.

    Attributes:
        waited_s: Time spent in waiting.
        total_s: Time since the first batch was asked for.
    """

    def __init__(self, batches: Iterable[SampleBatch]) -> None:
        self._batches = batches
        self.waited_s = self.total_s = 0.0

    @property
    def waiting_share(self) -> float:
        """Part of the time in which the consumer had nothing to do."""
        return self.waited_s / self.total_s if self.total_s else 0.0

    def __iter__(self) -> Generator[SampleBatch, None, None]:
        coming = iter(self._batches)
        started = time.perf_counter() - self.total_s
        while True:
            asked = time.perf_counter()
            batch = next(coming, None)
            now = time.perf_counter()
            self.waited_s += now - asked
            self.total_s = now - started
            if batch is None:
                return
            yield batch
            self.total_s = time.perf_counter() - started
