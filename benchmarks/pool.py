"""Calls in worker processes, whose results come as they are ready."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

from bev_driving_env.workers import become_worker

Result = TypeVar("Result")


def in_processes(
    function: Callable[..., Result], calls: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[Result]:
    """Call a function in worker processes; results come in the order in which they are ready.

    Args:
        function: Of a module, so that it can be named to another process.
        calls: Arguments of each call.
        workers: Processes.

    Raises:
        BrokenProcessPool: A worker died; what was ready before has been yielded.
    """
    # spawned, not forked: the parent may hold threads (progress bar, numerical libraries)
    context = multiprocessing.get_context("spawn")
    given = list(calls)
    if not given:
        return
    pool = ProcessPoolExecutor(
        min(workers, len(given)), mp_context=context, initializer=become_worker
    )
    others = set(multiprocessing.active_children())
    try:
        futures = [pool.submit(function, *arguments) for arguments in given]
        for future in as_completed(futures):
            yield future.result()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        # what they have not finished would be done for nobody
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
        raise
    pool.shutdown()
