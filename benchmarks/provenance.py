"""Where a result came from: command, versions, commit, machine, date."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

DISTRIBUTIONS = (
    "bev-driving-env",
    "gymnasium",
    "highway-env",
    "numba",
    "numpy",
    "opencv-python-headless",
)


def provenance(argv: Sequence[str], seeds: Sequence[int]) -> dict[str, Any]:
    """Describe this run.

    Args:
        argv: Arguments of ``bev-bench``, without the program's name.
        seeds: Seeds of the run.

    Returns:
        A JSON-ready dict: command, seeds, versions, git_commit, python, machine, date_utc.
    """
    now = datetime.datetime.now(datetime.timezone.utc)
    return {
        "command": shlex.join(["bev-bench", *argv]),
        "seeds": list(seeds),
        "versions": {name: _version(name) for name in DISTRIBUTIONS},
        "git_commit": git_commit(),
        "python": sys.version.split()[0],
        "machine": f"{platform.machine()} {platform.system()}, {cpu_name()}",
        "date_utc": now.isoformat(timespec="seconds"),
    }


def git_commit() -> str | None:
    """Commit of the source tree this file is tracked in, with ``+`` if the tree has changes.

    None for an installed copy: a repository that merely surrounds it says nothing about it.
    """
    here = Path(__file__)
    if _git(here, "ls-files", "--error-unmatch", here.name) is None:
        return None
    commit = _git(here, "rev-parse", "HEAD")
    changes = _git(here, "status", "--porcelain", "--untracked-files=no")
    return commit + ("+" if changes else "") if commit else None


def cpu_name() -> str:
    """The processor's name, as the operating system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git(here: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(here.parent), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
