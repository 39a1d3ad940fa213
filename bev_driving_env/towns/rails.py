"""Rails of a town: its lanes chained into roads and movements that traffic drives along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernels.rails import CONFLICT_COLUMNS, CROSSING_COLUMNS, RAIL_X, RAIL_Y, Rails
from .compiled import CompiledTown
from .conflicts import find_conflicts, movement_clusters
from .route import Route, lane_offsets, resample

LATERAL_MPS2 = 2.0
"""Greatest lateral acceleration of traffic in curves."""
BRAKING_MPS2 = 2.0
"""Deceleration of traffic before curves."""
LEAST_CURVATURE = 1e-6
"""Curvature (1/m) that counts as straight, so that no speed is infinite."""


@dataclass(frozen=True, eq=False)
class RailNetwork:
    """A town's rails and how they relate to its lanes and junctions.

    Attributes:
        tables: The rails as kernels read them; G rails.
        lanes: Lane numbers of each rail, in driving order.
        lane_rail: (L,) rail of each lane.
        lane_offset: (L,) station on its rail, in metres, at which each lane begins.
        junction: (G,) number of the junction that a movement lies in or a road leads to; -1 for
            roads that lead to none.
        junctions: Names of the junctions by number: first those with signals in the order of the
            town's signals, then others, named after the node where their first movement starts.
    """

    tables: Rails
    lanes: tuple[tuple[int, ...], ...]
    lane_rail: NDArray[np.int64]
    lane_offset: NDArray[np.float64]
    junction: NDArray[np.int64]
    junctions: tuple[str, ...]


def build_rails(town: CompiledTown, crossing_lines: ArrayLike | None = None) -> RailNetwork:
    """Chain a town's lanes into rails and find out all that is fixed about them.

    Args:
        town: The town; dead ends are allowed.
        crossing_lines: (C, 4) pedestrian crossings ax, ay, bx, by from kerb to kerb, metres in the
            world frame; none by default.

    Returns:
        The rails, in the order of their first lanes.

    Raises:
        ValueError: The crossings are not of that shape or not finite, or a lane has no length.
    """
    lines = _checked_lines(crossing_lines)
    chains = chain_lanes(town)
    lane_rail = np.empty(len(town.lanes), dtype=np.int64)
    lane_offset = np.empty(len(town.lanes))
    for rail, numbers in enumerate(chains):
        lane_rail[list(numbers)] = rail
        lane_offset[list(numbers)] = lane_offsets([town.lanes[k] for k in numbers])
    sampled = [_sample(town, numbers) for numbers in chains]
    first = np.concatenate([[0], np.cumsum([len(samples) for samples, _ in sampled])])
    following = [[int(lane_rail[k]) for k in town.successors[chain[-1]]] for chain in chains]
    movement = np.array([town.lanes[chain[0]].in_junction for chain in chains])
    length = np.array([length_m for _, length_m in sampled])
    tables = Rails(
        first=first.astype(np.int64),
        step_m=length / (np.diff(first) - 1),
        length=length,
        samples=np.concatenate([samples for samples, _ in sampled]),
        following=_padded(following),
        approach=_approaches(following, movement),
        movement=movement,
        signal=_signals(town, chains, movement),
        conflict_first=np.zeros(len(chains) + 1, dtype=np.int64),
        conflicts=np.zeros((0, CONFLICT_COLUMNS)),
        crossing_first=np.zeros(len(chains) + 1, dtype=np.int64),
        crossings=np.zeros((0, CROSSING_COLUMNS)),
    )
    conflict_first, conflicts = find_conflicts(tables)
    crossing_first, crossings = _crossings(tables, lines)
    tables = tables._replace(
        conflict_first=conflict_first,
        conflicts=conflicts,
        crossing_first=crossing_first,
        crossings=crossings,
    )
    junction, junctions = _junctions(town, tables, chains)
    return RailNetwork(tables, chains, lane_rail, lane_offset, junction, junctions)


def chain_lanes(town: CompiledTown) -> tuple[tuple[int, ...], ...]:
    """All lanes as maximal chains without a choice: lane numbers, each exactly once.

    A lane and the next are in one chain if no other way leads out of the one or into the other and
    both or none lie in a junction. A closed ring starts with its lowest lane number.
    """
    arriving = [0] * len(town.lanes)
    for following in town.successors:
        for number in following:
            arriving[number] += 1
    onward: dict[int, int] = {}
    for number, following in enumerate(town.successors):
        alike = [
            k for k in following if town.lanes[k].in_junction == town.lanes[number].in_junction
        ]
        if len(following) == 1 and alike and arriving[following[0]] == 1:
            onward[number] = following[0]
    entered = set(onward.values())
    chains: list[tuple[int, ...]] = []
    done: set[int] = set()
    # what has a beginning first; only rings remain
    for start in sorted(range(len(town.lanes)), key=lambda number: number in entered):
        chain: list[int] = []
        lane: int | None = start
        while lane is not None and lane not in done:
            done.add(lane)
            chain.append(lane)
            lane = onward.get(lane)
        if chain:
            chains.append(tuple(chain))
    return tuple(sorted(chains))


def route_rails(
    network: RailNetwork, route: Route
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The rails that a route runs along.

    Args:
        network: The rails of the route's town.
        route: The route.

    Returns:
        Rails (K,) in driving order, and for each the route position (K,) in metres at which its
        station 0 lies: negative for the first unless the route starts with the rail.

    Raises:
        ValueError: The route lies in a town with another number of lanes.
    """
    if len(route.town.lanes) != len(network.lane_rail):
        raise ValueError(
            f"the route lies in town {route.town.name!r} with {len(route.town.lanes)} lanes, the "
            f"rails were built for one with {len(network.lane_rail)}; build them for that town"
        )
    rails: list[int] = []
    positions: list[float] = []
    offsets = lane_offsets([route.town.lanes[number] for number in route.lanes])
    for number, offset in zip(route.lanes, offsets, strict=True):
        rail = int(network.lane_rail[number])
        if not rails or number == network.lanes[rail][0]:
            rails.append(rail)
            positions.append(offset - route.start_m - network.lane_offset[number])
    return np.array(rails, dtype=np.int64), np.array(positions, dtype=np.float64)


