"""Running jobs on all cores, one file per finished episode, so that a run can be resumed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from agents.registry import SHIPPED
from bev_driving_env.files import write_json
from bev_driving_env.sources.expressions import TRUTH, sources_of
from bev_driving_env.sources.registry import bev_source_names
from bev_driving_env.towns.registry import compiled_town, route_book

from .drive import EpisodeResult, drive, never_driven
from .errors import OtherRunError
from .pool import Execute, Result, in_processes
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
Task = tuple[Job, Keepsakes]


def run_jobs(
    jobs: Sequence[Job],
    out: Path,
    workers: int,
    *,
    videos: bool = False,
    moments: bool = False,
    execute: Execute = in_processes,
) -> list[EpisodeResult]:
    """Drive all jobs that have no result yet, and return the results of all.

    Args:
        jobs: What to drive.
        out: Output folder; finished episodes are kept in its ``episodes`` folder.
        workers: Processes to use; with 1 what comes with BEVTown is driven in this one.
        videos: Also write an MP4 of each episode to the ``videos`` folder; an episode without one
            is driven again.
        moments: Also look at the policy's BEV at every step, unless it is the ground truth, and
            write what it was worth to the ``moments`` folder; likewise.
        execute: What drives them: worker processes, or a cluster.

    Returns:
        Results in the order of the jobs. If the process of an episode died, it has failed.

    Raises:
        OtherRunError: The folder holds something else, or machines of a cluster do not share it.
    """
    out = out.resolve()  # workers may have another working folder
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
    if execute is in_processes and workers == 1 and all(_is_trusted(job) for job, _ in missing):
        execute = in_this_process
    kept = len(jobs) - len(missing)
    with tqdm(total=len(jobs), initial=kept, unit="episode", desc="driving") as bar:
        for result in _drive_all(longest_first(missing), folder, workers, execute):
            results[result.job] = result
            bar.update()
    return [result for result in results.values() if result is not None]


def longest_first(tasks: Sequence[Task]) -> list[Task]:
    """Source by source, so that a worker has few environments at once, and long routes first.

    Workers that share the last few drives then do not wait long for one of them.
    """
    sources = list(dict.fromkeys(job.bev for job, _ in tasks))
    lengths: dict[tuple[str, str, int], float] = {}
    for job, _ in tasks:
        place = (job.town, job.routes, job.index)
        if place not in lengths:
            town = compiled_town(job.town)
            lengths[place] = route_book(job.town).route(job.routes, job.index, town).length_m
    return sorted(
        tasks,
        key=lambda task: (
            sources.index(task[0].bev),
            -lengths[task[0].town, task[0].routes, task[0].index],
        ),
    )


def _is_missing(result: EpisodeResult | None, wanted: Keepsakes) -> bool:
    """Whether an episode is to be driven; one that failed at once leaves nothing else."""
    return result is None or (wanted.are_missing() and not result.error)


def _drive_all(
    tasks: Sequence[Task], folder: Path, workers: int, execute: Execute
) -> Iterator[EpisodeResult]:
    died: list[Task] = []
    for task, result in _driven(tasks, folder, workers, execute):
        if result is None:
            died.append(task)
        else:
            yield result
    # by its own driver or predictor, or by what an earlier episode left behind, or for want of
    # memory: once more, alone, so that an episode fails for its own sake only
    for task, result in _driven(died, folder, 1, execute, apart=True):
        if result is None:
            failure = "the process that drove it died (see its output above, if there is any)"
            result = never_driven(task[0], failure)
            _keep(result, folder)
        yield result


def _driven(
    tasks: Sequence[Task], folder: Path, workers: int, execute: Execute, *, apart: bool = False
) -> Iterator[tuple[Task, EpisodeResult | None]]:
    """Drive, in any order; None in place of the result if the process died."""
    calls = [(job, folder, wanted) for job, wanted in tasks]
    for number, result in execute(drive_and_keep, calls, workers, apart=apart):
        if result is not None and not _path(folder, result.job).exists():
            raise OtherRunError(
                f"{_path(folder, result.job)} was written, but not where this process can see it: "
                f"choose an --out in a folder that all machines of the cluster share"
            )
        yield tasks[number], result


def in_this_process(
    function: Callable[..., Result],
    calls: Iterable[tuple[Any, ...]],
    workers: int,
    *,
    apart: bool = False,
) -> Iterator[tuple[int, Result | None]]:
    """One call after the other, without the second or two that a worker takes to start."""
    for number, arguments in enumerate(calls):
        yield number, function(*arguments)


def _is_trusted(job: Job) -> bool:
    """Whether nothing foreign drives or predicts, which could bring down its process."""
    known = bev_source_names()
    return job.agent in ("expert", *SHIPPED) and all(
        source in known for source in sources_of(job.bev)
    )


def drive_and_keep(job: Job, folder: Path, wanted: Keepsakes = NOTHING) -> EpisodeResult:
    """Drive one job and write its result, and what else is wanted of it."""
    result = drive(job, *wanted)
    _keep(result, folder)
    return result


def _keep(result: EpisodeResult, folder: Path) -> None:
    # the run's own file, one folder up, holds command, versions, commit and date
    write_json(_path(folder, result.job), {**result.as_dict(), "run": "../run.json"})


def _path(folder: Path, job: Job) -> Path:
    return folder / f"{job.key}.json"


def read_result(folder: Path, job: Job) -> EpisodeResult | None:
    """The kept result of a job, or None if it has to be driven."""
    path = _path(folder, job)
    try:
        result = EpisodeResult.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (KeyError, TypeError, ValueError) as error:
        raise OtherRunError(f"{path} is not an episode result: {error!r}") from error
    if result.job != job:
        raise OtherRunError(f"{path} holds the result of another job: {result.job}")
    return result
