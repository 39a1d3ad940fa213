"""Stopping a long job between two steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def noted_interrupts() -> Iterator[threading.Event]:
    """Turn Ctrl-C and a polite kill into a flag: a step is finished before training stops."""
    flag = threading.Event()

    def note(_: int, __: FrameType | None) -> None:
        if flag.is_set():  # the second time at once, for those who cannot wait for the step's end
            raise KeyboardInterrupt
        flag.set()

    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield flag
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
