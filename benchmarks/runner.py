"""Running jobs on all cores, one file per finished episode, so that a run can be resumed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from bev_driving_env.files import write_json

from .drive import EpisodeResult, drive, never_driven
from .errors import OtherRunError
from .pool import in_processes
from .suites import Job


class Keepsakes(NamedTuple):
    """What is kept of an episode beside its result; None for what is not.

    Attributes:
        video: MP4 file.
        moments: ``.npz`` file of what the policy's BEV was worth, see ``online.OnlineMetrics``.
    """

    video: Path | None = None
    moments: Path | None = None

    def are_missing(self) -> bool:
        """Whether one of them is not there."""
        return any(path is not None and not path.exists() for path in self)


NOTHING = Keepsakes()
TRUTH = "ground_truth"
Task = tuple[Job, Keepsakes]


def run_jobs(
    jobs: Sequence[Job],
    out: Path,
    workers: int,
    *,
    videos: bool = False,
    moments: bool = False,
) -> list[EpisodeResult]:
    """Drive all jobs that have no result yet, and return the results of all.

    Args:
        jobs: What to drive.
        out: Output folder; finished episodes are kept in its ``episodes`` folder.
        workers: Processes to use; with 1 the episodes are driven in this one.
        videos: Also write an MP4 of each episode to the ``videos`` folder; an episode without one
            is driven again.
        moments: Also look at the policy's BEV at every step, unless it is the ground truth, and
            write what it was worth to the ``moments`` folder; likewise.

    Returns:
        Results in the order of the jobs.
    """
    folder = out / "episodes"
    results = {job: read_result(folder, job) for job in jobs}
    wanted = {
        job: Keepsakes(
            out / "videos" / f"{job.key}.mp4" if videos else None,
            # the truth is worth the truth
            out / "moments" / f"{job.key}.npz" if moments and job.bev != TRUTH else None,
        )
        for job in jobs
    }
    missing = [(job, kept) for job, kept in wanted.items() if _is_missing(results[job], kept)]
    kept = len(jobs) - len(missing)
    with tqdm(total=len(jobs), initial=kept, unit="episode", desc="driving") as bar:
        for result in _drive_all(missing, folder, workers):
            results[result.job] = result
            bar.update()
    return [result for result in results.values() if result is not None]


def _is_missing(result: EpisodeResult | None, wanted: Keepsakes) -> bool:
    """Whether an episode is to be driven; one that failed at once leaves nothing else."""
    return result is None or (wanted.are_missing() and not result.error)


def _drive_all(jobs: Sequence[Task], folder: Path, workers: int) -> Iterator[EpisodeResult]:
    if workers == 1 or len(jobs) <= 1:
        for job, wanted in jobs:
            yield drive_and_keep(job, folder, wanted)
        return
    left = dict(jobs)
    try:
        for result in _drive_in_pool(jobs, folder, workers):
            del left[result.job]
            yield result
    except BrokenProcessPool:
        # a driver or predictor brought its process down, and the others' with it: one at a time,
        # so that it is known which
        for job, wanted in left.items():
            yield _drive_apart(job, folder, wanted)


def _drive_in_pool(jobs: Sequence[Task], folder: Path, workers: int) -> Iterator[EpisodeResult]:
    calls = [(job, folder, wanted) for job, wanted in jobs]
    return in_processes(drive_and_keep, calls, workers)


def _drive_apart(job: Job, folder: Path, wanted: Keepsakes) -> EpisodeResult:
    """Drive a job in a process of its own; if that dies, the episode has failed."""
    result = read_result(folder, job)
    if result is not None and not _is_missing(result, wanted):
        return result  # it was finished, and its process died over the next one
    try:
        (result,) = _drive_in_pool([(job, wanted)], folder, 1)
    except BrokenProcessPool:
        failure = "the process that drove this episode died (see its output above, if there is any)"
        result = never_driven(job, failure)
        _keep(result, folder)
    return result


def drive_and_keep(job: Job, folder: Path, wanted: Keepsakes = NOTHING) -> EpisodeResult:
    """Drive one job and write its result, and what else is wanted of it."""
    result = drive(job, *wanted)
    _keep(result, folder)
    return result


def _keep(result: EpisodeResult, folder: Path) -> None:
    # the run's own file, one folder up, holds command, versions, commit and date
    path = folder / f"{result.job.key}.json"
    write_json(path, {**result.as_dict(), "run": "../run.json"})


def read_result(folder: Path, job: Job) -> EpisodeResult | None:
    """The kept result of a job, or None if it has to be driven."""
    path = folder / f"{job.key}.json"
    try:
        result = EpisodeResult.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (KeyError, TypeError, ValueError) as error:
        raise OtherRunError(f"{path} is not an episode result: {error!r}") from error
    if result.job != job:
        raise OtherRunError(f"{path} holds the result of another job: {result.job}")
    return result


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
