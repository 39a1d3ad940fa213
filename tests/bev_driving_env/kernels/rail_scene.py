"""Drivers placed by hand on the rails of a toy town, for the tests of the traffic kernels."""

import math

import numpy as np

from bev_driving_env.kernels.layout import (
    ACTOR_COLUMNS,
    ADMITTED,
    AFTER_RAIL,
    CHOICES,
    DISTANCE,
    HEADING,
    HEADING_ERROR,
    LAST_RAIL,
    LENGTH,
    MOTION_COLUMNS,
    NEXT_RAIL,
    PROGRESS_COLUMNS,
    RAIL,
    ROUTE_POSITION,
    SIGNAL_OFF,
    SPEED,
    STATION,
    TRACK_COLUMNS,
    WAITED_S,
    WANTED_MPS,
    WIDTH,
)
from bev_driving_env.kernels.lineup import ENDS, METRES, NUMBERS, Lineup, line_up
from bev_driving_env.kernels.overlap import boxes_overlap
from bev_driving_env.kernels.rails import rail_pose
from bev_driving_env.kernels.vehicles import step_vehicles
from bev_driving_env.towns.rails import route_rails

FAR_M = 1e4


def empty_lineup(drivers, rails):
    """Room for a number of drivers on a number of rails."""
    numbers, metres = np.zeros((NUMBERS, drivers), np.int64), np.zeros((METRES, drivers))
    ends = np.zeros((ENDS, rails), np.int64)
    return Lineup(*numbers[:3], *metres, *numbers[3:], *ends)


EGO_LENGTH_M, EGO_WIDTH_M = 4.9, 2.0
# where traffic enters and leaves junction B1 of the ladder; its stem comes from the south
ARMS = {
    "E": ((60.0, -2.0), (60.0, 2.0)),
    "S": ((52.0, 10.0), (48.0, 10.0)),
    "W": ((40.0, 2.0), (40.0, -2.0)),
}


