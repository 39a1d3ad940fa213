"""``CompiledTown``: a road network turned once into flat arrays and a lane graph."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane, LineType, StraightLane
from highway_env.road.road import LaneIndex, RoadNetwork
from numpy.typing import NDArray

from .furniture import Prop, furnish
from .ground import Ground, build_ground
from .network import CrossSection, Signal, TownNetwork
from .raster import Raster, rasterize_classes, rasterize_directions
from .solids import Solids, index_solids

if TYPE_CHECKING:
    from ..kernels.scenery import Scenery
    from .traffic import TrafficMap

RULES_PX_PER_M = 10.0
"""Resolution at which the rules see the road, whatever the resolution of the BEV."""
DIRECTIONS_PX_PER_M = 5.0
LINE_M = 0.4
"""Width of lane boundaries: 2 px of the default BEV."""
SAMPLE_M = 0.5
LONGEST_JUNCTION_LANE_M = 50.0
JOINT_M = 1.5
"""A lane leads on to another when its end is within this distance of the other's start."""
STOP_LINE_SHARE = 0.8
"""Length of a stop line over the lane width (Roach draws 0.4 of it to each side)."""


@dataclass(frozen=True)
class Lane:
    """One lane as a sampled curve.

    Attributes:
        index: highway-env lane index (from node, to node, id).
        stations: (M,) metres along the lane; two on a straight, every 0.5 m elsewhere.
        points: (M, 4) lane centre x, y and unit direction.
        half_width: (M,) metres.
        lines: Whether there is a boundary line on the left and on the right.
        striped: Whether they are broken lines.
        speed_limit_mps: Speed limit.
        in_junction: Whether the lane lies inside a junction.
    """

    index: LaneIndex
    stations: NDArray[np.float64]
    points: NDArray[np.float64]
    half_width: NDArray[np.float64]
    lines: tuple[bool, bool]
    striped: tuple[bool, bool]
    speed_limit_mps: float
    in_junction: bool = False

    @property
    def length_m(self) -> float:
        """Length along the centre."""
        return float(self.stations[-1])

    @property
    def junction(self) -> str:
        """Name of the node the lane starts from, without its arm."""
        return str(self.index[0]).split(".")[0]

    @property
    def heading_change_rad(self) -> float:
        """Signed heading change from start to end, positive to the right."""
        first, last = self.points[0], self.points[-1]
        cross = first[2] * last[3] - first[3] * last[2]
        return math.atan2(cross, first[2] * last[2] + first[3] * last[3])

    def pose_at(self, station_m: float) -> tuple[float, float, float]:
        """World pose (x, y, heading) of the lane centre at a station."""
        x, y, dx, dy = (np.interp(station_m, self.stations, column) for column in self.points.T)
        return float(x), float(y), math.atan2(dy, dx)

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Station of the point of the lane centre nearest to a world point, and its distance."""
        starts, spans = self.points[:-1, :2], np.diff(self.points[:, :2], axis=0)
        along = ((np.array([x, y]) - starts) * spans).sum(axis=1) / (spans**2).sum(axis=1)
        along = np.clip(along, 0.0, 1.0)
        distances = np.linalg.norm(starts + along[:, None] * spans - (x, y), axis=1)
        i = int(distances.argmin())
        station = self.stations[i] + along[i] * (self.stations[i + 1] - self.stations[i])
        return float(station), float(distances[i])


@dataclass(frozen=True, eq=False)
class CompiledTown:
    """Everything the world needs to know of a town; equal only to itself.

    Attributes:
        name: Name it is registered under.
        lanes: All lanes; lane numbers index this tuple.
        successors: For each lane the numbers of the lanes it leads on to.
        cross_section: Shoulders and sidewalks.
        signals: Traffic signals.
        stop_lines: (S, 4) end points x1, y1, x2, y2 of each signal's stop line.
    """

    name: str
    lanes: tuple[Lane, ...]
    successors: tuple[tuple[int, ...], ...]
    cross_section: CrossSection
    signals: tuple[Signal, ...]
    stop_lines: NDArray[np.float64]
    _furniture: dict[bool, tuple[Prop, ...]] = field(default_factory=dict, repr=False)
    _solids: dict[bool, Solids] = field(default_factory=dict, repr=False)
    _scenery: dict[bool, Scenery] = field(default_factory=dict, repr=False)
    _traffic: dict[bool, TrafficMap] = field(default_factory=dict, repr=False)
    _rasters: dict[tuple[float, float], Raster] = field(default_factory=dict, repr=False)

    def __reduce__(self) -> Any:
        # a registered town is pickled by name: snapshots of its worlds stay small
        from .registry import compiled_town, town_names

        if self.name in town_names() and compiled_town(self.name) is self:
            return compiled_town, (self.name,)
        return super().__reduce__()

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest and largest lane-centre coordinates: x0, y0, x1, y1 in metres."""
        points = np.concatenate([lane.points[:, :2] for lane in self.lanes])
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    def classes(self, px_per_m: float = RULES_PX_PER_M, line_m: float = LINE_M) -> Raster:
        """The raster of static classes at a resolution and line width, made on first use."""
        key = (px_per_m, line_m)
        if key not in self._rasters:
            self._rasters[key] = rasterize_classes(
                self.lanes, self.cross_section, self.bounds, px_per_m, line_m
            )
        return self._rasters[key]

    def furniture(self, *, dense: bool = False) -> tuple[Prop, ...]:
        """Buildings, trees and the like beside the roads, placed on first use."""
        if dense not in self._furniture:
            self._furniture[dense] = furnish(self, dense=dense)
        return self._furniture[dense]

    def solids(self, *, dense: bool = False) -> Solids:
        """The furniture's footprints, indexed for collision tests; made on first use."""
        if dense not in self._solids:
            props = self.furniture(dense=dense)
            boxes = [(p.x, p.y, p.heading, p.length_m, p.width_m) for p in props]
            self._solids[dense] = index_solids(np.array(boxes, np.float64).reshape(-1, 5))
        return self._solids[dense]

    def scenery(self, *, dense: bool = False) -> Scenery:
        """The shapes that cameras see of the furniture, made on first use."""
        if dense not in self._scenery:
            from ..cameras.scenery import build_scenery

            self._scenery[dense] = build_scenery(self, self.furniture(dense=dense))
        return self._scenery[dense]

    def traffic(self, *, dense: bool = False) -> TrafficMap:
        """Where vehicles and pedestrians move, found on first use."""
        if dense not in self._traffic:
            from .traffic import build_traffic_map

            self._traffic[dense] = build_traffic_map(self, dense=dense)
        return self._traffic[dense]

    @functools.cached_property
    def ground(self) -> Ground:
        """The ground as cameras see it, painted on first use."""
        return build_ground(self)

    @functools.cached_property
    def directions(self) -> Raster:
        """The raster of lane directions."""
        return rasterize_directions(self.lanes, self.bounds, DIRECTIONS_PX_PER_M)


