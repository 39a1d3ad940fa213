"""Training in several processes, started by ``torchrun``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch.distributed as dist


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