class RailScene:
    """One world's vehicles, ego, signals and occupied crossings, without a route for the ego."""

    def __init__(self, town):
        streets = town.traffic()
        self.network, self.rails, self.plan = streets.network, streets.network.tables, streets.plan
        self.crossing_ends = streets.sidewalks.crossings.ends
        self.signals = np.full(len(town.signals), SIGNAL_OFF, np.uint8)
        self.occupied = np.zeros((len(self.crossing_ends), 2), np.uint8)
        self.vehicles = np.zeros((0, ACTOR_COLUMNS))
        self.track = np.zeros((0, TRACK_COLUMNS), np.int64)
        self.motion = np.zeros((0, MOTION_COLUMNS))
        self.ego = np.array([-FAR_M, -FAR_M, 0.0, 0.0])
        self.ego_waited_s = 0.0
        self.progress = np.zeros(PROGRESS_COLUMNS)
        self.progress[DISTANCE] = FAR_M
        self.route_rails, self.route_rail_m = np.zeros(1, np.int64), np.zeros(1)
        self.route_rail_count = 0

    def approach(self, arm):
        """The road that ends at an arm of B1."""
        return self._where(lambda rail: self._ends(rail)[1], ARMS[arm][0], movement=False)

    def exit(self, arm):
        """The road that begins at an arm of B1."""
        return self._where(lambda rail: self._ends(rail)[0], ARMS[arm][1], movement=False)

    def movement(self, way):
        """The movement through B1 of a way such as "WE", from the west to the east."""
        ends = (*ARMS[way[0]][0], *ARMS[way[1]][1])
        return self._where(lambda rail: sum(self._ends(rail), ()), ends, movement=True)

    def _ends(self, rail):
        stations = (0.0, self.rails.length[rail])
        return tuple(tuple(rail_pose(self.rails, rail, station)[:2]) for station in stations)

    def _where(self, key, wanted, *, movement):
        (rail,) = (
            int(rail)
            for rail in np.flatnonzero(self.rails.movement == movement)
            if np.allclose(key(rail), wanted, atol=0.01)
        )
        return rail

    def add(
        self,
        rail,
        station,
        onward=-1,
        after=-1,
        *,
        speed=0.0,
        length=4.0,
        width=1.8,
        wanted=8.0,
        waited=0.0,
        admitted=False,
    ):
        """Put a vehicle on a rail; returns its number."""
        row, track, motion = (np.zeros(a.shape[1], a.dtype) for a in self._tables())
        row[:3] = rail_pose(self.rails, rail, float(station))
        row[SPEED], row[LENGTH], row[WIDTH] = speed, length, width
        track[[RAIL, NEXT_RAIL, AFTER_RAIL, LAST_RAIL]] = rail, onward, after, -1
        track[CHOICES], track[ADMITTED] = 2, admitted
        motion[[STATION, WANTED_MPS, WAITED_S]] = station, wanted, waited
        self.vehicles = np.vstack([self.vehicles, row])
        self.track = np.vstack([self.track, track])
        self.motion = np.vstack([self.motion, motion])
        return len(self.vehicles) - 1

    def _tables(self):
        return self.vehicles, self.track, self.motion

    def approaching(self, way, line_m=1.0, *, length=4.0, **state):
        """Put a vehicle so far before its line at B1, on its way through it."""
        road, movement = self.approach(way[0]), self.movement(way)
        station = self.rails.length[road] - line_m - length / 2.0
        return self.add(road, station, movement, self.exit(way[1]), length=length, **state)

    def send_ego(self, route, position, *, speed=0.0):
        """Put the ego on a route."""
        points = route.points
        row = min(round(position / route.spacing_m), len(points) - 1)
        x, y, dx, dy = points[row]
        self.ego[:] = x, y, math.atan2(dy, dx), speed
        self.progress[:] = 0.0
        self.progress[ROUTE_POSITION] = position
        self.route_rails, self.route_rail_m = route_rails(self.network, route)
        self.route_rail_count = len(self.route_rails)

    def turn_ego_off(self, *, distance_m=0.0, error_rad=0.0):
        self.progress[DISTANCE], self.progress[HEADING_ERROR] = distance_m, error_rad

    def line_up(self):
        lineup = empty_lineup(len(self.vehicles) + 1, len(self.rails.length))
        line_up(
            self.rails,
            *self._tables(),
            self.ego,
            EGO_LENGTH_M,
            self.ego_waited_s,
            self.progress,
            self.route_rails,
            self.route_rail_m,
            self.route_rail_count,
            lineup,
        )
        return lineup

    def step(self, dt_s=0.1, seed=0):
        step_vehicles(
            self.rails,
            dt_s,
            seed,
            self.signals,
            self.occupied,
            self.ego,
            EGO_LENGTH_M / 2.0,
            EGO_WIDTH_M / 2.0,
            self.line_up(),
            np.empty(len(self.vehicles)),
            *self._tables(),
        )

    def front_m(self, i):
        """Metres from the front of a vehicle to the end of its rail."""
        station, length = self.motion[i, STATION], self.vehicles[i, LENGTH]
        return self.rails.length[self.track[i, RAIL]] - station - length / 2.0


def touch(a, b):
    """Whether the footprints of two actor rows (6,) overlap."""
    return boxes_overlap(*_box(a), *_box(b))


def anybody_touches(vehicles):
    """Whether any two of the vehicles (V, 6) overlap."""
    near = np.hypot(*(vehicles[:, None, :2] - vehicles[None, :, :2]).T) < 8.0
    return any(touch(vehicles[i], vehicles[j]) for i, j in np.argwhere(np.triu(near, 1)))


def _box(row):
    heading = row[HEADING]
    return *row[:2], math.cos(heading), math.sin(heading), row[LENGTH] / 2.0, row[WIDTH] / 2.0