def _checked_lines(crossing_lines: ArrayLike | None) -> NDArray[np.float64]:
    lines = np.zeros((0, 4)) if crossing_lines is None else np.array(crossing_lines, np.float64)
    if lines.ndim != 2 or lines.shape[1] != 4 or not np.isfinite(lines).all():
        raise ValueError(f"crossing_lines must be finite and of shape (C, 4), got {lines.shape}")
    return lines


def _sample(town: CompiledTown, numbers: tuple[int, ...]) -> tuple[NDArray[np.float64], float]:
    """Samples (S, 4) of a chain of lanes as in ``Rails``, and its length in metres."""
    chain = [town.lanes[number] for number in numbers]
    offsets = lane_offsets(chain)
    length_m = offsets[-1] + chain[-1].length_m
    if not length_m > 0.0:
        raise ValueError(
            f"lane {chain[0].index} of town {town.name!r} is {length_m!r} m long; every lane must "
            "be longer than 0 m"
        )
    points = resample(chain, 0.0, length_m)
    step_m = length_m / (len(points) - 1)
    stations = np.arange(len(points)) * step_m
    heading = np.unwrap(np.arctan2(points[:, 3], points[:, 2]))
    lane = np.searchsorted(offsets, stations, side="right") - 1
    limit = np.array([lane.speed_limit_mps for lane in chain])[lane]
    bend = np.maximum(np.abs(np.gradient(heading, step_m)), LEAST_CURVATURE)
    top = np.minimum(limit, np.sqrt(LATERAL_MPS2 / bend))
    # braking evenly, v squared falls along a line of slope -2 a: the lowest of the lines ahead
    energy = top**2 + 2.0 * BRAKING_MPS2 * stations
    energy = np.minimum.accumulate(energy[::-1])[::-1]
    top = np.minimum(top, np.sqrt(energy - 2.0 * BRAKING_MPS2 * stations))
    return np.column_stack([points[:, :2], heading, top]), length_m


