"""``bev-bench report``: one HTML file that says how far each got, where it failed, and why."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_text
from bev_driving_env.frames import CHANNELS
from perception.evaluation_tables import short_name

from .drive import EpisodeResult
from .errors import OtherRunError
from .online import pooled
from .report import charts, page, sections, suite_sections
from .report.page import Content, Markup, element

MOST_CARDS = 40
"""As many fit into five megabytes."""


def add_parser(verbs: Any) -> None:
    """Add the verb ``report``."""
    parser = verbs.add_parser(
        "report",
        help="write the report of a run",
        description="Write report.html into a folder of bev-bench run: tables in the paper's "
        "layout with intervals, maps, the BEV while driving, and a card for each failed drive. "
        "One file, no network. What bev-bench attribute found is added if its folder is given.",
    )
    parser.add_argument("run", type=Path, help="folder that bev-bench run wrote")
    parser.add_argument(
        "--attribution", type=Path, metavar="FOLDER", help="folder that bev-bench attribute wrote"
    )
    parser.add_argument(
        "--cards",
        type=int,
        default=MOST_CARDS,
        metavar="N",
        help=f"failed drives shown at most, of each driver in turn; default: {MOST_CARDS}",
    )
    parser.add_argument("--out", type=Path, help="default: report.html in the folder of the run")
    parser.set_defaults(command=run, interrupted="")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The folder holds no finished run.
    """
    if namespace.cards < 0:
        raise UsageError(f"--cards must be at least 0, got {namespace.cards}")
    try:
        results, note = read_run(namespace.run)
        attribution = None
        if namespace.attribution is not None:
            attribution = _read(namespace.attribution / "attribution.json")
    except OtherRunError as error:
        raise UsageError(str(error)) from error
    out = namespace.out or namespace.run / "report.html"
    write_text(out, report(results, note, attribution, namespace.cards))
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    return 0


def read_run(folder: Path) -> tuple[list[EpisodeResult], dict[str, Any]]:
    """Results of a finished run in the order in which they were asked for, and where it came from.

    Raises:
        OtherRunError: The folder holds no finished run.
    """
    whole = _read(folder / "results.json")
    results = []
    for row in whole["episodes"]:
        # results.json holds rows; trajectories and the rest are in each episode's own file
        results.append(EpisodeResult.from_dict(_read(folder / "episodes" / f"{row['key']}.json")))
    return results, dict(whole["provenance"])


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise OtherRunError(f"{path} does not exist: has the run finished?") from None
    except ValueError as error:
        raise OtherRunError(f"{path} is damaged: {error}") from error


def report(
    results: Sequence[EpisodeResult],
    note: Mapping[str, Any],
    attribution: Mapping[str, Any] | None,
    most_cards: int,
) -> str:
    """The whole page as HTML."""
    parts: list[tuple[str, str, Content]] = [
        ("routes", "How far each got", sections.route_table(results)),
        ("maps", "Where they drove", sections.maps(results, note)),
    ]
    if any(result.online for result in results):
        seen = [*sections.seen_tables(results), iou_against_metres(results)]
        parts.append(("seen", "What the policy saw on the way", seen))
    if attribution is not None:
        parts.append(("attribution", "Which channel cost the metres", blame(attribution)))
    if doses := suite_sections.dose_figures(results):
        parts.append(("doses", "How much error is too much", doses))
    if looks := suite_sections.look_table(results):
        parts.append(("looks", "Under which looks", looks))
    failures = sections.chosen_failures(results, most_cards)
    if failures:
        with tqdm(total=len(failures), unit="card", desc="driving failures again") as bar:
            parts.append(
                ("failures", "How they failed", sections.cards(results, most_cards, bar.update))
            )
    parts.append(("origin", "Where this came from", origin(note)))
    drivers = len(sections.by_driver(results))
    summary = element(
        "p",
        f"{len(results)} drives of {drivers} drivers through a rendered world with CARLA's town "
        "geometry. It is not CARLA: results carry over as far as geometry and the growth of errors "
        "in closed loop do.",
    )
    return page.page("BEVTown: closed-loop report", summary, parts)


def iou_against_metres(results: Sequence[EpisodeResult]) -> Markup:
    """What the paper asks: does a higher mean IoU drive farther?"""
    points = []
    for (bev, agent), drives in sections.by_driver(results).items():
        for town in dict.fromkeys(drive.job.town for drive in drives):
            here = [drive for drive in drives if drive.job.town == town]
            seen = pooled(drive.online for drive in here)["all"]
            mean = sum(seen.iou[name] for name in CHANNELS[:3]) / 3.0
            share = 100.0 * sum(d.driven_m for d in here) / sum(d.planned_m for d in here)
            if mean == mean:  # drives on the truth have no IoU to speak of
                name = sections.label((bev, agent), several_agents=False)
                points.append(
                    charts.Point(mean, share, name, f"{name}, {town}: {mean:.3f}, {share:.0f} %")
                )
    chart = charts.scatter(points, "mean IoU of road, route, lane while driving", "route driven, %")
    return page.figure(chart, "Each mark is a predictor in a town.")


def blame(attribution: Mapping[str, Any]) -> list[Markup]:
    """Bars of lost metres by channel, and when failed drives were lost."""
    rows: dict[str, dict[str, float]] = {}
    for each in attribution["attributions"]:
        name = f"{short_name(each['job']['bev'])}, {each['job']['town']}"
        row = rows.setdefault(name, dict.fromkeys(each["cost_m"], 0.0))
        for channel, cost in each["cost_m"].items():
            row[channel] += cost
    channels = list(next(iter(rows.values()), {}))
    bars = charts.stacked_bars(rows, channels, "m")
    caption = (
        "Metres lost before the first infraction, shared among channels (Shapley values over all "
        "subsets of channels set to the truth)."
    )
    return [page.figure(bars, caption), rescues_table(attribution["rescues"])]


def rescues_table(rescues: Sequence[Mapping[str, Any]]) -> Markup:
    """The last moment from which a channel set to the truth saves each failed drive."""
    rows: list[list[Content]] = []
    for rescue in rescues:
        job = rescue["job"]
        point = next((each for each in rescue["attempts"] if each["saved_by"]), None)
        before_m = None if point is None else rescue["failure_m"] - point["route_m"]
        rows.append(
            [
                short_name(job["bev"]),
                f"{job['town']} {job['index']}",
                rescue["failure"].replace("_", " "),
                "no channel alone" if point is None else ", ".join(point["saved_by"]),
                f"{rescue['failure_m']:.0f}",
                sections.MISSING if before_m is None else f"{before_m:.1f}",
            ]
        )
    header = ["BEV generator", "episode", "failure", "saved by", "at (m)", "last saved (m before)"]
    caption = "The point of no return: the last moment from which one true channel saves the drive."
    return page.table(header, rows, caption, text_columns=4)


def origin(note: Mapping[str, Any]) -> Markup:
    """Command, versions, hashes and commit."""
    return element("pre", json.dumps(dict(note), indent=1))
