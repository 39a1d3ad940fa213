"""``bev-bench attribute``: which channel cost the metres, and when a failed drive was lost."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_json, write_text
from bev_driving_env.frames import CHANNELS
from bev_driving_env.markdown import markdown
from bev_driving_env.sources.expressions import TRUTH
from perception.evaluation_tables import short_name

from .attribution import Attribution, attribute, substitutions
from .pool import results_of
from .rewind import Rescue, rewind
from .run_folder import open_run, used_hashes
from .runner import run_jobs
from .suite_options import (
    SuiteOptions,
    add_suite_arguments,
    checked_specs,
    distinct,
    suite_values,
)
from .suites import SUITES, Job, jobs_of


@dataclass(frozen=True)
class AttributeOptions(SuiteOptions):
    """Options of ``bev-bench attribute``.

    Attributes:
        channels: Those that are replaced.
        rewind: Whether failed drives are rewound.

    Raises:
        ValueError: A value is out of range, or there is nothing to attribute.
    """

    channels: tuple[str, ...]
    rewind: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        if TRUTH in self.bev:
            raise ValueError(f"{TRUTH} has no errors to attribute: leave it out of --bev")

    @property
    def identity(self) -> dict[str, Any]:
        """The options that make two runs the same, JSON-ready."""
        return {"verb": "attribute", **super().identity, "channels": list(self.channels)}


def add_parser(verbs: Any) -> None:
    """Add the verb ``attribute``."""
    parser = verbs.add_parser(
        "attribute",
        help="find the channel that cost the metres",
        description="Drive a suite with every subset of channels replaced by the truth, and share "
        "the lost metres among the channels (Shapley values). Then rewind each failed drive until "
        "replacing a single channel saves it: the point of no return. Writes attribution.md and "
        ".json; resumes.",
    )
    add_suite_arguments(parser, "bc")
    add = parser.add_argument
    add(
        "--channels",
        nargs="+",
        choices=CHANNELS,
        metavar="NAME",
        help=f"channels to replace, of {', '.join(CHANNELS)}; default: all that the suite shows "
        "(without traffic: road, route, lane)",
    )
    add("--no-rewind", action="store_true", help="share the metres only")
    parser.set_defaults(
        command=run,
        interrupted="; finished drives are kept, the same command resumes (without --overwrite)",
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid; nothing has been written then.
    """
    try:
        options, jobs = _checked(namespace)
    except ValueError as error:
        raise UsageError(str(error)) from error
    hashes = used_hashes(options.agent, options.bev, options.town)
    note = open_run(
        options.out, argv, options.identity, hashes, options.seed, overwrite=options.overwrite
    )
    drives = substitutions(jobs, options.channels)
    results = dict(zip(drives, run_jobs(drives, options.out, options.workers), strict=True))
    found = [attribute(job, options.channels, results) for job in jobs]
    failed = [each.job for each in found if not each.result.clean and not each.result.error]
    rescues = _rescues(options, failed) if options.rewind else {}
    text = report(found, rescues, options.channels)
    write_json(
        options.out / "attribution.json",
        {
            "provenance": note,
            "attributions": [each.as_dict() for each in found],
            "rescues": [
                {"job": job.as_dict(), **asdict(rescue)} for job, rescue in rescues.items()
            ],
        },
    )
    write_text(options.out / "attribution.md", f"{text}\n")
    print(text)
    print(f"\nwritten to {options.out}")
    return 0


def _checked(namespace: argparse.Namespace) -> tuple[AttributeOptions, list[Job]]:
    suite = SUITES[namespace.suite]
    shown = CHANNELS if suite.conditions.traffic != "none" else CHANNELS[:3]
    options = AttributeOptions(
        **suite_values(namespace),
        channels=distinct(namespace.channels or shown),
        rewind=not namespace.no_rewind,
    )
    jobs = list(jobs_of(suite, options.town, options.bev, options.agent, options.seed))
    checked_specs(options.bev, options.agent, options.town[0], suite)
    return options, jobs


def _rescues(options: AttributeOptions, failed: Sequence[Job]) -> dict[Job, Rescue]:
    """Rewinds of failed drives; those that are done are read."""
    folder = options.out / "rescues"
    found: dict[Job, Rescue | None] = {}
    left: list[Job] = []
    for job in failed:
        path = folder / f"{job.key}.json"
        if path.exists():
            found[job] = Rescue.from_dict(json.loads(path.read_text(encoding="utf-8"))["rescue"])
        else:
            left.append(job)
    with tqdm(total=len(failed), initial=len(found), unit="drive", desc="rewinding") as bar:
        calls = [(job, options.channels, folder) for job in left]
        for job, rescue in results_of(rewind_and_keep, calls, options.workers):
            found[job] = rescue
            bar.update()
    return {job: rescue for job in failed if (rescue := found[job]) is not None}


def rewind_and_keep(job: Job, channels: Sequence[str], folder: Path) -> tuple[Job, Rescue | None]:
    """Rewind a failed drive and write what was found."""
    rescue = rewind(job, channels)
    kept = None if rescue is None else asdict(rescue)
    write_json(folder / f"{job.key}.json", {"job": job.as_dict(), "rescue": kept})
    return job, rescue


def report(
    found: Sequence[Attribution], rescues: Mapping[Job, Rescue], channels: Sequence[str]
) -> str:
    """Both findings as Markdown."""
    shares = markdown(
        ["BEV source", "Agent", "Town", "Clean", "Lost (m)", *channels],
        [list(row) for row in _shares(found, channels)],
        text_columns=3,
    )
    parts = [
        "# Which channel cost the metres\n\n"
        "Metres lost before the first infraction, against driving on the truth, and what of them "
        "each channel's errors cost (Shapley values over all subsets of channels set to the "
        f"truth; they add up to the loss).\n\n{shares}"
    ]
    if rescues:
        header = ["BEV source", "Town", "Episode", "Seed", "Failure", "at (m)"]
        header += ["Last saved (m before)", "by"]
        table = markdown(header, [_rescue_row(*item) for item in rescues.items()], text_columns=2)
        parts.append(
            "# When failed drives were lost\n\nThe last moment from which one channel set to the "
            f"truth saves the drive.\n\n{table}"
        )
    return "\n\n".join(parts)


def _shares(found: Sequence[Attribution], channels: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """A row a source, agent and town, summed up over its drives."""
    groups: dict[tuple[str, str, str], list[Attribution]] = {}
    for each in found:
        groups.setdefault((each.job.bev, each.job.agent, each.job.town), []).append(each)
    for (bev, agent, town), rows in groups.items():
        cost = [sum(row.cost_m[name] for row in rows) for name in channels]
        lost = sum(row.lost_m for row in rows)
        clean = sum(row.result.clean for row in rows)
        cells = [f"{clean}/{len(rows)}", *(str(round(value)) for value in (lost, *cost))]
        yield (short_name(bev), agent, town, *cells)


def _rescue_row(job: Job, rescue: Rescue) -> list[str]:
    point = rescue.point_of_no_return
    row = [short_name(job.bev), job.town, str(job.index), str(job.seed)]
    row += [rescue.failure, f"{rescue.failure_m:.0f}"]
    if point is None:
        return [*row, "-", "no channel alone"]
    return [*row, f"{rescue.failure_m - point.route_m:.1f}", ", ".join(point.saved_by)]