def _padded(following: list[list[int]]) -> NDArray[np.int64]:
    table = np.full((len(following), max(1, *map(len, following))), -1, dtype=np.int64)
    for rail, onward in enumerate(following):
        table[rail, : len(onward)] = onward
    return table


def _approaches(following: list[list[int]], movement: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The first road that leads into each movement, or else the first movement; else -1."""
    approach = np.full(len(following), -1, dtype=np.int64)
    # the last to be written stays: roads after movements, and lower numbers after higher ones
    for kind in (True, False):
        for rail in np.flatnonzero(movement == kind)[::-1]:
            for onward in following[rail]:
                if movement[onward]:
                    approach[onward] = rail
    return approach


def _signals(
    town: CompiledTown, chains: tuple[tuple[int, ...], ...], movement: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """The signal at the end of each road, else -1."""
    numbers = {signal.lane: number for number, signal in enumerate(town.signals)}
    ends = [numbers.get(town.lanes[chain[-1]].index, -1) for chain in chains]
    return np.where(movement, -1, np.array(ends, dtype=np.int64))


def _junctions(
    town: CompiledTown, rails: Rails, chains: tuple[tuple[int, ...], ...]
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Number of the junction that each rail lies in or leads to, and the junctions' names."""
    names = list(dict.fromkeys(signal.junction for signal in town.signals))
    signalled = [names.index(signal.junction) for signal in town.signals]
    junction = np.array([signalled[k] if k >= 0 else -1 for k in rails.signal], dtype=np.int64)
    cluster = movement_clusters(rails)
    for number in range(cluster.max(initial=-1) + 1):
        members = np.flatnonzero(cluster == number)
        led = members[rails.approach[members] >= 0]
        junction[led] = junction[rails.approach[led]]
        here = int(junction[members].max())
        if here < 0:
            here = len(names)
            names.append(town.lanes[chains[members[0]][0]].junction)
        junction[members[junction[members] < 0]] = here
    for rail in np.flatnonzero(~rails.movement & (junction < 0)):
        onward = [k for k in rails.following[rail] if k >= 0 and rails.movement[k]]
        if onward:
            junction[rail] = junction[onward[0]]
    return junction, tuple(names)


def _crossings(
    rails: Rails, lines: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """``crossing_first`` and ``crossings`` of ``Rails``: where rails cross line segments."""
    places = rails.samples[:, [RAIL_X, RAIL_Y]]
    counts = np.diff(rails.first)
    rail = np.repeat(np.arange(len(counts)), counts)[:-1]
    row = np.arange(len(places)) - np.repeat(rails.first[:-1], counts)
    steps = np.diff(places, axis=0)
    found = []
    for number, (ax, ay, bx, by) in enumerate(lines):
        along, away = np.array([bx - ax, by - ay]), np.array([ax, ay]) - places[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = steps[:, 0] * along[1] - steps[:, 1] * along[0]
            part = (away[:, 0] * along[1] - away[:, 1] * along[0]) / cross
            where = (away[:, 0] * steps[:, 1] - away[:, 1] * steps[:, 0]) / cross
        # a step owns its start, the last one its end too; rows at a rail's end start no step
        final = row[:-1] == counts[rail] - 2
        hit = (part >= 0.0) & ((part < 1.0) | (final & (part <= 1.0)))
        hit &= (where >= 0.0) & (where <= 1.0) & (row[:-1] < counts[rail] - 1)
        for k in np.flatnonzero(hit):
            station = (row[k] + part[k]) * rails.step_m[rail[k]]
            found.append((int(rail[k]), station, number, float(where[k] >= 0.5)))
    found.sort()
    first = np.bincount([r for r, *_ in found], minlength=len(counts)) if found else counts * 0
    table = [(number, station, side) for _, station, number, side in found]
    return (
        np.concatenate([[0], np.cumsum(first)]).astype(np.int64),
        np.array(table, dtype=np.float64).reshape(-1, CROSSING_COLUMNS),
    )
