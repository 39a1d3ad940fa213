"""Calls in worker processes, whose results come as they are ready."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Protocol, TypeVar

from bev_driving_env.workers import become_worker

from .errors import OtherRunError

Result = TypeVar("Result")


class Execute(Protocol):
    """Whatever makes calls on several cores: :func:`in_processes`, or a Ray cluster."""

    def __call__(
        self,
        function: Callable[..., Result],
        calls: Iterable[tuple[Any, ...]],
        workers: int,
        *,
        apart: bool = False,
    ) -> Iterator[tuple[int, Result | None]]:
        """Call a function once for each of several arguments.

        Args:
            function: Of a module, so that it can be named to another process.
            calls: Arguments of each call.
            workers: Calls at a time.
            apart: Each call in a process of its own, instead of one after the other in a few.

        Yields:
            The number of a call and its result as soon as it is there, in any order; None in
            place of the result if the call's process died. The other calls go on.

        Raises:
            Exception: What a call raised.
        """


def in_processes(
    function: Callable[..., Result],
    calls: Iterable[tuple[Any, ...]],
    workers: int,
    *,
    apart: bool = False,
) -> Iterator[tuple[int, Result | None]]:
    """Call a function in worker processes of this machine; see :class:`Execute`."""
    left = deque(enumerate(calls))
    pools = _Pools()
    running: dict[Future[Result], tuple[int, ProcessPoolExecutor]] = {}

    def start_next(pool: ProcessPoolExecutor) -> None:
        number, arguments = left.popleft()
        running[pool.submit(function, *arguments)] = number, pool

    try:
        for _ in range(min(workers, len(left))):
            start_next(pools.add())
        while running:
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                number, pool = running.pop(future)
                died = isinstance(future.exception(), BrokenProcessPool)
                if left:
                    start_next(pools.replace(pool) if died or apart else pool)
                yield number, None if died else future.result()
    except BaseException:
        pools.kill()
        raise
    pools.close()


def results_of(
    function: Callable[..., Result], calls: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[Result]:
    """Results of calls as they are ready; one worker, or a single call, needs no other process.

    Args:
        function: As for :class:`Execute`.
        calls: Arguments of each call.
        workers: Calls at a time.

    Raises:
        OtherRunError: The process of a call died; results that it had written are kept.
        Exception: What a call raised.
    """
    given = list(calls)
    if workers == 1 or len(given) <= 1:
        yield from (function(*arguments) for arguments in given)
        return
    for number, result in in_processes(function, given, workers):
        if result is None:
            raise OtherRunError(
                f"the process died that called {function.__name__}{given[number]} (see its output "
                "above, if there is any); what was finished is kept, the same command resumes"
            )
        yield result


class _Pools:
    """A pool a worker: if its process dies, it is known over which call, and the others live on."""

    def __init__(self) -> None:
        # spawned, not forked: the parent may hold threads (progress bar, numerical libraries)
        self._context = multiprocessing.get_context("spawn")
        self._pools: list[ProcessPoolExecutor] = []
        self._others = set(multiprocessing.active_children())

    def add(self) -> ProcessPoolExecutor:
        """A new one, which starts its process with its first call."""
        pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=become_worker)
        self._pools.append(pool)
        return pool

    def replace(self, pool: ProcessPoolExecutor) -> ProcessPoolExecutor:
        """A new one in place of one that has nothing to do any more."""
        self._pools.remove(pool)
        pool.shutdown()
        return self.add()

    def close(self) -> None:
        """End all processes, which have nothing to do any more."""
        for pool in self._pools:
            pool.shutdown()

    def kill(self) -> None:
        """End all processes at once: what they have not finished would be done for nobody."""
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for worker in set(multiprocessing.active_children()) - self._others:
            worker.terminate()
