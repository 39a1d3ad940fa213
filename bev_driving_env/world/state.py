"""``WorldState``: all that changes while driving, as a handful of arrays over N worlds."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..kernels import layout
from ..kernels.walks import PED_MOTION_COLUMNS, PED_TRACK_COLUMNS


@dataclass(eq=False)
class WorldState:
    """Arrays over N worlds; columns are named in ``kernels.layout``.

    Attributes:
        ego: (N, 4) x, y, heading, speed.
        command: (N, 2) the last action.
        route_points: (N, R, 4) planned lane centre and direction; rows past ``route_size`` are
            padding.
        route_size: (N,) number of valid route points.
        route_spacing: (N,) metres between them.
        route_length: (N,) metres.
        progress: (N, 5) route position, metres done, lateral error, heading error, distance.
        timers: (N, 6) how long something has lasted, or will; see ``kernels.layout``.
        travelled: (N, 2) metres driven, and of them outside the lanes.
        involved: (N, 3) number of the actor of the last infraction with one, by kind.
        waiting: (N,) whether there is something to wait for.
        holding: (N,) bits of the infractions that hold now.
        steps: (N,) control steps since reset.
        time_limit: (N,) control steps after which the episode is truncated.
        returns: (N,) sum of rewards since reset.
        vehicles: (N, V, 6) other vehicles; a row of length 0 is an empty slot.
        pedestrians: (N, P, 6) likewise.
        signals: (N, S) uint8 state of each signal.
        vehicle_track: (N, V, 6) where each vehicle is and goes on the rails.
        vehicle_motion: (N, V, 3) its station, wanted speed and patience.
        pedestrian_track: (N, P, 5) where each pedestrian walks; see ``kernels.walks``.
        pedestrian_motion: (N, P, 11) likewise.
        route_rails: (N, K) rails along the route.
        route_rail_m: (N, K) route position at which each begins, metres.
        route_rail_count: (N,) how many of them are valid.
        attitude: (N, 2) the body's pitch and roll in radians: nose down, right side down.
        episode_seed: (N,) decides all that is random but does not move the car: looks, noise, GPS.
        plan_points: (N, P, 3) sparse plan: x, y, station; rows past ``plan_size`` are padding.
        plan_size: (N,) number of valid plan points.
    """

    ego: NDArray[np.float64]
    command: NDArray[np.float64]
    route_points: NDArray[np.float64]
    route_size: NDArray[np.int64]
    route_spacing: NDArray[np.float64]
    route_length: NDArray[np.float64]
    progress: NDArray[np.float64]
    timers: NDArray[np.float64]
    holding: NDArray[np.int64]
    steps: NDArray[np.int64]
    time_limit: NDArray[np.int64]
    returns: NDArray[np.float64]
    travelled: NDArray[np.float64]
    involved: NDArray[np.int64]
    waiting: NDArray[np.bool_]
    vehicles: NDArray[np.float64]
    pedestrians: NDArray[np.float64]
    signals: NDArray[np.uint8]
    vehicle_track: NDArray[np.int64]
    vehicle_motion: NDArray[np.float64]
    pedestrian_track: NDArray[np.int64]
    pedestrian_motion: NDArray[np.float64]
    route_rails: NDArray[np.int64]
    route_rail_m: NDArray[np.float64]
    route_rail_count: NDArray[np.int64]
    attitude: NDArray[np.float64]
    episode_seed: NDArray[np.int64]
    plan_points: NDArray[np.float64]
    plan_size: NDArray[np.int64]

    @classmethod
    def empty(
        cls, worlds: int, *, vehicles: int = 0, pedestrians: int = 0, signals: int = 0
    ) -> WorldState:
        """State of ``worlds`` worlds without routes, with slots for other actors."""
        return cls(
            ego=np.zeros((worlds, layout.EGO_COLUMNS)),
            command=np.zeros((worlds, 2)),
            route_points=np.zeros((worlds, 2, layout.ROUTE_COLUMNS)),
            route_size=np.zeros(worlds, np.int64),
            route_spacing=np.ones(worlds),
            route_length=np.zeros(worlds),
            progress=np.zeros((worlds, layout.PROGRESS_COLUMNS)),
            timers=np.zeros((worlds, layout.TIMERS)),
            holding=np.zeros(worlds, np.int64),
            steps=np.zeros(worlds, np.int64),
            time_limit=np.zeros(worlds, np.int64),
            returns=np.zeros(worlds),
            travelled=np.zeros((worlds, layout.DISTANCES)),
            involved=np.zeros((worlds, layout.INVOLVED), np.int64),
            waiting=np.zeros(worlds, np.bool_),
            vehicles=np.zeros((worlds, vehicles, layout.ACTOR_COLUMNS)),
            pedestrians=np.zeros((worlds, pedestrians, layout.ACTOR_COLUMNS)),
            signals=np.zeros((worlds, signals), np.uint8),
            vehicle_track=np.zeros((worlds, vehicles, layout.TRACK_COLUMNS), np.int64),
            vehicle_motion=np.zeros((worlds, vehicles, layout.MOTION_COLUMNS)),
            pedestrian_track=np.zeros((worlds, pedestrians, PED_TRACK_COLUMNS), np.int64),
            pedestrian_motion=np.zeros((worlds, pedestrians, PED_MOTION_COLUMNS)),
            route_rails=np.zeros((worlds, 1), np.int64),
            route_rail_m=np.zeros((worlds, 1)),
            route_rail_count=np.zeros(worlds, np.int64),
            attitude=np.zeros((worlds, 2)),
            episode_seed=np.zeros(worlds, np.int64),
            plan_points=np.zeros((worlds, 1, 3)),
            plan_size=np.zeros(worlds, np.int64),
        )

    def copy(self) -> WorldState:
        """An independent copy."""
        return WorldState(**{item.name: getattr(self, item.name).copy() for item in fields(self)})

    def nbytes(self) -> int:
        """Memory of all arrays, in bytes."""
        return sum(getattr(self, item.name).nbytes for item in fields(self))

    def clear(self, world: int) -> None:
        """Zero everything of one world but its route."""
        for item in fields(self):
            if not item.name.startswith(("route_", "plan_")):
                getattr(self, item.name)[world] = 0

    def set_route(
        self,
        world: int,
        points: NDArray[np.float64],
        length_m: float,
        plan: NDArray[np.float64] | None = None,
    ) -> None:
        """Give a world a route of points (R, 4) and its sparse plan (P, 3)."""
        self.route_points = _with_row(self.route_points, world, points)
        self.route_size[world] = len(points)
        self.route_spacing[world] = length_m / (len(points) - 1)
        self.route_length[world] = length_m
        plan = np.zeros((0, 3)) if plan is None else plan
        self.plan_points = _with_row(self.plan_points, world, plan)
        self.plan_size[world] = len(plan)

    def set_route_rails(
        self, world: int, rails: NDArray[np.int64], positions_m: NDArray[np.float64]
    ) -> None:
        """Tell traffic which rails (K,) a world's route runs along, and where each begins."""
        self.route_rails = _with_row(self.route_rails, world, rails)
        self.route_rail_m = _with_row(self.route_rail_m, world, positions_m)
        self.route_rail_count[world] = len(rails)


Table = TypeVar("Table", NDArray[np.float64], NDArray[np.int64])


def _with_row(table: Table, world: int, rows: Table) -> Table:
    """Write one world's rows into a table (N, R, ...), making room in all worlds if need be."""
    size, capacity = len(rows), table.shape[1]
    if size > capacity:
        grown = np.zeros((len(table), size, *table.shape[2:]), table.dtype)
        grown[:, :capacity] = table
        table = grown
    table[world, :size] = rows
    table[world, size:] = 0
    return table
