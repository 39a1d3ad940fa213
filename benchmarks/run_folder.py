"""A run's output folder: whose it is, and what must be equal for a run to be resumed in it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.registry import agent_source
from bev_driving_env._version import __version__
from bev_driving_env.files import write_json
from bev_driving_env.provenance import file_hash, git_commit, provenance
from bev_driving_env.sources.expressions import sources_of
from bev_driving_env.sources.registry import source_file
from bev_driving_env.towns.registry import town_files

from .errors import OtherRunError

KEPT = ("episodes", "videos", "moments", "rescues", "cards", "open_loop", "drive_logs")
"""Folders of what is finished, in a run's folder."""


def open_run(
    out: Path,
    argv: Sequence[str],
    options: Mapping[str, Any],
    hashes: Mapping[str, str],
    seeds: Sequence[int],
    *,
    overwrite: bool,
) -> dict[str, Any]:
    """Make an output folder this run's own, or find that it already is.

    Args:
        out: The folder; created if need be.
        argv: The command.
        options: Those that make two runs the same, so that one may resume the other.
        hashes: Of the files that were used; likewise.
        seeds: Seeds of the run.
        overwrite: Whether to discard what the folder holds.

    Returns:
        Provenance: command, versions, commit, seeds, hashes and date.

    Raises:
        OtherRunError: The folder belongs to another run.
    """
    if overwrite:
        discard_run(out)
    note = provenance(argv, seeds, hashes)
    identity = {
        **options,
        "version": __version__,
        "git_commit": git_commit(),
        "hashes": dict(hashes),
    }
    claim_folder(out, identity, note)
    return note


def claim_folder(out: Path, identity: dict[str, Any], note: dict[str, Any]) -> None:
    """Make an output folder this run's own, or find that it already is.

    Args:
        out: The folder; created if need be.
        identity: What must be equal for kept episodes to belong to this run.
        note: Further description, stored beside it.

    Raises:
        OtherRunError: The folder belongs to a run with another identity.
    """
    path = out / "run.json"
    if path.exists():
        try:
            kept = dict(json.loads(path.read_text(encoding="utf-8"))["identity"])
        except (KeyError, TypeError, ValueError) as error:
            raise OtherRunError(f"{path} is not the file of a run: {error!r}") from error
        for key in {**identity, **kept}:
            if kept.get(key) != identity.get(key):
                raise OtherRunError(
                    f"{out} holds a run with {key} {kept.get(key)!r}, this one has "
                    f"{identity.get(key)!r}: choose another --out, or add --overwrite"
                )
        return
    if (out / "episodes").exists():
        raise OtherRunError(f"{out} holds episodes but no run.json: choose another --out")
    write_json(path, {"identity": identity, "provenance": note})


def discard_run(out: Path) -> None:
    """Remove a run's own files from an output folder, and nothing else."""
    if (out / "run.json").exists():
        for name in KEPT:
            shutil.rmtree(out / name, ignore_errors=True)
        (out / "run.json").unlink()


def used_hashes(
    agents: Sequence[str] = (), bevs: Sequence[str] = (), towns: Sequence[str] = ()
) -> dict[str, str]:
    """Hashes of the files of agents, BEV sources and towns that are not built in.

    A run is not resumed with a file that has changed.

    Args:
        agents: Agents, loaded.
        bevs: BEV sources, loaded.
        towns: Towns, loaded.
    """
    files = {spec: agent_source(spec) for spec in agents}
    files |= {name: source_file(name) for spec in bevs for name in sources_of(spec)}
    files |= {f"{spec} ({path.name})": path for spec in towns for path in town_files(spec)}
    return {name: file_hash(path) for name, path in files.items() if path is not None}


def footnote(note: Mapping[str, Any]) -> str:
    """Command, version, commit and date of a run in a line."""
    commit = note["git_commit"]
    where = f", commit {commit[:10]}{'+' if '+' in commit else ''}" if commit else ""
    version = note["versions"]["bev-driving-env"] or __version__
    return f"`{note['command']}`, version {version}{where}, {note['date_utc']}"
