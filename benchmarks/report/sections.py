"""The sections of a report, from the results of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean
from typing import Any

import numpy as np

from bev_driving_env.frames import CHANNELS
from perception.evaluation_tables import short_name

from ..drive import EpisodeResult
from ..maps import draw_trajectories, png_bytes
from ..online import pooled
from ..published import DRIVES, IOU_WHILE_DRIVING, NAMES
from ..results import Score, score
from . import page
from .page import Content, Markup, element
from .replay import animation, last_seconds, strip

RESAMPLES = 2000
MISSING = "\N{EN DASH}"

Driver = tuple[str, str]
"""BEV source and agent."""


def by_driver(results: Iterable[EpisodeResult]) -> dict[Driver, list[EpisodeResult]]:
    """Results of each source and agent, in order of appearance."""
    groups: dict[Driver, list[EpisodeResult]] = {}
    for result in results:
        groups.setdefault((result.job.bev, result.job.agent), []).append(result)
    return groups


def label(driver: Driver, several_agents: bool) -> str:
    """How a source and agent are called in tables."""
    bev, agent = driver
    name = NAMES.get(bev)
    shown = f"{short_name(bev)} ({name})" if name and bev != "ground_truth" else short_name(bev)
    return f"{shown}, {agent}" if several_agents else shown


def interval(values: Sequence[float], seed: int = 0) -> tuple[float, float]:
    """95 % interval of a mean, by resampling the values (Efron's bootstrap)."""
    known = np.asarray(values, np.float64)
    rng = np.random.default_rng(seed)
    means = known[rng.integers(len(known), size=(RESAMPLES, len(known)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975]).tolist()
    return low, high


def route_table(results: Sequence[EpisodeResult]) -> Markup:
    """The paper's table: route metres and infractions, with intervals and the paper's own."""
    scores = {(row.bev, row.agent, row.town): row for row in score(results)}
    towns = list(dict.fromkeys(row.town for row in scores.values()))
    groups = by_driver(results)
    several = len({agent for _, agent in groups}) > 1
    header = ["BEV generator"]
    for town in towns:
        header += [f"{town} route (m)", "95 %", "infracted", "clean", "paper (CARLA)"]
    rows: list[list[Content]] = []
    for driver, drives in groups.items():
        row: list[Content] = [label(driver, several)]
        for town in towns:
            here = [result for result in drives if result.job.town == town]
            row += _route_cells(scores.get((*driver, town)), here, driver[0], town)
        rows.append(row)
    caption = (
        "Route metres driven over all episodes (mean over seeds) and episodes with an infraction. "
        "95 %: bootstrap over episodes and seeds. The paper's figures are from CARLA, another "
        "world: they say in which order systems came, not how far ours should come."
    )
    return page.table(header, rows, caption)


def _route_cells(
    entry: Score | None, drives: Sequence[EpisodeResult], bev: str, town: str
) -> list[Content]:
    if entry is None:
        return [MISSING] * 5
    episodes = entry.episodes / entry.seeds
    low, high = interval([drive.driven_m for drive in drives])
    paper = DRIVES.get(town, {}).get(bev)
    return [
        f"{entry.route_m:.0f}",
        f"{low * episodes:.0f} to {high * episodes:.0f}",
        f"{entry.infracted}/{entry.episodes}",
        f"{entry.clean}/{entry.episodes}",
        MISSING if paper is None else f"{paper.route_m} m, {paper.infracted}/5",
    ]


def seen_tables(results: Sequence[EpisodeResult]) -> list[Markup]:
    """IoU while driving in the paper's layout, and where and how much it changed the policy."""
    groups = {
        driver: drives
        for driver, drives in by_driver(results).items()
        if any(drive.online for drive in drives)
    }
    several = len({agent for _, agent in by_driver(results)}) > 1
    made = []
    for town in dict.fromkeys(result.job.town for result in results):
        rows: list[list[Content]] = []
        for driver, drives in groups.items():
            seen = pooled(drive.online for drive in drives if drive.job.town == town)
            iou = seen["all"].iou
            paper = IOU_WHILE_DRIVING.get(town, {}).get(driver[0])
            rows.append(
                [
                    label(driver, several),
                    *(number(iou[name]) for name in CHANNELS),
                    number(fmean(iou[name] for name in CHANNELS[:3])),
                    number(seen["critical"].iou["route"]),
                    number(seen["turn"].iou["route"]),
                    number(seen["all"].divergence, "{:.2f}"),
                    number(seen["turn"].divergence, "{:.2f}"),
                    MISSING if paper is None else ", ".join(f"{value:.3f}" for value in paper),
                ]
            )
        header = ["BEV generator", *CHANNELS, "mean of the first three", "route, critical"]
        header += ["route, turns", "divergence", "divergence, turns", "paper: road, route, lane"]
        caption = (
            f"{town}: IoU of what the policy saw, over all moments of its own drives, and how far "
            "its answer was from the one to the truth (Kullback-Leibler divergence of its Beta "
            "distributions in nats, median over moments)."
        )
        made.append(page.table(header, rows, caption))
    return made


def number(value: float, form: str = "{:.3f}") -> str:
    """A figure, or a dash for NaN."""
    return form.format(value) if math.isfinite(value) else MISSING


def maps(results: Sequence[EpisodeResult], note: Mapping[str, Any]) -> list[Markup]:
    """The paper's figure: all trajectories over the map of each town."""
    made = []
    for town in dict.fromkeys(result.job.town for result in results):
        picture = png_bytes(draw_trajectories(town, results), dict(note))
        description = f"Map of {town} with the trajectories of all drivers"
        caption = "Black dot: start. White dot: completed. Arrow: infraction."
        made.append(page.figure(page.image(picture, "png", description), f"{town}. {caption}"))
    return made


def cards(
    results: Sequence[EpisodeResult], most: int, progress: Callable[[], object] = lambda: None
) -> Markup:
    """A card for each drive that failed: where, by what, and its last five seconds.

    Args:
        results: All of them.
        most: Cards at most, spread over the drivers in turn.
        progress: Called after each card.
    """
    several = len({result.job.agent for result in results}) > 1
    made = []
    for result in chosen_failures(results, most):
        made.append(_card(result, several))
        progress()
    return element("div", made, class_="cards")


def chosen_failures(results: Sequence[EpisodeResult], most: int) -> list[EpisodeResult]:
    """Drives that were not clean, of each driver in turn until there are enough."""
    queues = [
        [drive for drive in drives if not drive.clean and not drive.error]
        for drives in by_driver(results).values()
    ]
    longest = max((len(queue) for queue in queues), default=0)
    in_turn = [queue[k] for k in range(longest) for queue in queues if k < len(queue)]
    chosen = {id(drive) for drive in in_turn[:most]}
    return [drive for queue in queues for drive in queue if id(drive) in chosen]


def _card(result: EpisodeResult, several_agents: bool) -> Markup:
    job = result.job
    seconds = last_seconds(result)
    what = result.infraction.replace("_", " ") or "time limit"
    where = result.driven_m if result.infraction_m is None else result.infraction_m
    title = f"{label((job.bev, job.agent), several_agents)}: {what}"
    line = (
        f"{job.town}, episode {job.index}, seed {job.seed}, "
        f"at {where:.0f} of {result.planned_m:.0f} m"
    )
    return element(
        "article",
        element("h3", title),
        element("p", line, class_="faint"),
        page.image(strip(seconds.cameras), "jpeg", "Cameras: left, front, right, rear"),
        page.image(
            animation(seconds),
            "webp",
            f"The last seconds before {what}: what the policy saw, and beside it the truth",
        ),
        element("p", "Left: what the policy saw. Right: the truth.", class_="faint"),
        class_="card",
    )
