"""How far each driver got: the paper's table, the Leaderboard's, and where they drove."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bev_driving_env.sources.expressions import TRUTH

from ..drive import EpisodeResult
from ..maps import png_bytes, told_apart, trajectory_map
from ..published import DRIVES
from ..results import Score, score
from ..tables import LEADERBOARD_HEADER, leaderboard_rows
from . import page
from .charts import driver_legend
from .document import Figure
from .drivers import Driver, by_driver, labels, towns_of
from .intervals import ratio_interval, resampling_weights, share_interval
from .page import element
from .table import Cell, Column, Table, with_best

PAPERS_ROUTES = "episode"
"""Routes of the paper's five episodes: only they compare with its figures."""
TIE = 0.01
"""Share of metres that tells nothing: an episode ends at 99 % of its route."""
MAP_PX = 760
"""Width of a map: narrow, so that its marks can be seen on a phone."""


def route_table(results: Sequence[EpisodeResult]) -> Table:
    """The paper's table: route metres and infractions by town, a row a driver, with intervals."""
    scores = {(entry.bev, entry.agent, entry.town): entry for entry in score(results)}
    towns, groups = towns_of(results), by_driver(results)
    names = labels(groups)
    compared = [town for town in towns if _is_published(town, results)]
    columns = [Column("BEV generator")]
    planned = [Cell("Whole route")]
    for town in towns:
        columns += [Column(name, town) for name in ("Route (m)", "Infrac.", "Clean")]
        whole = next(entry.planned_m for key, entry in scores.items() if key[2] == town)
        planned += [Cell(whole, "{:.0f}"), Cell(None), Cell(None)]
    for town in compared:
        group = f"Paper, CARLA's {town}"
        columns += [Column(name, group, elsewhere=True) for name in ("Route (m)", "Infrac.")]
        planned += [Cell(None), Cell(None)]
    rows = []
    for driver, drives in groups.items():
        row = [Cell(names[driver])]
        for town in towns:
            here = [drive for drive in drives if drive.job.town == town]
            row += _own_cells(scores.get((*driver, town)), here)
        for town in compared:
            row += _paper_cells(driver, town)
        rows.append(tuple(row))
    caption = (
        "Route metres driven, summed over the episodes of a town (mean over seeds), and episodes "
        "with an infraction. Clean: completed without one. With 95 % intervals: of metres over "
        "routes and seeds (bootstrap of the share of planned metres), of clean shares in percent "
        "(Wilson). Bold: the farthest, and those within 1 % of it, for an episode ends at 99 % of "
        "its route."
    )
    if compared:
        caption += (
            " The paper's figures are from another world, CARLA's own images: compare the order of "
            "systems, not the metres."
        )
    return Table("route completion", caption, tuple(columns), (tuple(planned), *_bold(rows)))


def _is_published(town: str, results: Sequence[EpisodeResult]) -> bool:
    """Whether the paper drove some of these sources through this town, on the same routes."""
    return any(
        drive.job.bev in DRIVES.get(town, {}) and drive.job.routes == PAPERS_ROUTES
        for drive in results
        if drive.job.town == town
    )


def _own_cells(entry: Score | None, drives: Sequence[EpisodeResult]) -> list[Cell]:
    if entry is None:
        return [Cell(None)] * 3
    weights = resampling_weights([drive.job.index for drive in drives])
    # of the share of what was planned: how long the drawn routes are is no uncertainty
    driven, planned = zip(*((drive.driven_m, drive.planned_m) for drive in drives), strict=True)
    ends = ratio_interval(driven, planned, weights)
    low, high = share_interval(entry.clean, entry.episodes)
    return [
        Cell(entry.route_m, "{:.0f}", (ends[0] * entry.planned_m, ends[1] * entry.planned_m)),
        Cell(f"{entry.infracted}/{entry.episodes}"),
        Cell(f"{entry.clean}/{entry.episodes}", "{:.0f}", (100.0 * low, 100.0 * high)),
    ]


def _paper_cells(driver: Driver, town: str) -> list[Cell]:
    paper = DRIVES[town].get(driver.bev)
    if paper is None:
        return [Cell(None)] * 2
    return [Cell(float(paper.route_m), "{:.0f}"), Cell(f"{paper.infracted}/5")]


def _bold(rows: Sequence[tuple[Cell, ...]]) -> list[tuple[Cell, ...]]:
    """The farthest of each column of metres in bold, all of them; the truth is no competitor."""
    turned = []
    for column in zip(*rows, strict=True):
        rivals = [k for k, row in enumerate(rows) if row[0].value != TRUTH]
        cells = list(column)
        for k, cell in zip(rivals, with_best([column[k] for k in rivals], TIE), strict=True):
            cells[k] = cell
        turned.append(cells)
    return list(zip(*turned, strict=True))


def leaderboard_table(results: Sequence[EpisodeResult]) -> Table:
    """The CARLA Leaderboard's table, for suites with traffic."""
    caption = (
        "The CARLA Leaderboard's figures: driving scores (0 to 100), completed routes (%), "
        "infraction penalty (0 to 1), all means over episodes, and counts of infractions by the "
        "ego's fault."
    )
    columns = tuple(Column(name) for name in LEADERBOARD_HEADER)
    rows = tuple(tuple(map(Cell, row)) for row in leaderboard_rows(score(results)))
    return Table("leaderboard", caption, columns, rows, text_columns=3)


def broken_table(results: Sequence[EpisodeResult]) -> Table | None:
    """Drives that the agent or the BEV source failed in, if there are any."""
    broken = [result for result in results if result.error]
    if not broken:
        return None
    rows = [
        (Cell(result.job.bev), Cell(result.job.agent), Cell(_episode(result)), Cell(result.failure))
        for result in broken
    ]
    columns = tuple(map(Column, ("BEV generator", "Agent", "Episode", "Failure")))
    caption = (
        "Drives that an error of agent or BEV generator ended. They count as not completed, with "
        "the metres driven until then."
    )
    return Table("errors", caption, columns, tuple(rows), text_columns=4)


def _episode(result: EpisodeResult) -> str:
    return f"{result.job.town} {result.job.index}, seed {result.job.seed}"


def trajectory_figures(results: Sequence[EpisodeResult], note: Mapping[str, Any]) -> list[Figure]:
    """The paper's figure: all trajectories over the map of each town."""
    made = []
    shown = told_apart(results)
    legend = driver_legend(by_driver(shown))
    less = "" if len(shown) == len(results) else " Drives behind error models are left out."
    for town in towns_of(results):
        picture = png_bytes(trajectory_map(town, shown, MAP_PX), dict(note))
        image = page.image(
            picture,
            "png",
            f"Map of {town} with the trajectories of {len(by_driver(shown))} drivers",
        )
        caption = (
            f"{town}. Black dot: start. White dot: completed. Arrow: place and heading of an "
            f"infraction. Numbers: episodes.{less}"
        )
        made.append(Figure(element("div", image, legend), caption, f"map_{town}.png"))
    return made
