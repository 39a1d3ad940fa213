"""Stopping a long job between two steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ..command_line import Terminated


@contextmanager
def noted_interrupts() -> Iterator[threading.Event]:
    """Turn Ctrl-C and SIGTERM into a flag: a step is finished before training stops.

    Whoever sees the flag raises ``KeyboardInterrupt``; after SIGTERM it leaves as ``Terminated``.
    """
    flag = threading.Event()
    noted = []

    def note(number: int, _: FrameType | None) -> None:
        noted.append(number)
        if flag.is_set():  # the second time at once, for those who cannot wait for the step's end
            raise KeyboardInterrupt
        flag.set()

    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield flag
    except KeyboardInterrupt as stop:
        if signal.SIGTERM in noted:
            raise Terminated from stop
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
