"""One thread for inference on single observations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Run torch in one thread for the time of a block, then as before.

    A single observation is too little work to share: waking other threads costs more than they
    do, and several times more where episodes run in one process per core. The number is one for
    the whole process, so it is put back.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
