"""Steps of a training that is kept now and then, and before it stops for a signal."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from .processes import any_process

T = TypeVar("T")


def kept_steps(
    steps: Iterable[T],
    keep: Callable[[], None],
    interrupted: threading.Event,
    every_s: float,
) -> Iterator[T]:
    """Hand on what each step yields; the training is kept once the caller has dealt with it.

    Args:
        steps: Yields after each step.
        keep: Writes all that is needed to go on.
        interrupted: See ``noted_interrupts``; of any process it stops them all.
        every_s: Least seconds between two times of keeping.

    Raises:
        KeyboardInterrupt: There was a signal; the training has been kept.
    """
    kept = time.monotonic()
    for step in steps:
        yield step
        if any_process(interrupted.is_set()):
            keep()
            raise KeyboardInterrupt
        if time.monotonic() - kept > every_s:
            keep()
            kept = time.monotonic()
