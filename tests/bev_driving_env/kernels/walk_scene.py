"""Pedestrians of one world, for the tests of their kernels."""

import numpy as np

from bev_driving_env.kernels.crowd import empty_crowd
from bev_driving_env.kernels.layout import ACTOR_COLUMNS, LENGTH, SIGNAL_OFF, WIDTH, X, Y
from bev_driving_env.kernels.pedestrians import step_pedestrians
from bev_driving_env.kernels.walks import (
    ALONG_M,
    CROSSING,
    DIRECTION,
    KERB_M,
    MODE,
    ON_CROSSING,
    PACE_MPS,
    PED_MOTION_COLUMNS,
    PED_TRACK_COLUMNS,
    PLACE,
    WAITING,
    WALK,
    WALK_STATION,
    walk_point,
)

FAR = np.array([-900.0, -900.0, 0.0, 0.0])


class Street:
    """Pedestrians of one world on the ladder, stepped with what the test sets."""

    def __init__(self, sidewalks, rows, track, motion, seed=11):
        self.walks, self.crossings = sidewalks.walks, sidewalks.crossings
        self.rows, self.track, self.motion, self.seed = rows, track, motion, seed
        self.signals = np.full(6, SIGNAL_OFF, np.uint8)
        self.threatened = np.zeros(len(self.crossings.length), np.uint8)
        self.ego, self.vehicles = FAR, np.zeros((0, ACTOR_COLUMNS))

    def step(self, count=1):
        crowd = empty_crowd(len(self.rows))
        for _ in range(count):
            step_pedestrians(
                self.walks,
                self.crossings,
                0.1,
                self.seed,
                self.signals,
                self.threatened,
                self.ego,
                2.3,
                1.0,
                self.vehicles,
                crowd,
                self.rows,
                self.track,
                self.motion,
            )

    def on_road(self):
        """Which crossing everybody is on the road part of; -1 for none."""
        crossing = self.track[:, CROSSING]
        along = self.motion[:, ALONG_M]
        inside = (along > 0.0) & (along < self.crossings.length[crossing])
        return np.where((self.track[:, MODE] == ON_CROSSING) & inside, crossing, -1)

    def done(self, i=0):
        """Metres that pedestrian i is past the kerb he started from."""
        along = self.motion[i, ALONG_M]
        length = self.crossings.length[self.track[i, CROSSING]]
        return along if self.track[i, DIRECTION] > 0 else length - along


def people_on_walk(sidewalks, *stations, walk=0, direction=1, kerb_m=2.0, size=0.5):
    """People of pace 1.3 at stations of a walk, all going one way."""
    count = len(stations)
    rows = np.zeros((count, ACTOR_COLUMNS))
    track = np.zeros((count, PED_TRACK_COLUMNS), np.int64)
    motion = np.zeros((count, PED_MOTION_COLUMNS))
    rows[:, [LENGTH, WIDTH]] = size
    track[:, WALK], track[:, DIRECTION], track[:, CROSSING] = walk, direction, -1
    motion[:, WALK_STATION], motion[:, KERB_M] = stations, kerb_m
    motion[:, PACE_MPS], motion[:, PLACE] = 1.3, 0.5
    for k, station in enumerate(stations):
        rows[k, [X, Y]] = walk_point(sidewalks.walks, walk, station, kerb_m)
    return Street(sidewalks, rows, track, motion)


def one_at_kerb(sidewalks, c, seed=11):
    """One at the kerb of a crossing's first end, about to cross."""
    walk, station = sidewalks.crossings.walk[c, 0], sidewalks.crossings.station[c, 0]
    street = people_on_walk(sidewalks, station + 0.5, walk=walk, kerb_m=0.5)
    street.track[:, MODE], street.track[:, CROSSING] = WAITING, c
    street.seed = seed
    return street


def gaps(rows):
    distance = np.hypot(*(rows[:, None, [X, Y]] - rows[None, :, [X, Y]]).T)
    gap = distance - 0.75 * (rows[:, None, LENGTH] + rows[None, :, LENGTH])
    return gap[np.triu_indices(len(rows), 1)]
