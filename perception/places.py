"""Where on its route a car is: on a straight, at a critical place, before a turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.towns.compiled import CompiledTown
from bev_driving_env.towns.route import TURN_RAD, lane_offsets, turn_letter

PLACES = ("all", "straight", "critical", "turn")
"""Kinds of places: straight is what is not critical, and turns are critical."""
AHEAD_M = 20.0
"""A place ahead is critical from so many metres before it."""
_ROUTE_POSITION = 6
"""Column of an episode's ``motion``."""


class Stretches(NamedTuple):
    """Junctions and corners along a route, in driving order.

    Attributes:
        begin_m: (K,) where each begins, metres along the route; may be negative for the first.
        end_m: (K,) where each ends.
        turns: (K,) bool: in a junction with other ways, the route goes left or right.
    """

    begin_m: NDArray[np.float64]
    end_m: NDArray[np.float64]
    turns: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Places:
    """What kind of place each of n frames was taken at.

    Attributes:
        critical: (n,) bool: in a junction or corner of the route, or at most 20 m before one.
        turn: (n,) bool: in a left or right turn at a junction, or at most 20 m before one; where
            the map alone does not say which way to drive. All of them are critical.
    """

    critical: NDArray[np.bool_]
    turn: NDArray[np.bool_]

    @property
    def straight(self) -> NDArray[np.bool_]:
        """(n,) bool: all other frames."""
        return ~self.critical

    def chosen(self, place: str) -> NDArray[np.bool_]:
        """Which frames (n,) were taken at a kind of place, one of ``PLACES``."""
        if place == "all":
            return np.ones(len(self.critical), np.bool_)
        mask: NDArray[np.bool_] = getattr(self, place)
        return mask


def stretches(town: CompiledTown, lanes: Sequence[int], start_m: float) -> Stretches:
    """Find junctions and corners along a route.

    A corner is a lane outside junctions that bends by 30 degrees or more.

    Args:
        town: The town.
        lanes: Numbers of the route's lanes in order.
        start_m: Station on the first one where the route starts.

    Returns:
        One stretch for each corner, and for each way through a junction.
    """
    chain = [town.lanes[number] for number in lanes]
    begins = [offset - start_m for offset in lane_offsets(chain)]
    found: list[tuple[float, float, bool]] = []
    inside = False
    for k, (number, lane) in enumerate(zip(lanes, chain, strict=True)):
        begin, end = begins[k], begins[k] + lane.length_m
        decided = k > 0 and len(town.successors[lanes[k - 1]]) > 1
        if lane.in_junction and inside and not decided:
            found[-1] = (found[-1][0], end, found[-1][2])
        elif lane.in_junction:
            found.append((begin, end, turn_letter(town, number) != "S"))
        elif abs(lane.heading_change_rad) >= TURN_RAD:
            found.append((begin, end, False))
        inside = lane.in_junction
    table = np.array(found, np.float64).reshape(-1, 3)
    return Stretches(table[:, 0], table[:, 1], table[:, 2] > 0.0)


def places_along(position_m: ArrayLike, route: Stretches, ahead_m: float = AHEAD_M) -> Places:
    """Tell the kind of place from positions along a route.

    Args:
        position_m: (n,) metres along the route.
        route: Its junctions and corners.
        ahead_m: How far before them critical places begin.
    """
    position = np.asarray(position_m, np.float64)[:, None]
    near = (position + ahead_m >= route.begin_m) & (position < route.end_m)  # (n, K)
    return Places(np.any(near, axis=1), np.any(near & route.turns, axis=1))


def log_places(log: DriveLog, indices: NDArray[np.int64], ahead_m: float = AHEAD_M) -> Places:
    """Tell the kind of place of samples (n,) of a drive log."""
    critical, turn = np.zeros((2, len(indices)), np.bool_)
    episodes = np.searchsorted(log.starts, indices, side="right") - 1
    for episode in np.unique(episodes).tolist():
        here = episodes == episode
        header = log.episodes[episode]
        motion = log.replay(episode).log.motion[indices[here] - log.starts[episode]]
        route = stretches(log.town, header.lanes, header.start_m)
        found = places_along(motion[:, _ROUTE_POSITION], route, ahead_m)
        critical[here], turn[here] = found.critical, found.turn
    return Places(critical, turn)