def compile_network(
    name: str, network: RoadNetwork, *, allow_dead_ends: bool = False
) -> CompiledTown:
    """Compile any highway-env road network.

    Args:
        name: Name for messages and results.
        network: The road network; a ``TownNetwork`` brings shoulders, signals and junctions along.
        allow_dead_ends: Accept lanes that lead nowhere (for observing, not for routes).

    Returns:
        The compiled town.

    Raises:
        ValueError: The network is empty or has a dead end.
    """
    lanes_dict = network.lanes_dict()
    if not lanes_dict:
        raise ValueError(f"road network {name!r} has no lanes")
    lanes = tuple(_sample(index, lane) for index, lane in lanes_dict.items())
    successors = _successors(lanes)
    inside = _junction_lanes(network, lanes, successors)
    lanes = tuple(
        dataclasses.replace(lane, in_junction=number in inside) for number, lane in enumerate(lanes)
    )
    if not allow_dead_ends:
        for lane, following in zip(lanes, successors, strict=True):
            if not following:
                raise ValueError(
                    f"road network {name!r} has a dead end at node {lane.index[1]!r}: lane "
                    f"{lane.index} leads nowhere; every lane must lead on to another"
                )
    town = network if isinstance(network, TownNetwork) else TownNetwork()
    numbers = {lane.index: number for number, lane in enumerate(lanes)}
    stop_lines = [_stop_line(lanes[numbers[signal.lane]]) for signal in town.signals]
    return CompiledTown(
        name=name,
        lanes=lanes,
        successors=successors,
        cross_section=town.cross_section,
        signals=tuple(town.signals),
        stop_lines=np.array(stop_lines, dtype=np.float64).reshape(-1, 4),
    )


