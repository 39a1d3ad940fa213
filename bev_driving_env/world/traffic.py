"""How much traffic there is: presets per town, and what they mean in numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from ..checks import is_int

if TYPE_CHECKING:
    from ..towns.compiled import CompiledTown

NOCRASH = MappingProxyType(
    {
        "none": {"Town01": (0, 0), "Town02": (0, 0)},
        "light": {"Town01": (20, 50), "Town02": (15, 50)},
        "dense": {"Town01": (100, 250), "Town02": (70, 150)},
    }
)
"""Vehicles and pedestrians per town of the NoCrash benchmark (Codevilla et al. 2019), as run by
Roach: its ``empty``, ``regular`` and ``dense``."""
PRESETS = tuple(NOCRASH)
KEYS = ("vehicles", "pedestrians")
Traffic = str | Mapping[str, int]


@dataclass(frozen=True)
class TrafficConfig:
    """Numbers of other road users, and whether the signals work.

    Attributes:
        vehicles: Vehicles beside the ego.
        pedestrians: Pedestrians.
        lights: Whether the town's signals work.
    """

    vehicles: int = 0
    pedestrians: int = 0
    lights: bool = False

    @property
    def moves(self) -> bool:
        """Whether anything but the ego moves or changes."""
        return self.lights or self.vehicles + self.pedestrians > 0

    def __post_init__(self) -> None:
        for name in KEYS:
            value = getattr(self, name)
            if not (is_int(value) and value >= 0):
                raise ValueError(f"{name} must be an int of at least 0, got {value!r}")
        if not isinstance(self.lights, bool):
            raise ValueError(f"traffic_lights must be True or False, got {self.lights!r}")


def check_traffic(traffic: Traffic) -> None:
    """Check a ``traffic`` keyword before any town is known.

    Raises:
        ValueError: It is neither a preset nor a mapping of numbers.
    """
    if isinstance(traffic, str):
        if traffic not in PRESETS:
            raise ValueError(
                f"traffic must be one of {', '.join(map(repr, PRESETS))} or a dict such as "
                f'{{"vehicles": 30, "pedestrians": 20}}, got {traffic!r}'
            )
        return
    if not isinstance(traffic, Mapping) or not set(traffic) <= set(KEYS):
        raise ValueError(
            f"traffic must be one of {', '.join(map(repr, PRESETS))} or a dict with the keys "
            f'{" and ".join(KEYS)}, as {{"vehicles": 30, "pedestrians": 20}}, got {traffic!r}'
        )
    _counted(traffic, False)


def traffic_config(traffic: Traffic, lights: bool, town: CompiledTown) -> TrafficConfig:
    """What a ``traffic`` keyword means in a town.

    Towns that NoCrash does not know get as many as Town01 per metre of road lane, or as many as
    there is room for.

    >>> from bev_driving_env.towns.registry import compiled_town
    >>> traffic_config("dense", True, compiled_town("Town02"))
    TrafficConfig(vehicles=70, pedestrians=150, lights=True)

    Raises:
        ValueError: The keyword is not valid.
    """
    check_traffic(traffic)
    if not isinstance(traffic, str):
        return _counted(traffic, lights)
    known = NOCRASH[traffic]
    if town.name in known:
        vehicles, pedestrians = known[town.name]
        return TrafficConfig(vehicles, pedestrians, lights)
    share = road_lane_m(town) / TOWN01_LANE_M
    room = traffic_room(town)
    vehicles, pedestrians = (
        min(int(share * count), room[name])
        for name, count in zip(KEYS, known["Town01"], strict=True)
    )
    return TrafficConfig(vehicles, pedestrians, lights)


def traffic_room(town: CompiledTown, *, dense: bool = False) -> dict[str, int]:
    """How many ``vehicles`` and ``pedestrians`` a town has room for, wherever the ego starts."""
    from .pedestrians import capacity
    from .vehicles import vehicle_room

    streets = town.traffic(dense=dense)
    counts = vehicle_room(streets.network.tables), capacity(streets.sidewalks)
    return dict(zip(KEYS, counts, strict=True))


def _counted(traffic: Mapping[str, int], lights: bool) -> TrafficConfig:
    return TrafficConfig(traffic.get("vehicles", 0), traffic.get("pedestrians", 0), lights)


TOWN01_LANE_M = 4960.0
"""Metres of road lane in Town01, junctions aside."""


def road_lane_m(town: CompiledTown) -> float:
    """Metres of lane outside junctions."""
    return sum(lane.length_m for lane in town.lanes if not lane.in_junction)
