"""The one decorator every kernel uses, and what makes its on-disk cache safe and visible."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile a function on first call, cache the machine code on disk, release the GIL.

    Arithmetic is strict IEEE (no ``fastmath``): the same state gives the same bits on every run.
    """
    return _compiled(function)


def _compiled(function: Function, **options: bool) -> Function:
    options = {"nogil": True, **options}
    try:
        compiled = numba.njit(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # neither this folder nor the user's cache folder can be written
        compiled = numba.njit(error_model="numpy", **options)(function)
    return cast("Function", compiled)


def leaf_kernel(function: Function) -> Function:
    """A kernel that allocates no arrays and returns none to Python, without reference counting.

    Counting costs more than the work itself in small functions that take tuples of arrays (30
    times as much, measured): Numba counts a reference up and down at each use of a member.
    """
    return _compiled(function, _nrt=False)


def drop_stale_caches() -> None:
    """Delete cached machine code that is older than any kernel's source.

    Numba checks only the file a kernel is defined in, not the files of the kernels it calls
    (numba#1833), so an edited callee would silently run in its old form.
    """
    folder = Path(__file__).parent
    newest = max(source.stat().st_mtime for source in folder.glob("*.py"))
    for index in (folder / "__pycache__").glob("*.nbi"):
        with suppress(FileNotFoundError):  # another process may be faster
            if index.stat().st_mtime < newest:
                index.unlink()


@contextmanager
def announce_compilation(patience_s: float = 1.5) -> Iterator[None]:
    """Say on stderr that kernels are being compiled, if the block takes longer than patience."""
    message = "BEVTown: compiling the simulation kernels (once; cached on disk afterwards) ..."
    timer = threading.Timer(patience_s, lambda: print(message, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
