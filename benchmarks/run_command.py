"""``bev-bench run``: drive a suite and write its table, rows and maps."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_bytes, write_json, write_text
from bev_driving_env.sources.expressions import TRUTH
from bev_driving_env.towns.registry import town_name
from bev_driving_env.world.traffic import PRESETS

from .dose_response import curves, dose_table, draw_curves
from .drive import EpisodeResult
from .maps import draw_trajectories, png_bytes, told_apart
from .pool import Execute, in_processes
from .ray_pool import check_ray, ray_cluster
from .results import as_csv, as_json, score
from .run_folder import footnote, open_run, used_hashes
from .runner import run_jobs
from .suite_options import SuiteOptions, add_suite_arguments, checked_specs, suite_values
from .suites import SUITES, Suite, jobs_of
from .tables import SEEN, appearance_table, leaderboard_table, seen_table, table

EXECUTORS = ("processes", "ray")


@dataclass(frozen=True)
class RunOptions(SuiteOptions):
    """Options of ``bev-bench run``.

    Attributes:
        video: Whether to write a video of each episode.
        online: Whether to measure the policy's BEV at every step.
        traffic: Traffic instead of the suite's own; None for the suite's own.
        executor: What drives: ``"processes"`` of this machine, or a cluster of ``"ray"``.
        ray_address: Of the cluster; None for ``RAY_ADDRESS``, or else one that is started here.

    Raises:
        ValueError: A value is out of range, or Ray is not there.
    """

    video: bool
    online: bool = True
    traffic: str | None = None
    executor: str = "processes"
    ray_address: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        SUITES[self.suite].with_traffic(self.traffic)
        if self.ray_address is not None and self.executor != "ray":
            raise ValueError(f"--ray-address {self.ray_address} needs --executor ray")
        if self.executor == "ray":
            check_ray()

    @property
    def driven_suite(self) -> Suite:
        """The suite, with the traffic that was asked for."""
        return SUITES[self.suite].with_traffic(self.traffic)

    @property
    def identity(self) -> dict[str, Any]:
        """The options that make two runs the same, JSON-ready."""
        return {**super().identity, "traffic": self.driven_suite.conditions.traffic}


def add_parser(verbs: Any) -> None:
    """Add the verb ``run``."""
    suites = "\n".join(f"  {suite.name:12s}{suite.summary}" for suite in SUITES.values())
    parser = verbs.add_parser(
        "run",
        help="drive a suite and print its table",
        description="Drive every episode of a suite and write the results: table.md, results.json, "
        "episodes.csv, map_<town>.png, and dose_response.png of suite corruptions. A run that was "
        "interrupted resumes.",
        epilog=f"suites:\n{suites}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_suite_arguments(parser, "expert", [TRUTH])
    parser.add_argument(
        "--traffic",
        choices=PRESETS,
        help="other road users, for suites that have some; default: the suite's own (light)",
    )
    parser.add_argument(
        "--executor",
        choices=EXECUTORS,
        default=EXECUTORS[0],
        help="processes of this machine, or a Ray cluster; default: processes",
    )
    parser.add_argument(
        "--ray-address",
        metavar="ADDRESS",
        help="of a running cluster, whose machines share the folder OUT; all its CPUs are used. "
        "Default: RAY_ADDRESS, or else a cluster of --workers CPUs on this machine",
    )
    parser.add_argument(
        "--video", action="store_true", help="also write an MP4 of each episode to OUT/videos"
    )
    parser.add_argument(
        "--no-online",
        action="store_true",
        help="do not measure the policy's BEV at every step, which takes some milliseconds each",
    )
    parser.set_defaults(
        command=run,
        interrupted="; finished episodes are kept, the same command resumes (without --overwrite)",
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 1 if an agent failed in some episode, else 0.

    Raises:
        UsageError: The arguments are not valid; nothing has been written then.
    """
    try:
        options = RunOptions(
            **suite_values(namespace),
            video=namespace.video,
            online=not namespace.no_online,
            traffic=namespace.traffic,
            executor=namespace.executor,
            ray_address=namespace.ray_address,
        )
        suite = options.driven_suite
        jobs = list(jobs_of(suite, options.town, options.bev, options.agent, options.seed))
        checked_specs(options.bev, options.agent, options.town[0], suite)
    except ValueError as error:
        raise UsageError(str(error)) from error
    hashes = used_hashes(options.agent, options.bev, options.town)
    with _executor(options) as execute:
        note = open_run(
            options.out, argv, options.identity, hashes, options.seed, overwrite=options.overwrite
        )
        results = run_jobs(
            jobs,
            options.out,
            options.workers,
            videos=options.video,
            moments=options.online,
            execute=execute,
        )
    _write(options, results, note)
    return _report(options, results)


def _executor(options: RunOptions) -> contextlib.AbstractContextManager[Execute]:
    """What drives the episodes."""
    if options.executor == "ray":
        return ray_cluster(options.ray_address, options.workers)
    return contextlib.nullcontext(in_processes)


def _write(options: RunOptions, results: Sequence[EpisodeResult], note: dict[str, Any]) -> None:
    write_json(options.out / "results.json", as_json(results, note))
    write_text(options.out / "episodes.csv", as_csv(results, note))
    suite = options.driven_suite
    traffic = f", traffic `{suite.conditions.traffic}`" if suite.leaderboard else ""
    lines = [_table(suite, results), ""]
    if any(result.online for result in results):
        lines += [f"{SEEN}\n\n{seen_table(results)}", ""]
    lines += [f"Suite `{suite.name}`{traffic}. {footnote(note)}", ""]
    write_text(options.out / "table.md", "\n".join(lines))
    if suite.doses:
        write_bytes(options.out / "dose_response.png", draw_curves(curves(results), note))
    shown = told_apart(results)
    for town in options.town:
        image = draw_trajectories(town, shown)
        write_bytes(options.out / f"map_{town_name(town)}.png", png_bytes(image, note))


def _table(suite: Suite, results: Sequence[EpisodeResult]) -> str:
    """The table that belongs to a suite."""
    if suite.doses:
        return dose_table(curves(results))
    scores = score(results, by_look=bool(suite.appearances))
    if suite.appearances:
        return appearance_table(scores)
    return leaderboard_table(scores) if suite.leaderboard else table(scores)


def _report(options: RunOptions, results: Sequence[EpisodeResult]) -> int:
    print(_table(options.driven_suite, results))
    failed = [result for result in results if result.error]
    # one of each driver and source: the others of it mostly fail alike
    first = {(result.job.agent, result.job.bev): result for result in reversed(failed)}
    for (agent, bev), result in sorted(first.items()):
        print(f"{agent} on {bev} failed in {result.job.key}: {result.failure}", file=sys.stderr)
    if failed:
        print(f"{len(failed)} episodes failed; tracebacks are in results.json", file=sys.stderr)
    figure = ", dose_response.png" if options.driven_suite.doses else ""
    print(f"\nresults in {options.out}: table.md, results.json, episodes.csv, map_*.png{figure}")
    return 1 if failed else 0
