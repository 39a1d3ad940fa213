"""``bev-bench report``: one page that says how far each got, where it failed, and why."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_text

from .drive import EpisodeResult
from .errors import OtherRunError
from .report import blame, closed_loop, open_loop, suite_sections, while_driving
from .report.document import Block, Section, csv_of, markdown_of, page_of
from .report.drivers import by_driver
from .report.failures import Failure, cards, chosen_failures
from .report.page import element
from .report.replay_store import Replay, replays_of

MOST_CARDS = 100
"""At some 35 kB each they stay below five megabytes."""
TITLE = "BEVTown: closed-loop report"


@dataclass(frozen=True)
class Findings:
    """All that a report is made of.

    Attributes:
        results: Of the run, in the order in which they were asked for.
        note: Where they came from.
        evaluations: Contents of ``evaluation.json`` files.
        attribution: Content of ``attribution.json``, or None.
    """

    results: Sequence[EpisodeResult]
    note: Mapping[str, Any]
    evaluations: Sequence[Mapping[str, Any]] = ()
    attribution: Mapping[str, Any] | None = None


def add_parser(verbs: Any) -> None:
    """Add the verb ``report``."""
    parser = verbs.add_parser(
        "report",
        help="write the report of a run",
        description="Write report.html, report.md and report.csv into a folder of bev-bench run: "
        "tables in the paper's layout with intervals, maps, the BEV while driving, and a card for "
        "each infraction, for which failed drives are driven again. The page is one file that "
        "needs no network.",
    )
    add = parser.add_argument
    add("run", type=Path, help="folder that bev-bench run wrote")
    add(
        "--perception",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="folders that bev-perception evaluate wrote: adds the open-loop tables",
    )
    add(
        "--attribution",
        type=Path,
        metavar="FOLDER",
        help="folder that bev-bench attribute wrote: adds what each channel cost",
    )
    add(
        "--cards",
        type=int,
        default=MOST_CARDS,
        metavar="N",
        help=f"infractions shown at most, of each driver in turn; default: {MOST_CARDS}",
    )
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores")
    add(
        "--out",
        type=Path,
        metavar="FILE.html",
        help="the page, with .md and .csv beside it; default: report.html in the run's folder",
    )
    parser.set_defaults(
        command=run, interrupted="; drives that were repeated are kept, the same command resumes"
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid; nothing has been written then.
    """
    if namespace.cards < 0:
        raise UsageError(f"--cards must be at least 0, got {namespace.cards}")
    if namespace.workers < 1:
        raise UsageError(f"--workers must be at least 1, got {namespace.workers}")
    out = namespace.out or namespace.run / "report.html"
    if out.suffix != ".html":
        raise UsageError(f"--out must end in .html, got {str(out)!r}")
    results, note = read_run(namespace.run)
    findings = Findings(
        results,
        note,
        [_read(folder / "evaluation.json") for folder in namespace.perception],
        None
        if namespace.attribution is None
        else _read(namespace.attribution / "attribution.json"),
    )
    sections = findings_sections(findings)
    chosen = chosen_failures(results, namespace.cards)
    replays = _replays(chosen, namespace.run / "cards", namespace.workers)
    if chosen:
        shown = tuple(cards(results, chosen, replays))
        sections.append(Section("failures", "How they failed", shown))
    sections.append(Section("origin", "Where this came from", origin(findings)))
    summary = _summary(results)
    write_text(out, page_of(TITLE, summary, sections))
    write_text(out.with_suffix(".md"), markdown_of(TITLE, summary, sections))
    write_text(out.with_suffix(".csv"), csv_of(sections))
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB; {out.stem}.md and {out.stem}.csv beside it")
    for reason in dict.fromkeys(each.failure for each in replays.values() if each.failure):
        print(f"some drives could not be repeated for their cards: {reason}", file=sys.stderr)
    return 0


