"""Placing vehicles on a town's roads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.layout import (
    ACTOR_COLUMNS,
    LENGTH,
    MOTION_COLUMNS,
    RAIL,
    STATION,
    TRACK_COLUMNS,
    WANTED_MPS,
    WIDTH,
)
from ..kernels.rails import Rails, rail_pose
from ..kernels.vehicles import set_out


class VehicleKind(NamedTuple):
    """One kind of vehicle; ranges are from and to.

    Attributes:
        name: What it is.
        share: Share of the traffic.
        length_m: Range of lengths.
        width_m: Range of widths.
        wanted_mps: Range of speeds on an empty straight.
    """

    name: str
    share: float
    length_m: tuple[float, float]
    width_m: tuple[float, float]
    wanted_mps: tuple[float, float]


KINDS = (
    VehicleKind("car", 0.68, (3.7, 4.9), (1.7, 1.95), (5.5, 8.0)),
    VehicleKind("van", 0.14, (5.2, 6.0), (1.95, 2.1), (5.0, 7.0)),
    VehicleKind("truck", 0.08, (6.6, 7.3), (2.3, 2.45), (4.5, 6.0)),
    VehicleKind("motorbike", 0.10, (2.0, 2.3), (0.75, 0.9), (6.0, 8.5)),
)
SLOT_M = 11.0
"""One vehicle per this many metres of road at the start, which leaves room for the longest."""
JITTER_M = 1.5
EGO_CLEAR_M = 14.0


def vehicle_slots(rails: Rails) -> NDArray[np.float64]:
    """Places (K, 4) on roads where vehicles can start: rail, station, world x and y."""
    slots = []
    for rail in np.flatnonzero(~rails.movement).tolist():
        length = float(rails.length[rail])
        count = int((length - 2.0) // SLOT_M)
        for station in (np.arange(count) + 0.5) * (length / max(count, 1)):
            slots.append((rail, station, *rail_pose(rails, rail, station)[:2]))
    return np.array(slots, np.float64).reshape(-1, 4)


def vehicle_room(rails: Rails) -> int:
    """How many vehicles there is room for, wherever on the roads the ego starts."""
    places = vehicle_slots(rails)[:, 2:]
    if not len(places):
        return 0
    # an ego between two places takes at most what lies this near to one of them
    near = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) < EGO_CLEAR_M + SLOT_M
    return max(len(places) - int(near.sum(axis=1).max()), 0)


def place_vehicles(
    rails: Rails,
    slots: NDArray[np.float64],
    count: int,
    seed: int,
    ego: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Place standing vehicles at random, none near the ego and none touching another.

    Args:
        rails: The town's rails.
        slots: (K, 4) of ``vehicle_slots``.
        count: How many.
        seed: The episode's, from which the vehicles choose their ways.
        ego: World x, y of the ego.
        rng: Source of randomness.

    Returns:
        Rows (V, 6), tracks (V, 6) and motions (V, 3) of the state.

    Raises:
        ValueError: There is not enough room.
    """
    free = slots[np.hypot(slots[:, 2] - ego[0], slots[:, 3] - ego[1]) > EGO_CLEAR_M]
    if count > len(free):
        raise ValueError(f"there is room for {len(free)} vehicles, got {count}; ask for fewer")
    chosen = free[rng.choice(len(free), count, replace=False)]
    kind = rng.choice(len(KINDS), count, p=[item.share for item in KINDS])
    ranges = np.array([[k.length_m, k.width_m, k.wanted_mps] for k in KINDS])[kind]  # (V, 3, 2)
    draws = ranges[:, :, 0] + rng.random((count, 3)) * (ranges[:, :, 1] - ranges[:, :, 0])
    rows = np.zeros((count, ACTOR_COLUMNS))
    track = np.zeros((count, TRACK_COLUMNS), np.int64)
    motion = np.zeros((count, MOTION_COLUMNS))
    rows[:, LENGTH], rows[:, WIDTH] = draws[:, 0], draws[:, 1]
    track[:, RAIL] = chosen[:, 0]
    motion[:, STATION] = chosen[:, 1] + rng.uniform(-JITTER_M, JITTER_M, count)
    motion[:, WANTED_MPS] = draws[:, 2]
    set_out(rails, seed, rows, track, motion)
    return rows, track, motion
