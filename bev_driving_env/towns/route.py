"""Routes over a lane graph: found by turns, by shortest path, or at random."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .compiled import CompiledTown, Lane

SPACING_M = 0.5
TURN_RAD = math.radians(30.0)
HEADING_WEIGHT_M = 4.0
"""When a heading is given, pointing the opposite way counts like this many metres times pi."""


@dataclass(frozen=True)
class Route:
    """A drive along consecutive lanes.

    Attributes:
        town: The town it lies in.
        lanes: Lane numbers in order.
        start_m: Station on the first lane where it starts.
        end_m: Station on the last lane where it ends.

    Raises:
        ValueError: The lanes do not lead on to each other, or it ends before it starts.
    """

    town: CompiledTown = field(repr=False)
    lanes: tuple[int, ...]
    start_m: float
    end_m: float

    def __post_init__(self) -> None:
        for lane, following in zip(self.lanes[:-1], self.lanes[1:], strict=True):
            if following not in self.town.successors[lane]:
                raise ValueError(
                    f"lane {self.town.lanes[lane].index} does not lead on to "
                    f"{self.town.lanes[following].index}"
                )
        if not self.lanes or self.length_m < 1.0:
            raise ValueError(f"a route must be at least 1 m long, got {self.length_m:.2f} m")

    @functools.cached_property
    def length_m(self) -> float:
        """Length along the lane centres."""
        chain = [self.town.lanes[number] for number in self.lanes]
        return lane_offsets(chain)[-1] + self.end_m - self.start_m

    @functools.cached_property
    def points(self) -> NDArray[np.float64]:
        """Evenly spaced points (R, 4), at most 0.5 m apart: x, y and unit direction."""
        chain = [self.town.lanes[number] for number in self.lanes]
        return resample(chain, self.start_m, self.length_m)

    @property
    def spacing_m(self) -> float:
        """Distance between consecutive points along the route."""
        return self.length_m / (len(self.points) - 1)

    @functools.cached_property
    def turns(self) -> str:
        """The decisions along the route, as ``"D4L B4L B5R"`` (left, right, straight on)."""
        words = []
        for lane, following in zip(self.lanes[:-1], self.lanes[1:], strict=True):
            if len(self.town.successors[lane]) > 1:
                start = self.town.lanes[following]
                words.append(start.junction + turn_letter(self.town, following))
        return " ".join(words)


def lane_offsets(chain: Sequence[Lane]) -> list[float]:
    """Distance from the start of the first lane to the start of each, gaps included."""
    offsets = [0.0]
    for lane, following in itertools.pairwise(chain):
        gap = float(np.hypot(*(following.points[0, :2] - lane.points[-1, :2])))
        offsets.append(offsets[-1] + lane.length_m + gap)
    return offsets


def resample(chain: Sequence[Lane], start_m: float, length_m: float) -> NDArray[np.float64]:
    """Evenly spaced points along consecutive lanes.

    Args:
        chain: The lanes, in driving order.
        start_m: Station on the first lane of the first point.
        length_m: Distance from the first to the last point.

    Returns:
        Points (R, 4), at most 0.5 m apart: x, y and unit direction.
    """
    stations = [
        lane.stations + offset for lane, offset in zip(chain, lane_offsets(chain), strict=True)
    ]
    along, curve = np.concatenate(stations), np.concatenate([lane.points for lane in chain])
    wanted = np.linspace(start_m, start_m + length_m, max(2, math.ceil(length_m / SPACING_M) + 1))
    result = np.column_stack([np.interp(wanted, along, column) for column in curve.T])
    result[:, 2:] /= np.linalg.norm(result[:, 2:], axis=1, keepdims=True)
    return result


def turn_letter(town: CompiledTown, lane: int) -> str:
    """``"L"``, ``"R"`` or ``"S"``: which way a movement that starts with a lane goes in the end."""
    change = 0.0
    number = lane
    for _ in range(len(town.lanes)):
        change += town.lanes[number].heading_change_rad
        following = town.successors[number]
        if len(following) != 1 or not town.lanes[following[0]].in_junction:
            break
        number = following[0]
    if abs(change) < TURN_RAD:
        return "S"
    return "R" if change > 0.0 else "L"


def locate(
    town: CompiledTown, x: float, y: float, heading_rad: float | None = None
) -> tuple[int, float]:
    """Nearest lane and station to a world point, lanes in junctions last.

    Args:
        town: The town.
        x: World x.
        y: World y.
        heading_rad: Direction of travel, to tell overlapping lanes apart.

    Returns:
        Lane number and station in metres.
    """
    best, best_cost = (0, 0.0), math.inf
    for number, lane in enumerate(town.lanes):
        station, distance = lane.nearest(x, y)
        cost = distance + (0.5 if lane.in_junction else 0.0)
        if heading_rad is not None:
            turn = math.remainder(lane.pose_at(station)[2] - heading_rad, 2.0 * math.pi)
            cost += HEADING_WEIGHT_M * abs(turn)
        if cost < best_cost:
            best, best_cost = (number, station), cost
    return best


def route_by_turns(
    town: CompiledTown, start: tuple[float, float], turns: str, end: tuple[float, float]
) -> Route:
    """Follow a sequence of junction decisions from a start to an end point.

    Args:
        town: The town.
        start: World point on the first lane.
        turns: Decisions as ``"D4L B4L B5R"``; corners need none.
        end: World point on the last lane.

    Returns:
        The route.

    Raises:
        ValueError: A decision is impossible where it comes up, or the end is never reached.
    """
    lane, start_m = locate(town, *start)
    end_lane, end_m = locate(town, *end)
    lanes, words = [lane], turns.split()
    while words or lane != end_lane or (len(lanes) == 1 and end_m <= start_m):
        options = town.successors[lane]
        lane = options[0] if len(options) == 1 else _decide(town, lane, words, turns)
        lanes.append(lane)
        if len(lanes) > 4 * len(town.lanes):
            raise ValueError(f"route {turns!r} from {start} never comes to its end {end}")
    return Route(town, tuple(lanes), start_m, end_m)


def _decide(town: CompiledTown, lane: int, words: list[str], turns: str) -> int:
    """Take the first decision off the list and return the lane it means."""
    options = {town.lanes[k].junction + turn_letter(town, k): k for k in town.successors[lane]}
    if not words:
        raise ValueError(f"route {turns!r} does not say where to go: {', '.join(options)}")
    word = words.pop(0)
    if word not in options:
        raise ValueError(f"route {turns!r}: {word!r} is not possible; choose {', '.join(options)}")
    return options[word]


def shortest_route(town: CompiledTown, start: tuple[int, float], goal: tuple[int, float]) -> Route:
    """Metric shortest route between two (lane, station) places, by Dijkstra on lane lengths.

    Raises:
        ValueError: The goal cannot be reached.
    """
    (lane, start_m), (goal_lane, end_m) = start, goal
    if lane == goal_lane and end_m > start_m:
        return Route(town, (lane,), start_m, end_m)
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    # an edge a -> b costs the length of b, so paths between lanes add up what lies between
    edges = [(a, b) for a, following in enumerate(town.successors) for b in following]
    lengths = [town.lanes[b].length_m for _, b in edges]
    count = len(town.lanes)
    graph = csr_array((lengths, tuple(zip(*edges, strict=True))), shape=(count, count))
    sources = list(town.successors[lane])
    costs, before = dijkstra(graph, indices=sources, return_predecessors=True)
    totals = [costs[i, goal_lane] + town.lanes[k].length_m for i, k in enumerate(sources)]
    best = int(np.argmin(totals))
    if not math.isfinite(totals[best]):
        raise ValueError(
            f"no way leads from lane {town.lanes[lane].index} to {town.lanes[goal_lane].index}"
        )
    path = [goal_lane]
    while path[-1] != sources[best]:
        path.append(int(before[best, path[-1]]))
    return Route(town, (lane, *reversed(path)), start_m, end_m)


def random_route(
    town: CompiledTown, rng: np.random.Generator, shortest_m: float, longest_m: float
) -> Route:
    """A random walk over the lane graph that starts and ends outside junctions.

    In a network that is nothing but junctions, as small plain ones can be, anywhere will do.

    Args:
        town: The town.
        rng: Source of randomness.
        shortest_m: Least length.
        longest_m: Greatest length; a walk that would end inside a junction is drawn anew.

    Returns:
        The route.

    Raises:
        ValueError: No such route was found in 1,000 draws.
    """
    roads = [number for number, lane in enumerate(town.lanes) if not lane.in_junction]
    roads = roads or list(range(len(town.lanes)))
    lengths = np.array([town.lanes[number].length_m for number in roads])
    for _ in range(1000):
        lane = roads[rng.choice(len(roads), p=lengths / lengths.sum())]
        start_m = float(rng.uniform(0.0, town.lanes[lane].length_m))
        wanted_m = start_m + float(rng.uniform(shortest_m, longest_m))
        lanes = [lane]
        while wanted_m > town.lanes[lane].length_m:
            wanted_m -= town.lanes[lane].length_m
            lane = int(rng.choice(town.successors[lane]))
            lanes.append(lane)
        if lane in roads and wanted_m > 1.0:
            return Route(town, tuple(lanes), start_m, wanted_m)
    raise ValueError(
        f"town {town.name!r} has no route of {shortest_m:g} to {longest_m:g} m that ends on a road"
    )
