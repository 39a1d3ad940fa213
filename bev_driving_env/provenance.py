"""Where a result came from: command, versions, commit, machine, date."""

from __future__ import annotations

import datetime
import hashlib
import importlib.metadata
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
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


def provenance(
    argv: Sequence[str], seeds: Sequence[int], hashes: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Describe this run.

    Args:
        argv: Arguments of ``bev-bench``, without the program's name.
        seeds: Seeds of the run.
        hashes: Hashes of files the results depend on, such as an agent's source.

    Returns:
        A JSON-ready dict: command, seeds, hashes, versions, git_commit, python, machine, date_utc.
    """
    now = datetime.datetime.now(datetime.timezone.utc)
    return {
        "command": shlex.join(["bev-bench", *argv]),
        "seeds": list(seeds),
        "hashes": dict(hashes or {}),
        "versions": {name: _version(name) for name in DISTRIBUTIONS},
        "git_commit": git_commit(),
        "python": sys.version.split()[0],
        "machine": f"{platform.machine()} {platform.system()}, {cpu_name()}",
        "date_utc": now.isoformat(timespec="seconds"),
    }


def git_commit() -> str | None:
    """Commit of the source tree this file is tracked in.

    If tracked files have changes, ``+`` and a hash of the changes follow. None for an installed
    copy: a repository that merely surrounds it says nothing about it.
    """
    here = Path(__file__)
    if _git(here, "ls-files", "--error-unmatch", here.name) is None:
        return None
    commit = _git(here, "rev-parse", "HEAD")
    changes = _git(here, "diff", "HEAD")
    if commit and changes:
        return f"{commit}+{hashlib.sha256(changes.encode()).hexdigest()[:8]}"
    return commit or None


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


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