def read_run(folder: Path) -> tuple[list[EpisodeResult], dict[str, Any]]:
    """Results of a finished run in the order in which they were asked for, and where it came from.

    Raises:
        OtherRunError: The folder holds no finished run.
    """
    whole = _read(folder / "results.json")
    try:
        # results.json holds rows; trajectories and the rest are in each episode's own file
        files = [folder / "episodes" / f"{row['key']}.json" for row in whole["episodes"]]
        results = [EpisodeResult.from_dict(_read(path)) for path in files]
        note = dict(whole["provenance"])
    except (KeyError, TypeError, ValueError) as error:
        raise OtherRunError(f"{folder} holds no run of this version: {error!r}") from error
    if not results:
        raise OtherRunError(f"{folder} holds a run without episodes")
    return results, note


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise OtherRunError(f"{path} does not exist: has the command finished?") from None
    except (TypeError, ValueError) as error:
        raise OtherRunError(f"{path} is damaged: {error}") from error


def findings_sections(findings: Findings) -> list[Section]:
    """Sections that need no driving.

    Raises:
        OtherRunError: What was read is not what the command writes.
    """
    results = findings.results
    routes: list[Block] = [closed_loop.route_table(results)]
    if results[0].job.conditions.terminate_on is not None:
        # drives that go on after an infraction are judged by their driving score
        routes.append(closed_loop.leaderboard_table(results))
    broken = closed_loop.broken_table(results)
    if broken:
        routes.append(broken)
    made = [
        Section("routes", "How far each got", tuple(routes)),
        Section(
            "maps",
            "Where they drove",
            tuple(closed_loop.trajectory_figures(results, findings.note)),
        ),
    ]
    if any(result.online for result in results):
        seen: list[Block] = [while_driving.iou_table(results), while_driving.places_table(results)]
        chart = while_driving.iou_against_metres(results)
        if chart:
            seen.append(chart)
        made.append(Section("seen", "What the policy saw on the way", tuple(seen)))
    if doses := suite_sections.dose_figures(results):
        made.append(Section("doses", "How much error is too much", tuple(doses)))
    if looks := suite_sections.look_table(results):
        made.append(Section("looks", "Under which looks", (looks,)))
    return [*made, *_read_sections(findings)]


def _read_sections(findings: Findings) -> list[Section]:
    """Sections of what other commands found."""
    made: list[Section] = []
    try:
        tables = open_loop.open_loop_tables(findings.evaluations)
        if tables:
            made.append(Section("open-loop", "What they see on drive logs", tuple(tables)))
        if findings.attribution is not None:
            rows = findings.attribution["attributions"], findings.attribution["rescues"]
            shares: tuple[Block, ...] = blame.lost_metres(rows[0])
            if rows[1]:
                shares = (*shares, blame.rescues_table(rows[1]))
            made.append(Section("attribution", "Which channel cost the metres", shares))
    except (KeyError, TypeError, ValueError) as error:
        raise OtherRunError(
            f"--perception or --attribution holds something else: {error!r}"
        ) from error
    return made


def _replays(chosen: Sequence[Failure], folder: Path, workers: int) -> dict[str, Replay]:
    jobs = list(dict.fromkeys(failure.result.job for failure in chosen))
    if not jobs:
        return {}
    with tqdm(total=len(jobs), unit="drive", desc="driving failures again") as bar:
        return replays_of(jobs, folder, workers, bar.update)


def _summary(results: Sequence[EpisodeResult]) -> str:
    clean = sum(result.clean for result in results)
    return (
        f"{len(results)} drives of {len(by_driver(results))} drivers, {clean} of them clean, "
        "through a rendered world with the geometry of CARLA's towns. It is not CARLA: what "
        "carries over is geometry, and how errors grow in closed loop."
    )


def origin(findings: Findings) -> tuple[Block, ...]:
    """Command, versions, hashes and commit of everything that was read."""
    notes = [findings.note, *(each["provenance"] for each in findings.evaluations)]
    if findings.attribution is not None:
        notes.append(findings.attribution["provenance"])
    made: list[Block] = []
    for note in notes:
        made.append(f"{note['command']}, {note['date_utc']}, commit {note['git_commit']}")
        whole = json.dumps(dict(note), indent=1)
        pre = element("pre", whole, tabindex=0, role="region", aria_label="All about this command")
        made.append(element("details", element("summary", "Versions, hashes and machine"), pre))
    return tuple(made)
