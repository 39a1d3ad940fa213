"""What the policy saw on the way: IoU in the paper's layout, divergence, and IoU against metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean

import numpy as np

from bev_driving_env.frames import CHANNELS

from ..drive import EpisodeResult
from ..online import pooled
from ..published import IOU_WHILE_DRIVING
from . import charts
from .closed_loop import PAPERS_ROUTES
from .document import Figure
from .drivers import Driver, by_driver, labels, towns_of
from .intervals import percentiles, ratio_interval, ratios, resampling_weights
from .table import Cell, Column, Table, with_best

STATIC = CHANNELS[:3]
SHOWN = {"road": "Road", "route": "Traj.", "lane": "Lane"}
"""What the paper's table calls the channels."""


def iou_table(results: Sequence[EpisodeResult]) -> Table:
    """The paper's table: IoU of road, route and lane while driving, by town, a row a driver."""
    towns, groups = towns_of(results), _measured(results)
    names = labels(by_driver(results))
    compared = [
        town
        for town in towns
        if any(
            drive.job.bev in IOU_WHILE_DRIVING.get(town, {}) and drive.job.routes == PAPERS_ROUTES
            for drive in results
        )
    ]
    columns = [Column("BEV generator")]
    for town in towns:
        columns += [Column(name, town) for name in (*SHOWN.values(), "Mean")]
    for town in compared:
        group = f"Paper, CARLA's {town}"
        columns += [Column(name, group, elsewhere=True) for name in (*SHOWN.values(), "Mean")]
    rows = []
    for driver, drives in groups.items():
        row = [Cell(names[driver])]
        for town in towns:
            row += _iou_cells([drive for drive in drives if drive.job.town == town])
        for town in compared:
            paper = IOU_WHILE_DRIVING[town].get(driver.bev, (math.nan,) * len(STATIC))
            row += [Cell(value) for value in (*paper, fmean(paper))]
        rows.append(tuple(row))
    caption = (
        "IoU of what the policy saw, over all moments of its own drives (pixels added up), with "
        "95 % intervals over routes and seeds (bootstrap)."
    )
    if compared:
        caption += " The paper's figures are from another world, CARLA's own images."
    best = [with_best(column) for column in zip(*rows, strict=True)]
    return Table("IoU while driving", caption, tuple(columns), tuple(zip(*best, strict=True)))


def places_table(results: Sequence[EpisodeResult]) -> Table:
    """The route channel where it matters, and how far the BEV changed the policy's answer."""
    groups = _measured(results)
    names = labels(by_driver(results))
    rows = []
    for driver, drives in groups.items():
        for town in towns_of(drives):
            seen = pooled(drive.online for drive in drives if drive.job.town == town)
            cells = [Cell(seen[place].iou["route"]) for place in ("all", "critical", "turn")]
            cells += [Cell(seen[place].divergence, "{:.2f}") for place in ("all", "turn")]
            rows.append((Cell(names[driver]), Cell(town), *cells))
    columns = [Column("BEV generator"), Column("Town")]
    columns += [Column(name, "IoU of the route") for name in ("everywhere", "critical", "turns")]
    columns += [Column(name, "Divergence (nats)") for name in ("everywhere", "turns")]
    caption = (
        "The route where it matters, and how far the policy's answer to what it saw was from its "
        "answer to the truth. Divergence: Kullback-Leibler, of its Beta distributions, median over "
        "moments. Critical: in a junction or corner or at most 20 m before one; turns: where the "
        "route goes left or right in a junction."
    )
    return Table("critical places", caption, tuple(columns), tuple(rows), text_columns=2)


def iou_against_metres(results: Sequence[EpisodeResult]) -> Figure | None:
    """What the paper asks: does a higher mean IoU drive farther? None if nothing was measured."""
    drivers = by_driver(results)
    names = labels(drivers)
    towns = towns_of(results)
    points = []
    for k, (driver, drives) in enumerate(drivers.items()):
        for town in towns:
            here = [drive for drive in drives if drive.job.town == town]
            seen = pooled(drive.online for drive in here)["all"]
            mean = fmean(seen.iou[name] for name in STATIC)
            if math.isfinite(mean):
                share = 100.0 * sum(d.driven_m for d in here) / sum(d.planned_m for d in here)
                title = f"{names[driver]}, {town}: IoU {mean:.3f}, {share:.0f} % of the route"
                shape = charts.SHAPES[towns.index(town) % len(charts.SHAPES)]
                points.append(charts.Point(mean, share, names[driver], title, k, shape))
    if not points:
        return None
    chart = charts.scatter(points, "mean IoU of road, route and lane", "route driven (%)")
    shapes = ", ".join(
        f"{town} {charts.SHAPES[k % len(charts.SHAPES)]}s" for k, town in enumerate(towns)
    )
    caption = f"IoU while driving against the share of the routes driven: {shapes}."
    return Figure(chart, caption)


def _measured(results: Sequence[EpisodeResult]) -> dict[Driver, list[EpisodeResult]]:
    """Drives whose BEV was looked at, by driver; those of the truth are not."""
    return by_driver([result for result in results if result.online is not None])


def _iou_cells(drives: Sequence[EpisodeResult]) -> list[Cell]:
    """IoU of the channels and their mean, with intervals."""
    known = [drive.online["all"] for drive in drives if drive.online is not None]
    if not known:
        return [Cell(None)] * (len(STATIC) + 1)
    weights = resampling_weights([drive.job.index for drive in drives if drive.online is not None])
    values: list[float] = []
    cells: list[Cell] = []
    resampled = np.zeros(len(weights))
    for name in STATIC:
        hits = np.array([each["hits"][name] for each in known], np.float64)
        union = np.array([each["union"][name] for each in known], np.float64)
        values.append(float(hits.sum() / union.sum()) if union.any() else math.nan)
        cells.append(Cell(values[-1], interval=ratio_interval(hits, union, weights)))
        resampled += ratios(hits, union, weights) / len(STATIC)
    return [*cells, Cell(fmean(values), interval=percentiles(resampled))]
