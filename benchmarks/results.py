"""Results of a run: the paper's table, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from .drive import EpisodeResult

COLUMNS = (
    "town",
    "routes",
    "index",
    "bev",
    "agent",
    "seed",
    "appearance",
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
)


@dataclass(frozen=True)
class Score:
    """One source and agent in one town.

    Attributes:
        bev: BEV source.
        agent: Agent.
        town: Town.
        episodes: Number of episodes, over all seeds.
        seeds: Number of seeds.
        planned_m: Planned metres of all episodes, mean over seeds.
        route_m: Driven metres of all episodes, mean over seeds.
        infracted: Episodes with an infraction.
        clean: Episodes completed without one.
    """

    bev: str
    agent: str
    town: str
    episodes: int
    seeds: int
    planned_m: float
    route_m: float
    infracted: int
    clean: int


def score(results: Sequence[EpisodeResult]) -> list[Score]:
    """Sum up results by source, agent and town, in order of appearance."""
    groups: dict[tuple[str, str, str], list[EpisodeResult]] = {}
    for result in results:
        job = result.job
        groups.setdefault((job.bev, job.agent, job.town), []).append(result)
    scores = []
    for (bev, agent, town), rows in groups.items():
        seeds = len({row.job.seed for row in rows})
        scores.append(
            Score(
                bev=bev,
                agent=agent,
                town=town,
                episodes=len(rows),
                seeds=seeds,
                planned_m=sum(row.planned_m for row in rows) / seeds,
                route_m=sum(row.driven_m for row in rows) / seeds,
                infracted=sum(row.infractions > 0 for row in rows),
                clean=sum(row.clean for row in rows),
            )
        )
    return scores


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


def _cells(entry: Score) -> list[str]:
    return [
        f"{entry.route_m:.0f}",
        f"{entry.infracted}/{entry.episodes}",
        f"{entry.clean}/{entry.episodes}",
    ]


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table with aligned columns: the first two to the left, figures to the right."""
    widths = [max(len(line[k]) for line in (header, *rows)) for k in range(len(header))]
    lines = []
    for line in (header, None, *rows):
        if line is None:
            marks = [
                "-" * width if k < 2 else "-" * (width - 1) + ":" for k, width in enumerate(widths)
            ]
            lines.append("| " + " | ".join(marks) + " |")
        else:
            cells = [
                cell.ljust(width) if k < 2 else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def as_json(results: Sequence[EpisodeResult], note: dict[str, Any]) -> dict[str, Any]:
    """Everything about a run but the trajectories, JSON-ready."""
    return {
        "provenance": note,
        "scores": [asdict(entry) for entry in score(results)],
        "episodes": [{**_row(result), "error": result.error} for result in results],
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
    values = {**result.job.as_dict(), **result.as_dict(), "infraction_x": x, "infraction_y": y}
    return {
        column: round(value, 3) if isinstance(value := values[column], float) else value
        for column in COLUMNS
    }
