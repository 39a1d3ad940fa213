"""What ``bev-bench attribute`` found: metres by channel, and when failed drives were lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..rewind import Rescue
from . import charts
from .document import Figure
from .drivers import Driver, labels
from .table import Cell, Column, Table


def lost_metres(attributions: Sequence[Mapping[str, Any]]) -> tuple[Table, Figure]:
    """Lost metres by channel of each driver and town, as a table and as bars.

    Args:
        attributions: Rows of ``attribution.json``.
    """
    names = labels(Driver(each["job"]["bev"], each["job"]["agent"]) for each in attributions)
    sums: dict[tuple[str, str], dict[str, float]] = {}
    for each in attributions:
        driver = Driver(each["job"]["bev"], each["job"]["agent"])
        row = sums.setdefault((names[driver], each["job"]["town"]), {})
        for channel, cost in each["cost_m"].items():
            row[channel] = row.get(channel, 0.0) + cost
    channels = list(dict.fromkeys(channel for row in sums.values() for channel in row))
    rows = [
        (
            Cell(name),
            Cell(town),
            Cell(sum(costs.values()), "{:.0f}"),
            *(Cell(costs.get(channel), "{:.0f}") for channel in channels),
        )
        for (name, town), costs in sums.items()
    ]
    columns = [Column("BEV generator"), Column("Town"), Column("Lost (m)")]
    columns += [Column(channel, "by the errors of") for channel in channels]
    caption = (
        "Metres lost before the first infraction, against driving on the truth, and what of them "
        "each channel's errors cost (Shapley values over all subsets of channels set to the truth; "
        "they add up to the loss). Below 0: errors that helped by accident."
    )
    table = Table("attribution", caption, tuple(columns), tuple(rows), text_columns=2)
    bars = charts.stacked_bars(
        {f"{name}, {town}": costs for (name, town), costs in sums.items()}, channels, "m"
    )
    return table, Figure(bars, "Metres lost by channel. Bars to the left of the axis: gained.")


def rescues_table(rescues: Sequence[Mapping[str, Any]]) -> Table:
    """The last moment from which one channel set to the truth saves each failed drive.

    Args:
        rescues: Rows of ``attribution.json``.
    """
    names = labels(Driver(each["job"]["bev"], each["job"]["agent"]) for each in rescues)
    rows = []
    for row in rescues:
        job, rescue = row["job"], Rescue.from_dict(row)
        if rescue is None:
            continue
        point = rescue.point_of_no_return
        rows.append(
            (
                Cell(names[Driver(job["bev"], job["agent"])]),
                Cell(f"{job['town']} {job['index']}"),
                Cell(rescue.failure.replace("_", " ")),
                Cell("no channel alone" if point is None else ", ".join(point.saved_by)),
                Cell(rescue.failure_m, "{:.0f}"),
                Cell(None if point is None else rescue.failure_m - point.route_m, "{:.1f}"),
            )
        )
    heads = ("BEV generator", "Episode", "Failure", "Saved by", "at (m)", "Last saved (m before)")
    caption = (
        "The point of no return of each failed drive: the last moment from which one channel set "
        "to the truth saves it."
    )
    return Table("rewinding", caption, tuple(map(Column, heads)), tuple(rows), text_columns=4)
