"""Results of a run: scores, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

from .drive import EpisodeResult
from .driving_score import count_infractions
from .suites import added_error

KINDS = tuple(count_infractions(()))
"""Names of the infractions, in the order of their columns."""

COLUMNS = (
    "town",
    "routes",
    "index",
    "bev",
    "agent",
    "seed",
    "appearance",
    "source",
    "error_model",
    "dose",
    "planned_m",
    "driven_m",
    "success",
    "truncated",
    "infraction",
    "infraction_m",
    "infraction_x",
    "infraction_y",
    "infractions",
    "steps",
    "time_s",
    "episode_return",
    "failure",
    "traffic",
    "traffic_lights",
    "travelled_m",
    "outside_m",
    "driving_score_1_0",
    "driving_score_2_1",
    *KINDS,
)
"""Of a row. Those named as infractions count them by the ego's fault, ``infractions`` all.

``source``, ``error_model`` and ``dose`` are what ``bev`` is made of, see ``added_error``.
"""

SHORTEST_KM = 0.001
"""Infractions per km are over at least so much, as in the Leaderboard's own statistics."""


@dataclass(frozen=True)
class Score:
    """One source and agent in one town.

    Attributes:
        bev: BEV source.
        agent: Agent.
        town: Town.
        appearance: Look of the world; several, if they are summed up together, with commas.
        episodes: Number of episodes, over all seeds.
        seeds: Number of seeds.
        planned_m: Planned metres of all episodes, mean over seeds.
        route_m: Driven metres of all episodes, mean over seeds.
        infracted: Episodes with an infraction.
        clean: Episodes completed without one.
        driving_score_1_0: Driving score of version 1.0 of the Leaderboard, mean over episodes.
        driving_score_2_1: Likewise of version 2.1.
        route_completion_pct: Completed share of the routes in percent, mean over episodes.
        penalty_2_1: Infraction penalty of version 2.1, mean over episodes.
        travelled_km: Driven kilometres of all episodes and seeds, on the route or not.
        outside_pct: Percentage of them off the road or against the lane's direction.
        infractions: Number of infractions by kind, over all episodes, by the ego's fault.
        infractions_per_km: The same per kilometre driven.
        timeouts: Episodes that the time limit ended.
    """

    bev: str
    agent: str
    town: str
    appearance: str
    episodes: int
    seeds: int
    planned_m: float
    route_m: float
    infracted: int
    clean: int
    driving_score_1_0: float
    driving_score_2_1: float
    route_completion_pct: float
    penalty_2_1: float
    travelled_km: float
    outside_pct: float
    infractions: dict[str, int]
    infractions_per_km: dict[str, float]
    timeouts: int


def score(results: Sequence[EpisodeResult], *, by_look: bool = False) -> list[Score]:
    """Sum up results by source, agent and town, in the order in which these occur.

    Args:
        results: Of episodes.
        by_look: Apart for each look of the world too.
    """
    groups: dict[tuple[str, str, str, str], list[EpisodeResult]] = {}
    for result in results:
        job = result.job
        look = job.appearance if by_look else ""
        groups.setdefault((job.bev, job.agent, look, job.town), []).append(result)
    return [_score(rows) for rows in groups.values()]


def _score(rows: Sequence[EpisodeResult]) -> Score:
    """Sum up the episodes of one source and agent in one town."""
    first = rows[0].job
    seeds = len({row.job.seed for row in rows})
    counts = count_infractions(event for row in rows for event in row.events)
    travelled_km = sum(row.travelled_m for row in rows) / 1000.0
    outside_km = sum(row.outside_m for row in rows) / 1000.0
    return Score(
        bev=first.bev,
        agent=first.agent,
        town=first.town,
        appearance=", ".join(dict.fromkeys(row.job.appearance for row in rows)),
        episodes=len(rows),
        seeds=seeds,
        planned_m=sum(row.planned_m for row in rows) / seeds,
        route_m=sum(row.driven_m for row in rows) / seeds,
        infracted=sum(row.infractions > 0 for row in rows),
        clean=sum(row.clean for row in rows),
        driving_score_1_0=fmean(row.driving_score("1.0") for row in rows),
        driving_score_2_1=fmean(row.driving_score("2.1") for row in rows),
        route_completion_pct=100.0 * fmean(row.route_fraction for row in rows),
        penalty_2_1=fmean(row.penalty("2.1") for row in rows),
        travelled_km=travelled_km,
        outside_pct=100.0 * outside_km / max(travelled_km, SHORTEST_KM),
        infractions=counts,
        infractions_per_km={
            name: count / max(travelled_km, SHORTEST_KM) for name, count in counts.items()
        },
        timeouts=sum(row.truncated for row in rows),
    )


def as_json(results: Sequence[EpisodeResult], note: dict[str, Any]) -> dict[str, Any]:
    """Everything about a run but the trajectories, JSON-ready."""
    return {
        "provenance": note,
        "scores": [asdict(entry) for entry in score(results, by_look=True)],
        "episodes": [
            {
                **_row(result),
                "key": result.job.key,
                "error": result.error,
                "events": list(result.events),
                "online": result.online,
            }
            for result in results
        ],
    }


def as_csv(results: Sequence[EpisodeResult], note: dict[str, Any]) -> str:
    """One line an episode, below comment lines that start with ``#`` and hold the provenance."""
    buffer = io.StringIO()
    for key, value in note.items():
        text = value if isinstance(value, str) else json.dumps(value)
        buffer.write(f"# {key}: {text}\n")
    writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for result in results:
        writer.writerow(_row(result))
    return buffer.getvalue()


def _row(result: EpisodeResult) -> dict[str, Any]:
    """One episode as flat columns."""
    x, y, _ = result.infraction_pose or (None, None, None)
    source, model, dose = added_error(result.job.bev)
    values = {
        **result.job.as_dict(),
        **vars(result.job.conditions),
        **result.as_dict(),
        "source": source,
        "error_model": model,
        "dose": dose,
        "infraction_x": x,
        "infraction_y": y,
        "driving_score_1_0": result.driving_score("1.0"),
        "driving_score_2_1": result.driving_score("2.1"),
        **result.counts,
    }
    return {
        column: round(value, 3) if isinstance(value := values[column], float) else value
        for column in COLUMNS
    }
