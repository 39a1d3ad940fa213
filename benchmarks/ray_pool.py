"""The same calls on a Ray cluster: many machines that share a file system, or this one."""

from __future__ import annotations

import functools
import importlib.util
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from bev_driving_env.command_line import UsageError
from bev_driving_env.workers import keep_to_one_thread

from .pool import Execute, Result

INSTALL = "pip install 'bev-driving-env[ray]'"
LOCAL = "local"
KNOCK_S = 5.0


def check_ray() -> None:
    """See to it that Ray is there.

    Raises:
        ValueError: It is not installed.
    """
    if importlib.util.find_spec("ray") is None:
        raise ValueError(f"--executor ray needs the package ray: {INSTALL}")


@contextmanager
def ray_cluster(address: str | None, workers: int) -> Iterator[Execute]:
    """Connect to a Ray cluster, or start one on this machine.

    Args:
        address: As for ``ray.init``; None for that in the variable ``RAY_ADDRESS``. Without
            either, a cluster is started here and stopped at the end.
        workers: CPUs of a cluster that is started here.

    Yields:
        What makes calls on it; as many at a time as the cluster has CPUs.

    Raises:
        UsageError: There is no cluster at that address.
    """
    import ray

    where = address or os.environ.get("RAY_ADDRESS") or LOCAL
    # Ray replaces the handler of SIGTERM by one that skips what is to be put in order
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        _knock(where)
        if where == LOCAL:
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
            ray.init(LOCAL, num_cpus=workers, include_dashboard=False, logging_level="warning")
        else:
            ray.init(where, logging_level="warning")
    except (OSError, RuntimeError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UsageError(f"no Ray cluster at {where!r}: {reason}") from error
    for number, handler in handlers.items():
        signal.signal(number, handler)
    try:
        yield _on_ray
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Find out in seconds whether anyone listens at an address, for which Ray takes minutes.

    Raises:
        OSError: Nobody does.
        ValueError: The address makes no sense.
    """
    place = urlsplit(address if "://" in address else f"ray://{address}")
    if place.hostname is not None and place.port is not None:  # unlike "local" and "auto"
        socket.create_connection((place.hostname, place.port), timeout=KNOCK_S).close()


def _on_ray(
    function: Callable[..., Result],
    calls: Iterable[tuple[Any, ...]],
    workers: int,
    *,
    apart: bool = False,
) -> Iterator[tuple[int, Result | None]]:
    """Call a function on the cluster that this process is connected to; see ``pool.Execute``."""
    import ray
    from ray.exceptions import NodeDiedError, OutOfMemoryError, WorkerCrashedError

    options = {"num_cpus": 1, "max_retries": 0, "max_calls": 1 if apart else 0}
    remote = ray.remote(**options)(_called)
    place = (os.getcwd(), tuple(sys.path))
    running = {
        remote.remote(place, function.__module__, function.__qualname__, arguments): number
        for number, arguments in enumerate(calls)
    }
    try:
        while running:
            (ready,), _ = ray.wait(list(running), num_returns=1)
            number = running.pop(ready)
            try:
                result = ray.get(ready)
            except (NodeDiedError, OutOfMemoryError, WorkerCrashedError):
                result = None
            yield number, result
    except BaseException:
        for reference in running:
            ray.cancel(reference, force=True)
        raise


def _called(
    place: tuple[str, Sequence[str]], module: str, name: str, arguments: tuple[Any, ...]
) -> Any:
    """Call a function of a module as if from the folder and with the modules of the caller."""
    _settle(place)
    return getattr(importlib.import_module(module), name)(*arguments)


@functools.lru_cache(maxsize=1)
def _settle(place: tuple[str, Sequence[str]]) -> None:
    """Make relative paths and module names mean what they mean to the caller."""
    folder, path = place
    os.chdir(folder)
    sys.path.extend(entry for entry in path if entry not in sys.path)
    keep_to_one_thread()
