"""``TownNetwork``: a highway-env road network that also knows its kerbs, junctions and signals."""

from __future__ import annotations

from dataclasses import dataclass

from highway_env.road.road import LaneIndex, RoadNetwork


@dataclass(frozen=True)
class CrossSection:
    """What lies beside the driving lanes, in metres.

    Attributes:
        shoulder_m: Paved strip outside the outer lane edge; part of the drivable surface.
        sidewalk_m: Sidewalk outside the shoulder.
    """

    shoulder_m: float = 0.0
    sidewalk_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shoulder_m", "sidewalk_m"):
            value = getattr(self, name)
            if not 0.0 <= value <= 20.0:
                raise ValueError(f"{name} must be from 0 to 20 m, got {value!r}")


@dataclass(frozen=True)
class Signal:
    """A traffic signal and the stop line it governs.

    Attributes:
        lane: The lane that ends at the stop line.
        x: World x of the signal head, metres.
        y: World y of the signal head, metres.
        phase: Which of its junction's phases gives green to this approach.
        junction: Name of the junction.
    """

    lane: LaneIndex
    x: float
    y: float
    phase: int
    junction: str


class TownNetwork(RoadNetwork):  # type: ignore[misc]
    """A road network with what highway-env has no place for.

    Any plain ``RoadNetwork`` can become a town; this subclass adds what a plain one lacks.

    Attributes:
        cross_section: Shoulders and sidewalks along every lane.
        junction_lanes: Lanes inside junctions; a plain network's are found from its graph.
        signals: Traffic signals with their stop lines.
    """

    def __init__(self, cross_section: CrossSection | None = None) -> None:
        super().__init__()
        self.cross_section = cross_section or CrossSection()
        self.junction_lanes: set[LaneIndex] = set()
        self.signals: list[Signal] = []
