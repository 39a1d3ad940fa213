"""Who drove: a BEV source and an agent, and how they are called in a report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from perception.evaluation_tables import short_name

from ..drive import EpisodeResult
from ..published import NAMES


class Driver(NamedTuple):
    """A BEV source and the agent that drove on it."""

    bev: str
    agent: str


def by_driver(results: Iterable[EpisodeResult]) -> dict[Driver, list[EpisodeResult]]:
    """Results of each source and agent, in order of appearance."""
    groups: dict[Driver, list[EpisodeResult]] = {}
    for result in results:
        groups.setdefault(Driver(result.job.bev, result.job.agent), []).append(result)
    return groups


def towns_of(results: Iterable[EpisodeResult]) -> list[str]:
    """Towns in order of appearance."""
    return list(dict.fromkeys(result.job.town for result in results))


def labels(drivers: Iterable[Driver]) -> dict[Driver, str]:
    """What each driver is called; the agent is named where there are several."""
    known = list(drivers)
    several = len({driver.agent for driver in known}) > 1
    return {
        driver: source_label(driver.bev) + (f", {driver.agent}" if several else "")
        for driver in known
    }


def source_label(bev: str) -> str:
    """A source's name with the paper's.

    >>> source_label("cvt_kde"), source_label("blind")
    ('cvt_kde (CVT 6ch. KDE)', 'blind')
    """
    name = NAMES.get(bev)
    return f"{short_name(bev)} ({name})" if name and bev != "ground_truth" else short_name(bev)
