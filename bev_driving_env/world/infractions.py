"""The infractions of the contract: their names, their bits, their events."""

from __future__ import annotations

import functools
from collections.abc import Collection
from dataclasses import dataclass
from types import MappingProxyType

from ..kernels import layout

INFRACTIONS = MappingProxyType(
    {
        "off_road": layout.OFF_ROAD,
        "wrong_lane": layout.WRONG_LANE,
        "route_deviation": layout.ROUTE_DEVIATION,
        "collision_vehicle": layout.COLLISION_VEHICLE,
        "collision_pedestrian": layout.COLLISION_PEDESTRIAN,
        "collision_static": layout.COLLISION_STATIC,
        "red_light": layout.RED_LIGHT,
        "blocked": layout.BLOCKED,
    }
)
"""Bit of each infraction in the state's bitmasks, by name.

Collisions and red lights need other actors, signals or buildings; while the world has none of
them they cannot occur.
"""


@dataclass(frozen=True)
class InfractionEvent:
    """One infraction, at the moment it began.

    Attributes:
        name: Name of the infraction.
        time_s: Simulated time since reset.
        x: Ego position, world frame.
        y: Ego position, world frame.
        heading: Ego heading, radians.
        speed_mps: Ego speed.
        route_m: Route metres driven so far.
    """

    name: str
    time_s: float
    x: float
    y: float
    heading: float
    speed_mps: float
    route_m: float


@functools.lru_cache(maxsize=256)
def names_of(bits: int) -> tuple[str, ...]:
    """Names of the infractions in a bitmask, in the contract's order.

    >>> names_of(INFRACTIONS["blocked"] | INFRACTIONS["off_road"])
    ('off_road', 'blocked')
    """
    return tuple(name for name, bit in INFRACTIONS.items() if bits & bit)


def bits_of(names: Collection[str]) -> int:
    """Bitmask of a collection of infraction names.

    Raises:
        ValueError: A name is not one of ``INFRACTIONS``.
    """
    unknown = [name for name in names if name not in INFRACTIONS]
    if unknown:
        raise ValueError(
            f"unknown infraction {unknown[0]!r}; the infractions are: {', '.join(INFRACTIONS)}"
        )
    return sum(INFRACTIONS[name] for name in set(names))
