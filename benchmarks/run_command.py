"""``bev-bench run``: drive a suite and write its table, rows and maps."""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents import make_agent
from agents.registry import FORMS, agent_source
from bev_driving_env._version import __version__
from bev_driving_env.command_line import UsageError
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.files import write_bytes, write_json, write_text
from bev_driving_env.provenance import file_hash, git_commit, provenance
from bev_driving_env.sources.corrupted import CORRUPTIONS
from bev_driving_env.sources.expressions import sources_of, with_errors
from bev_driving_env.sources.registry import bev_source_names, source_file
from bev_driving_env.towns.registry import town_files, town_name
from bev_driving_env.world.traffic import PRESETS

from .dose_response import curves, dose_table, draw_curves
from .drive import EpisodeResult
from .maps import draw_trajectories, png_bytes
from .pool import Execute, in_processes
from .ray_pool import check_ray, ray_cluster
from .results import as_csv, as_json, score
from .runner import claim_folder, run_jobs
from .suites import SUITES, Suite, jobs_of
from .tables import SEEN, appearance_table, leaderboard_table, seen_table, table

EXECUTORS = ("processes", "ray")


@dataclass(frozen=True)
class RunOptions:
    """Options of ``bev-bench run``.

    Attributes:
        suite: Name of the suite.
        bev: BEV sources.
        agent: Agents.
        town: Towns.
        seed: Seeds; each episode is driven once with each.
        out: Output folder.
        workers: Processes.
        overwrite: Discard what the output folder holds.
        video: Whether to write a video of each episode.
        online: Whether to measure the policy's BEV at every step.
        traffic: Traffic instead of the suite's own; None for the suite's own.
        executor: What drives: ``"processes"`` of this machine, or a cluster of ``"ray"``.
        ray_address: Of the cluster; None for ``RAY_ADDRESS``, or else one that is started here.
    """

    suite: str
    bev: tuple[str, ...]
    agent: tuple[str, ...]
    town: tuple[str, ...]
    seed: tuple[int, ...]
    out: Path
    workers: int
    overwrite: bool
    video: bool
    online: bool = True
    traffic: str | None = None
    executor: str = "processes"
    ray_address: str | None = None

    def __post_init__(self) -> None:
        SUITES[self.suite].with_traffic(self.traffic)
        for value in self.town:
            town_name(value)
        if self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        if min(self.seed) < 0:
            raise ValueError(f"--seed must be at least 0, got {min(self.seed)}")
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
        """The options that make two runs the same."""
        return {
            "suite": self.suite,
            "traffic": self.driven_suite.conditions.traffic,
            "bev": list(self.bev),
            "agent": list(self.agent),
            "town": list(self.town),
            "seed": list(self.seed),
        }


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
    parser.add_argument("--suite", choices=tuple(SUITES), default="paper", help="default: paper")
    parser.add_argument(
        "--bev",
        nargs="+",
        default=["ground_truth"],
        metavar="SOURCE",
        help=f"BEV sources: {', '.join(bev_source_names())}, 'module:factory' or the path of a "
        f"checkpoint; default: ground_truth",
    )
    parser.add_argument(
        "--agent", nargs="+", default=["expert"], metavar="AGENT", help=f"{FORMS}; default: expert"
    )
    parser.add_argument(
        "--town",
        nargs="+",
        default=["Town01", "Town02"],
        metavar="TOWN",
        help="towns, or 'module:name' of those that a module registers; default: both",
    )
    parser.add_argument(
        "--traffic",
        choices=PRESETS,
        help="other road users, for suites that have some; default: the suite's own (light)",
    )
    parser.add_argument("--seed", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores"
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
        "--overwrite", action="store_true", help="discard what the folder already holds"
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
            suite=namespace.suite,
            bev=tuple(dict.fromkeys(namespace.bev)),
            agent=tuple(dict.fromkeys(namespace.agent)),
            town=tuple(dict.fromkeys(namespace.town)),
            seed=tuple(dict.fromkeys(namespace.seed)),
            out=namespace.out,
            workers=namespace.workers,
            overwrite=namespace.overwrite,
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
    hashes = {
        **agent_hashes(options.agent),
        **source_hashes(options.bev),
        **town_hashes(options.town),
    }
    note = provenance(argv, options.seed, hashes)
    with _executor(options) as execute:
        if options.overwrite:
            discard_run(options.out)
        claim_folder(options.out, run_identity(options.identity, hashes), note)
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


def agent_hashes(specs: Sequence[str]) -> dict[str, str]:
    """Hash of the source file of each agent that is not built in, once it is loaded.

    A run is not resumed with an agent whose file has changed.
    """
    sources = {spec: agent_source(spec) for spec in specs}
    return {spec: file_hash(path) for spec, path in sources.items() if path is not None}


def source_hashes(specs: Sequence[str]) -> dict[str, str]:
    """Hash of the file that each BEV source which is not built in comes from."""
    files = {name: source_file(name) for spec in specs for name in sources_of(spec)}
    return {spec: file_hash(path) for spec, path in files.items() if path is not None}


def town_hashes(specs: Sequence[str]) -> dict[str, str]:
    """Hash of the module and the routes of each town that is not built in."""
    files = [(spec, path) for spec in specs for path in town_files(spec)]
    return {f"{spec} ({path.name})": file_hash(path) for spec, path in files}


def checked_specs(bevs: Sequence[str], agents: Sequence[str], town: str, suite: Suite) -> None:
    """See to it that sources and agents can be made, in one line, rather than in every episode.

    It also compiles, before workers start.

    Raises:
        ValueError: One cannot.
    """
    for source in bevs:
        # with the smallest dose of every error model, where there will be errors
        doses = dict.fromkeys(CORRUPTIONS, min(suite.doses)) if suite.doses else {}
        for spec in dict.fromkeys((source, with_errors(source, doses))):
            env = BEVTownEnv(town, bev_source=spec, **suite.conditions.keywords)
    for spec in agents:
        make_agent(spec, env)


def run_identity(options: Mapping[str, Any], hashes: Mapping[str, str]) -> dict[str, Any]:
    """What makes two runs the same, so that one may resume the other."""
    return {
        **options,
        "version": __version__,
        "git_commit": git_commit(),
        "hashes": dict(hashes),
    }


def discard_run(out: Path) -> None:
    """Remove a run's own files from an output folder, and nothing else."""
    if (out / "run.json").exists():
        kept = ("episodes", "videos", "moments", "rescues", "cards", "open_loop", "drive_logs")
        for name in kept:
            shutil.rmtree(out / name, ignore_errors=True)
        (out / "run.json").unlink()


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
    for town in options.town:
        # trajectories of sixty drivers hide each other: of those as they are
        shown = [result for result in results if result.job.bev in options.bev]
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


def footnote(note: Mapping[str, Any]) -> str:
    """Command, version, commit and date of a run in a line."""
    commit = note["git_commit"]
    where = f", commit {commit[:10]}{'+' if '+' in commit else ''}" if commit else ""
    version = note["versions"]["bev-driving-env"] or __version__
    return f"`{note['command']}`, version {version}{where}, {note['date_utc']}"


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
