"""The tables of a run as Markdown: the paper's, and the CARLA Leaderboard's."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bev_driving_env.frames import CHANNELS
from bev_driving_env.markdown import markdown

from .drive import EpisodeResult
from .online import pooled
from .results import Score

LEADERBOARD_KINDS = {
    "Ped.": "collision_pedestrian",
    "Vehicle": "collision_vehicle",
    "Static": "collision_static",
    "Red": "red_light",
    "Deviation": "route_deviation",
    "Blocked": "blocked",
}
"""Infraction counted in each column; those outside the lanes count by their metres instead."""


def table(scores: Sequence[Score]) -> str:
    """The paper's table as Markdown: route metres and infractions per town, a row a source."""
    towns = list(dict.fromkeys(entry.town for entry in scores))
    drivers = list(dict.fromkeys((entry.bev, entry.agent) for entry in scores))
    header = ["BEV source", "Agent"]
    for town in towns:
        header += [f"{town} route (m)", "Infrac.", "Clean"]
    planned = {entry.town: entry.planned_m for entry in scores}
    rows = [["*planned*", ""]]
    for town in towns:
        rows[0] += [f"*{planned[town]:.0f}*", "", ""]
    by_key = {(entry.bev, entry.agent, entry.town): entry for entry in scores}
    for bev, agent in drivers:
        row = [bev, agent]
        for town in towns:
            entry = by_key.get((bev, agent, town))
            row += _cells(entry) if entry else ["", "", ""]
        rows.append(row)
    return markdown(header, rows)


def appearance_table(scores: Sequence[Score]) -> str:
    """The same columns as Markdown, a row a source and look of the world.

    Args:
        scores: Apart by look.
    """
    towns = list(dict.fromkeys(entry.town for entry in scores))
    header = ["BEV source", "Agent", "Look"]
    planned = {entry.town: entry.planned_m for entry in scores}
    first = ["*planned*", "", ""]
    for town in towns:
        header += [f"{town} route (m)", "Infrac.", "Clean"]
        first += [f"*{planned[town]:.0f}*", "", ""]
    by_key = {(e.bev, e.agent, e.appearance, e.town): e for e in scores}
    rows = [first]
    for drive in dict.fromkeys(key[:3] for key in by_key):
        entries = [by_key.get((*drive, town)) for town in towns]
        rows.append([*drive, *(c for e in entries for c in (_cells(e) if e else [""] * 3))])
    return markdown(header, rows, text_columns=3)


def _cells(entry: Score) -> list[str]:
    return [
        f"{entry.route_m:.0f}",
        f"{entry.infracted}/{entry.episodes}",
        f"{entry.clean}/{entry.episodes}",
    ]


SEEN = (
    "The BEV while driving (IoU over all moments; turn: before and in left and right turns; "
    "divergence: how far the policy's answer to it is from that to the truth, nats, median):"
)


def seen_table(results: Sequence[EpisodeResult]) -> str:
    """What the policy's BEV was worth on the way as Markdown, a row a source, agent and town.

    And a row a look of the world, if a town was driven under several.
    """
    looks = {(result.job.town, result.job.appearance) for result in results}
    several = len(looks) > len({town for town, _ in looks})
    groups: dict[tuple[str, ...], list[EpisodeResult]] = {}
    for result in results:
        if result.online is not None:
            job = result.job
            name = (job.bev, job.agent, job.town, *([job.appearance] if several else []))
            groups.setdefault(name, []).append(result)
    names = ["BEV source", "Agent", "Town", *(["Look"] if several else [])]
    header = [*names, *CHANNELS, "route, critical", "route, turn"]
    header += ["divergence", "divergence, turn"]
    rows = []
    for name, drives in groups.items():
        seen = pooled(drive.online for drive in drives)
        values = [*seen["all"].iou.values()]
        values += [seen[place].iou["route"] for place in ("critical", "turn")]
        values += [seen[place].divergence for place in ("all", "turn")]
        rows.append([*name, *(f"{v:.3f}" if math.isfinite(v) else "-" for v in values)])
    return markdown(header, rows, text_columns=len(names))


LEADERBOARD_HEADER = (
    *("BEV source", "Agent", "Town", "DS 2.1", "DS 1.0", "Route %", "Penalty"),
    *LEADERBOARD_KINDS,
    "Timeout",
)


def leaderboard_rows(scores: Sequence[Score]) -> list[list[str]]:
    """The CARLA Leaderboard's table, a row a source, agent and town.

    Driving scores (0 to 100), route completion (%) and infraction penalty (version 2.1, 0 to 1)
    are means over episodes, so the first is not the product of the others. The rest are counts
    over all episodes, of what was the ego's fault.
    """
    rows = []
    for entry in scores:
        row = [entry.bev, entry.agent, entry.town]
        row += [f"{entry.driving_score_2_1:.1f}", f"{entry.driving_score_1_0:.1f}"]
        row += [f"{entry.route_completion_pct:.1f}", f"{entry.penalty_2_1:.3f}"]
        row += [str(entry.infractions[name]) for name in LEADERBOARD_KINDS.values()]
        rows.append([*row, str(entry.timeouts)])
    return rows


def leaderboard_table(scores: Sequence[Score]) -> str:
    """The CARLA Leaderboard's table as Markdown."""
    return markdown(LEADERBOARD_HEADER, leaderboard_rows(scores), text_columns=3)
