"""Replays of drives, kept in the run's folder, so that a report that was interrupted resumes."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bev_driving_env.files import write_json

from ..pool import results_of
from ..run_folder import used_hashes
from ..suites import Job
from . import replay


@dataclass(frozen=True)
class Shot:
    """Pictures of one moment with infractions.

    Attributes:
        time_s: Simulated time.
        names: What began there.
        frames: Pictures in the film.
        film: WebP image of the last seconds, see ``replay.film``.
        cameras: WebP image of the cameras at that moment.
    """

    time_s: float
    names: tuple[str, ...]
    frames: int
    film: bytes
    cameras: bytes


@dataclass(frozen=True)
class Replay:
    """A drive that was driven again.

    Attributes:
        shots: Each moment with infractions, in order, and the time limit if that ended it.
        failure: What the agent or the BEV source raised, or "".
    """

    shots: tuple[Shot, ...]
    failure: str = ""


def replays_of(
    jobs: Sequence[Job],
    folder: Path,
    workers: int,
    progress: Callable[[], object] = lambda: None,
) -> dict[str, Replay]:
    """Drive jobs again, those that are kept excepted.

    Args:
        jobs: What to drive.
        folder: Where replays are kept.
        workers: Processes; with 1 they are driven in this one.
        progress: Called after each.

    Returns:
        Replays by key of the job.
    """
    calls = [(job, folder) for job in dict.fromkeys(jobs)]
    found: dict[str, Replay] = {}
    for key, made in results_of(replayed, calls, workers):
        found[key] = made
        progress()
    return found


def replayed(job: Job, folder: Path) -> tuple[str, Replay]:
    """A job's key and its replay, from the folder if it is there and still holds.

    Failures are not kept: whatever was missing may be there next time.
    """
    path = folder / f"{job.key}.json"
    try:
        identity = _identity(job)
        kept = _read(path, identity)
        if kept is None:
            kept = Replay(tuple(_shot(each) for each in replay.last_seconds(job)))
            write_json(path, {"identity": identity, "shots": [_row(each) for each in kept.shots]})
    except (Exception, SystemExit) as error:  # a foreign driver's belong on its card
        return job.key, Replay((), f"{type(error).__name__}: {str(error).partition(chr(10))[0]}")
    return job.key, kept


def _identity(job: Job) -> dict[str, Any]:
    """What a kept replay depends on beside its job."""
    return {
        "hashes": used_hashes([job.agent], [job.bev]),
        "pictures": [
            replay.SECONDS,
            replay.EVERY_STEPS,
            replay.SIDE_PX,
            replay.FILM_QUALITY,
            replay.CAMERA_QUALITY,
            replay.LINE,
        ],
    }


def _shot(seen: replay.LastSeconds) -> Shot:
    return Shot(
        seen.time_s,
        seen.names,
        len(seen.frames),
        replay.film(seen.frames),
        replay.tiles(seen.cameras, seen.camera_names),
    )


def _row(shot: Shot) -> dict[str, Any]:
    row = asdict(shot)
    for name in ("film", "cameras"):
        row[name] = base64.b64encode(row[name]).decode()
    return row


def _read(path: Path, identity: dict[str, Any]) -> Replay | None:
    """What is kept; None if it is not there, damaged, or of other weights or sizes."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["identity"] != identity:
            return None
        return Replay(
            tuple(
                Shot(
                    row["time_s"],
                    tuple(row["names"]),
                    row["frames"],
                    base64.b64decode(row["film"]),
                    base64.b64decode(row["cameras"]),
                )
                for row in kept["shots"]
            )
        )
    except (FileNotFoundError, KeyError, TypeError, ValueError):
        return None
