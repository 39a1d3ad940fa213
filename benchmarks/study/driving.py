"""How each variant drives: the drives of the study, and what they come to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bev_driving_env.towns.registry import compiled_town, route_book

from ..attribution import clean_metres
from ..drive import EpisodeResult
from ..suites import LOOKS, Job
from .variants import Variant

SPLIT = "test"
SEEDS_APART = 1000
"""Each route has a seed of its own, so that random errors fall to all sides; those of two runs of
the study do not meet."""


@dataclass(frozen=True)
class Driving:
    """What the drives of a variant came to.

    Attributes:
        clean_share: Metres before the first infraction, of all that were planned.
        clean_drives: Share of drives that were completed without an infraction.
        shares: The first, route by route.
        failed: Drives in which agent or BEV source raised something.
        infractions: How often each kind came first.
    """

    clean_share: float
    clean_drives: float
    shares: tuple[float, ...]
    failed: int
    infractions: Mapping[str, int]


def spread_routes(town: str, count: int, split: str = SPLIT) -> list[int]:
    """Routes of a split from the shortest to the longest, evenly spread.

    Args:
        town: The town.
        count: How many.
        split: Suite of the town's ``RouteBook``.

    Returns:
        Their numbers in that order.

    Raises:
        ValueError: There are not so many.
    """
    book, compiled = route_book(town), compiled_town(town)
    size = book.size(split)
    if not 1 <= count <= size:
        raise ValueError(f"town {town!r} has {size} {split!r} routes, {count} were asked for")
    lengths = [book.route(split, index, compiled).length_m for index in range(size)]
    order = np.argsort(lengths, kind="stable")
    return order[(np.arange(count) * 2 + 1) * size // (2 * count)].tolist()


def study_routes(towns: Sequence[str], count: int) -> list[tuple[str, int]]:
    """So many routes, shared evenly among towns, each town's from short to long.

    Raises:
        ValueError: A town has not enough.
    """
    shares = [count // len(towns) + (k < count % len(towns)) for k in range(len(towns))]
    chosen = [
        [(town, index) for index in spread_routes(town, share)]
        for town, share in zip(towns, shares, strict=True)
        if share
    ]
    return [pair for routes in chosen for pair in routes]


def variant_jobs(
    variant: Variant, agent: str, routes: Sequence[tuple[str, int]], seed: int
) -> list[Job]:
    """Drives of a variant, the same for all variants but for what is seen."""
    return [
        Job(
            town,
            SPLIT,
            index,
            variant.spec,
            agent,
            SEEDS_APART * seed + number,
            LOOKS.get(town, "train"),
        )
        for number, (town, index) in enumerate(routes)
    ]


def summed_up(results: Sequence[EpisodeResult]) -> Driving:
    """What the drives of one variant came to.

    Raises:
        ValueError: There are none.
    """
    if not results:
        raise ValueError("a variant without drives has no outcome")
    clean = [clean_metres(result) for result in results]
    first = [result.infraction for result in results if result.infraction]
    return Driving(
        sum(clean) / sum(result.planned_m for result in results),
        sum(result.clean for result in results) / len(results),
        tuple(m / result.planned_m for m, result in zip(clean, results, strict=True)),
        sum(bool(result.error) for result in results),
        {name: first.count(name) for name in sorted(set(first))},
    )
