"""Training in several processes, started by ``torchrun``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import torch
import torch.distributed as dist

T = TypeVar("T")


def process_rank() -> tuple[int, int]:
    """Number of this process and how many train together."""
    if dist.is_available() and dist.is_initialized():
        return dist.get_rank(), dist.get_world_size()
    return 0, 1


@contextmanager
def distributed() -> Iterator[tuple[int, int]]:
    """Join the processes of ``torchrun``, if there are any; yields rank and how many there are."""
    if not dist.is_torchelastic_launched():
        yield 0, 1
        return
    dist.init_process_group("gloo")
    try:
        yield process_rank()
    finally:
        dist.destroy_process_group()


def first_process_does(work: Callable[[], None]) -> None:
    """Let the first process do something while the others wait.

    Raises:
        ValueError: It could not; all processes raise this, so that none waits for ever.
        OSError: Likewise.
    """
    rank, ranks = process_rank()
    failure: list[Exception | None] = [None]
    if rank == 0:
        try:
            work()
        except (ValueError, OSError) as error:
            failure = [error]
    if ranks > 1:
        dist.broadcast_object_list(failure)
    if failure[0] is not None:
        raise failure[0]


def any_process(flag: bool) -> bool:
    """Whether the flag of any process is set; all have to ask at the same step."""
    _, ranks = process_rank()
    if ranks == 1:
        return flag
    flags = torch.tensor(int(flag))
    dist.all_reduce(flags, dist.ReduceOp.MAX)
    return bool(flags)


def of_all_processes(value: T) -> list[T]:
    """Values of all processes in order of their ranks, the same list in each."""
    _, ranks = process_rank()
    values: list[T] = [value] * ranks
    if ranks > 1:
        dist.all_gather_object(values, value)
    return values
