"""How each variant drives: the drives of the study, and what they come to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bev_driving_env.towns.registry import compiled_town, route_book

from ..attribution import clean_metres
from ..drive import EpisodeResult
from ..suites import LOOKS, Job
from .variants import Variant

SPLIT = "test"
LONGEST_M = 300.0
"""A drive ends at its first infraction: of a long route, most variants would not see the end."""
SEEDS_APART = 1000
"""Each route has a seed of its own, so that random errors fall to all sides; those of two runs of
the study do not meet."""


@dataclass(frozen=True)
class Driving:
    """What the drives of a variant came to.

    Attributes:
        clean_share: Metres before the first infraction, of all that were planned; a clean drive
            has all of them.
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
    """Routes of a split from short to long, evenly spread over those of at most ``LONGEST_M``.

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
    every = {n: book.route(split, n, compiled).length_m for n in range(book.size(split))}
    able = sorted((n for n in every if every[n] <= LONGEST_M), key=every.__getitem__)
    if not 1 <= count <= len(able):
        raise ValueError(
            f"town {town!r} has {len(able)} {split!r} routes of at most {LONGEST_M:g} m, "
            f"{count} were asked for"
        )
    return [able[(2 * k + 1) * len(able) // (2 * count)] for k in range(count)]


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
    # a route counts as driven some metres before its end: that must not tell clean drives apart
    clean = [result.planned_m if result.clean else clean_metres(result) for result in results]
    first = [result.infraction for result in results if result.infraction]
    return Driving(
        sum(clean) / sum(result.planned_m for result in results),
        sum(result.clean for result in results) / len(results),
        tuple(m / result.planned_m for m, result in zip(clean, results, strict=True)),
        sum(bool(result.error) for result in results),
        {name: first.count(name) for name in sorted(set(first))},
    )
