"""The infractions of the contract: their names, their bits, their events."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from dataclasses import dataclass
from types import MappingProxyType

from ..kernels import detect, layout, overlap


@dataclass(frozen=True)
class Infraction:
    """One row of the contract's table.

    Attributes:
        name: Its name.
        bit: Its bit in the state's bitmasks.
        detector: The kernel that sees it, or what leads to it, at one moment.
        when: When it occurs.
    """

    name: str
    bit: int
    detector: Callable[..., object]
    when: str


TABLE = (
    Infraction(
        "off_road",
        layout.OFF_ROAD,
        detect.is_off_road,
        "the ego's centre, or a quarter of its footprint, leaves the pavement",
    ),
    Infraction(
        "wrong_lane",
        layout.WRONG_LANE,
        detect.is_against_traffic,
        "more than 1 s in a lane against the ego's heading, outside junctions",
    ),
    Infraction(
        "route_deviation",
        layout.ROUTE_DEVIATION,
        detect.is_deviating,
        "more than 3.5 m from the planned lane centre",
    ),
    Infraction(
        "collision_vehicle",
        layout.COLLISION_VEHICLE,
        detect.actor_hit,
        "the footprints of the ego and another vehicle overlap",
    ),
    Infraction(
        "collision_pedestrian",
        layout.COLLISION_PEDESTRIAN,
        detect.actor_hit,
        "the footprints of the ego and a pedestrian overlap",
    ),
    Infraction(
        "collision_static",
        layout.COLLISION_STATIC,
        overlap.hits_any,
        "the ego's footprint overlaps a building, tree, pole or other furniture",
    ),
    Infraction(
        "red_light",
        layout.RED_LIGHT,
        detect.red_line_crossed,
        "the ego's front bumper crosses a stop line while its signal is red",
    ),
    Infraction(
        "blocked",
        layout.BLOCKED,
        detect.is_standing,
        "slower than 0.1 m/s for 30 s with nothing to wait for",
    ),
)
"""All infractions, each with its detector; thresholds are those of ``Rules`` by default.

Touching the same kind of thing again within 2 s is still the same collision.
"""

INFRACTIONS = MappingProxyType({row.name: row.bit for row in TABLE})
"""Bit of each infraction in the state's bitmasks, by name."""


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
        actor: Who or what else was involved, as ``"vehicle 12"``, ``"pedestrian 3"`` or
            ``"signal 7"`` (numbers of rows in the state), or "".
        fault: ``"ego"``, ``"other"``, or "" where it cannot be told.
    """

    name: str
    time_s: float
    x: float
    y: float
    heading: float
    speed_mps: float
    route_m: float
    actor: str = ""
    fault: str = "ego"


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