def _junction_lanes(
    network: RoadNetwork, lanes: tuple[Lane, ...], successors: tuple[tuple[int, ...], ...]
) -> set[int]:
    """Numbers of the lanes inside junctions.

    A ``TownNetwork`` tells. In a plain network they are the lanes of at most 50 m that start where
    a lane parts or end where lanes meet.
    """
    if isinstance(network, TownNetwork):
        return {k for k, lane in enumerate(lanes) if lane.index in network.junction_lanes}
    arriving = [0] * len(lanes)
    for following in successors:
        for number in following:
            arriving[number] += 1
    inside: set[int] = set()
    for number, following in enumerate(successors):
        if len(following) > 1:
            inside.update(following)
        if any(arriving[target] > 1 for target in following):
            inside.add(number)
    return {k for k in inside if lanes[k].length_m <= LONGEST_JUNCTION_LANE_M}


def _sample(index: LaneIndex, lane: AbstractLane) -> Lane:
    """Sample a highway-env lane: at its ends if straight, else every half metre."""
    length = float(lane.length)
    count = 2 if type(lane) is StraightLane else max(2, math.ceil(length / SAMPLE_M) + 1)
    where = np.linspace(0.0, length, count)
    centers = np.array([lane.position(s, 0.0) for s in where], dtype=np.float64)
    headings = np.array([lane.heading_at(s) for s in where], dtype=np.float64)
    stations = where
    if type(lane) not in (StraightLane, CircularLane):
        # highway-env measures a SineLane along its chord
        steps_m = np.hypot(*np.diff(centers, axis=0).T)
        stations = np.concatenate([[0.0], np.cumsum(steps_m)])
    limit = lane.speed_limit
    return Lane(
        index=index,
        stations=stations,
        points=np.column_stack([centers, np.cos(headings), np.sin(headings)]),
        half_width=np.array([lane.width_at(s) for s in where], dtype=np.float64) / 2.0,
        lines=(lane.line_types[0] != LineType.NONE, lane.line_types[1] != LineType.NONE),
        striped=(lane.line_types[0] == LineType.STRIPED, lane.line_types[1] == LineType.STRIPED),
        speed_limit_mps=20.0 if limit is None else float(limit),
    )


def _successors(lanes: tuple[Lane, ...]) -> tuple[tuple[int, ...], ...]:
    """For each lane, the lanes that start at its end node and where it ends."""
    starting: dict[str, list[int]] = {}
    for number, lane in enumerate(lanes):
        starting.setdefault(lane.index[0], []).append(number)
    return tuple(
        tuple(
            number
            for number in starting.get(lane.index[1], [])
            if np.hypot(*(lanes[number].points[0, :2] - lane.points[-1, :2])) < JOINT_M
        )
        for lane in lanes
    )


def _stop_line(lane: Lane) -> tuple[float, float, float, float]:
    """End points of the line across the end of a lane."""
    x, y, dx, dy = lane.points[-1]
    half = STOP_LINE_SHARE * lane.half_width[-1]
    return x + dy * half, y - dx * half, x - dy * half, y + dx * half
