"""From the sparse route map to a route: a band through the points of the plan."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..bev import ROUTE_WIDTH_M
from ..frames import BEVGeometry
from ..kernels.route_map import DISC, DISC_RADIUS_M, MARKER

Point = NDArray[np.float64]
TOO_NEAR_M = 2.5
"""A plan point nearer than this is as good as reached."""
NEXT_POINT_M = 40.0
"""How far apart plan points on a straight road usually are; the most is 50 m."""
SHORTEST_TURN_M, LONGEST_TURN_M = 8.0, 30.0
"""Between plan points closer than this, or farther apart, a turn is not taken for one."""
STRAIGHT_M = 1.5
"""Less than this aside of the direction of travel, a point is straight ahead: GPS is off, too."""
STEPS = 8
"""Straight pieces between two points of the plan."""


def draw_route(geometry: BEVGeometry, route_map: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The way from the ego through the points of a route map, out to the edge of the window.

    Args:
        geometry: The BEV.
        route_map: (size, size) uint8.

    Returns:
        (size, size) of 0 and 1; all 0 if the map is empty.
    """
    plane = np.zeros((geometry.size, geometry.size), np.uint8)
    curve = route_curve(geometry, route_map)
    if len(curve) < 2:
        return plane
    shift = 4
    width = max(1, round(ROUTE_WIDTH_M * geometry.px_per_m) - 1)
    pixels = np.rint(curve * (1 << shift)).astype(np.int32)
    cv2.polylines(plane, [pixels], False, 1, width, cv2.LINE_8, shift)
    behind = geometry.ego_row + 1
    if curve[:, 1].max() < behind:
        plane[behind:] = 0  # the band's round end
    return plane


def route_curve(geometry: BEVGeometry, route_map: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The middle of the way as pixels (M, 2), column and row; without points if the map is empty.

    It is made of circular arcs where a point lies aside of the direction of travel, because plan
    points are the ends of turns, and of straight lines elsewhere.
    """
    px_per_m = geometry.px_per_m
    radius = DISC_RADIUS_M * px_per_m
    here = np.array([geometry.ego_column, geometry.ego_row], np.float64)
    left = [
        point
        for point in centres(route_map == DISC, radius)
        if _distance(point, here) > TOO_NEAR_M * px_per_m
    ]
    place, direction, turned = here, np.array([0.0, -1.0]), False
    pieces = []
    while left:
        nearest = min(range(len(left)), key=lambda k: _distance(left[k], place))
        point = left.pop(nearest)
        arrival, turned = _arrival(place, direction, point, px_per_m)
        pieces.append(_piece(place, direction, point, arrival))
        place, direction = point, arrival
    for marker in centres(route_map == MARKER, radius)[:1]:
        reach = NEXT_POINT_M * px_per_m
        point = _beyond(here, place, marker, reach)
        if turned:  # two guesses where the road goes: as the turn ends, and towards the marker
            point = (point + place + reach * direction) / 2.0
        arrival = (point - place) / max(_distance(point, place), 1e-6)
        pieces.append(_piece(place, direction, point, arrival))
    return np.concatenate(pieces) if pieces else np.zeros((0, 2))


def _arrival(place: Point, direction: Point, point: Point, px_per_m: float) -> tuple[Point, bool]:
    """Direction of travel at the next point, and whether the way there is a turn."""
    length = max(_distance(point, place), 1e-6)
    chord = (point - place) / length
    along = float(chord @ direction)
    aside_m = length * np.sqrt(max(0.0, 1.0 - along**2)) / px_per_m
    if aside_m < STRAIGHT_M and along > 0.0:
        return (chord if length > LONGEST_TURN_M / 2.0 * px_per_m else direction), False
    if along < 0.0 or not SHORTEST_TURN_M <= length / px_per_m <= LONGEST_TURN_M:
        return chord, False
    return 2.0 * along * chord - direction, True  # a circle leaves its chord as it came to it


def _piece(a: Point, direction_a: Point, b: Point, direction_b: Point) -> Point:
    """Points (STEPS + 1, 2) of a curve between two points with their directions."""
    t = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    length = _distance(a, b)
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * a
        + (t**3 - 2 * t**2 + t) * length * direction_a
        + (3 * t**2 - 2 * t**3) * b
        + (t**3 - t**2) * length * direction_b
    )


def _beyond(here: Point, last: Point, marker: Point, reach: float) -> Point:
    """The first point out of view: behind the marker as seen from here, how far is guessed."""
    distance = max(_distance(marker, here), 1e-6)
    direction = (marker - here) / distance
    along = float((last - here) @ direction)
    across2 = max(0.0, _distance(last, here) ** 2 - along**2)
    return here + max(distance, along + np.sqrt(max(0.0, reach**2 - across2))) * direction


def _distance(a: Point, b: Point) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


def centres(mask: NDArray[np.bool_], radius: float) -> list[NDArray[np.float64]]:
    """Centres (column, row) of discs of a radius, which may be cut by the border or overlap."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for outline in outlines:
        left, top, width, height = cv2.boundingRect(outline)
        low, high = np.array([left, top]), np.array([left + width - 1, top + height - 1])
        parts = max(1, round((cv2.contourArea(outline) + len(outline) / 2) / (np.pi * radius**2)))
        if parts == 1:
            found.append(_centre(low, high, np.array(mask.shape[::-1]), radius))
            continue
        # discs in a row: their centres are spread along the longest axis
        points = outline[:, 0].astype(np.float64)
        middle = points.mean(axis=0)
        axis = np.linalg.svd(points - middle, full_matrices=False)[2][0]
        along = (points - middle) @ axis
        for part in np.linspace(along.min() + radius, along.max() - radius, parts):
            found.append(middle + part * axis)
    return found


def _centre(
    low: NDArray[np.int64], high: NDArray[np.int64], size: NDArray[np.int64], radius: float
) -> NDArray[np.float64]:
    """Centre of a disc from its box; where the border cuts it, from the opposite side."""
    middle = (low + high) / 2.0
    middle = np.where((low == 0) & (high < size - 1), high - np.floor(radius), middle)
    middle = np.where((high == size - 1) & (low > 0), low + np.floor(radius), middle)
    return np.asarray(middle, np.float64)
