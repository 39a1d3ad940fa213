"""The driving score of the CARLA Leaderboard: route completion times a penalty for infractions."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

FACTORS = MappingProxyType(
    {
        "collision_pedestrian": 0.50,
        "collision_vehicle": 0.60,
        "collision_static": 0.65,
        "red_light": 0.70,
    }
)
"""Versions 1.0 and 2.0: what each occurrence multiplies the score by."""

WEIGHTS = MappingProxyType(
    {
        "collision_pedestrian": 1.00,
        "collision_vehicle": 0.70,
        "collision_static": 0.60,
        "red_light": 0.40,
    }
)
"""Version 2.1: what each occurrence adds to the number that the score is divided by."""

WITHOUT_FACTOR = ("off_road", "wrong_lane", "route_deviation", "blocked")
"""Infractions that cost no factor of their own.

The first two count by the metres driven outside the lanes; the last two end the episode, and so
cost what is left of the route.
"""

VERSIONS = ("1.0", "2.0", "2.1")
FAULTS = ("ego", "other", "")


def driving_score(
    route_fraction: float,
    infractions: Mapping[str, int] | Iterable[Any],
    version: str = "2.1",
    outside_fraction: float = 0.0,
) -> float:
    """Driving score of one route, as the CARLA Leaderboard defines it.

    Of its infractions, those that BEVTown knows are counted. There are no stop signs, scenarios or
    emergency vehicles, and no check of a least speed; without them, 1.0 and 2.0 are the same.

    Args:
        route_fraction: Share of the route that was completed, 0 to 1.
        infractions: Counts by name; or names; or events, each a mapping or an object with a
            ``name`` and maybe a ``fault``. Events whose fault is ``"other"`` do not count.
        version: Version of the Leaderboard: ``"1.0"``, ``"2.0"`` or ``"2.1"``.
        outside_fraction: Share of the driven metres that were off the road or against the lane's
            direction, 0 to 1.

    Returns:
        Score from 0 to 100.

    Raises:
        ValueError: A name, fault, count, version or fraction is not valid.

    >>> round(driving_score(0.8, {"red_light": 1, "collision_vehicle": 2}, version="1.0"), 2)
    20.16
    >>> round(driving_score(0.7, ["red_light"], version="2.1"), 2)
    50.0
    """
    _require_fraction("route_fraction", route_fraction)
    penalty = infraction_penalty(infractions, version, outside_fraction)
    return 100.0 * float(route_fraction) * penalty


def infraction_penalty(
    infractions: Mapping[str, int] | Iterable[Any],
    version: str = "2.1",
    outside_fraction: float = 0.0,
) -> float:
    """What infractions leave of the route completion: 1 for none, towards 0 for many.

    Args:
        infractions: As for ``driving_score``.
        version: Likewise.
        outside_fraction: Likewise.

    Raises:
        ValueError: As for ``driving_score``.
    """
    if version not in VERSIONS:
        raise ValueError(
            f"unknown version {version!r} of the driving score; versions are: {', '.join(VERSIONS)}"
        )
    _require_fraction("outside_fraction", outside_fraction)
    counts = count_infractions(infractions)
    inside = 1.0 - float(outside_fraction)
    if version == "2.1":
        return inside / (1.0 + sum(WEIGHTS[name] * counts[name] for name in WEIGHTS))
    penalty = inside
    for name, factor in FACTORS.items():
        penalty *= factor ** counts[name]
    return penalty


def count_infractions(infractions: Mapping[str, int] | Iterable[Any]) -> dict[str, int]:
    """How often each infraction occurred by the ego's fault; every known name is there.

    Args:
        infractions: As for ``driving_score``.

    Raises:
        ValueError: A name, fault or count is not valid.
    """
    if isinstance(infractions, str):
        raise ValueError(
            f"infractions must be several names, got {infractions!r}; put it in a list"
        )
    counts = dict.fromkeys((*FACTORS, *WITHOUT_FACTOR), 0)
    if isinstance(infractions, Mapping):
        for name, count in infractions.items():
            counts[_known(name)] += _checked_count(name, count)
        return counts
    for item in infractions:
        name, fault = _name_and_fault(item)
        counts[_known(name)] += fault != "other"
    return counts


def _name_and_fault(item: Any) -> tuple[Any, str]:
    """Name of an infraction and whose fault it was, of a name or an event."""
    if isinstance(item, str):
        return item, ""
    if isinstance(item, Mapping):
        name, fault = item.get("name"), item.get("fault", "")
    else:
        name, fault = getattr(item, "name", item), getattr(item, "fault", "")
    if fault not in FAULTS:
        raise ValueError(f"unknown fault {fault!r} of infraction {name!r}; it is one of {FAULTS}")
    return name, fault


def _known(name: Any) -> str:
    names = (*FACTORS, *WITHOUT_FACTOR)
    if name not in names:
        raise ValueError(f"unknown infraction {name!r}; the infractions are: {', '.join(names)}")
    return str(name)


def _checked_count(name: str, count: Any) -> int:
    try:
        number = operator.index(count)
    except TypeError:
        number = -1
    if number < 0:
        raise ValueError(f"the count of {name!r} must be a whole number from 0, got {count!r}")
    return number


def _require_fraction(name: str, value: float) -> None:
    # the negation also refuses NaN
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} must be from 0 to 1, got {value!r}")
