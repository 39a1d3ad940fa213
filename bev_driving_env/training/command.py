"""What the commands that train have in common: options, and running under ``torchrun``."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ..checks import require_count


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add where a training computes and what it does with its folder."""
    add = parser.add_argument
    add("--threads", type=int, metavar="N", help="of torch; default: torch's own")
    add("--device", default="cpu", help="torch device; default: cpu")
    add("--checkpoint-minutes", type=float, default=2.0, metavar="X", help="default: 2")
    add("--tensorboard", action="store_true", help="also write TensorBoard events to OUT")
    add("--overwrite", action="store_true", help="discard what the folder already holds")


def run_in_processes(threads: int | None, train: Callable[[bool], None]) -> None:
    """Train in the processes of ``torchrun``, if there are any.

    Args:
        threads: Of torch in each; None leaves torch's own.
        train: Is told whether this process is the one that shows and writes.

    Raises:
        ValueError: The number of threads is not positive.
    """
    # with the verb, not with the parser: PyTorch takes seconds to load
    import torch

    from .processes import distributed

    if threads is not None:
        require_count("--threads", threads)
        torch.set_num_threads(threads)
    with distributed() as (rank, _):
        train(rank == 0)
