"""What a process does that works for another one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading

import cv2


def become_worker() -> None:
    """Make a process leave Ctrl-C to its parent, end when it does, and keep to one thread."""
    keep_to_one_thread()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def keep_to_one_thread() -> None:
    """Compute in one thread, as all of several processes on one machine should.

    Processes that share cores slow each other down manyfold when each also starts threads.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read by PyTorch, which is not loaded yet
    cv2.setNumThreads(1)
