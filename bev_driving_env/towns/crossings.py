"""Pedestrian crossings: straight ways over the road from one walk to another."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..kernels.detect import raster_value
from ..kernels.layout import ROAD_BIT
from ..kernels.overlap import SOLID_HEADING, SOLID_LENGTH, SOLID_WIDTH
from ..kernels.walks import WALK_COS, WALK_SIN, WALK_X, WALK_Y, Crossings, Walks

if TYPE_CHECKING:
    from .compiled import CompiledTown, Lane

CLEAR_M = 0.45
"""Walkers keep this far from what stands on the sidewalk."""
STOP_LINE_GAP_M = 1.3
SIDEWAYS_M = 8.0
WALK_NEAR_M = 4.0
MIDBLOCK_FROM_M = 45.0
MIDBLOCK_EVERY_M = 60.0
MIDBLOCK_MARGIN_M = 15.0
SHIFTS_M = tuple(sign * k / 2.0 for k in range(11) for sign in ((1.0, -1.0) if k else (1.0,)))

Points = NDArray[np.float64]


def find_crossings(town: CompiledTown, walks: Walks, boxes: Points) -> Crossings:
    """All crossings whose both ends have a walk nearby."""
    from scipy.spatial import KDTree

    rows: list[tuple[Points, NDArray[np.int64], int, bool]] = []
    if len(walks.samples):
        tree = KDTree(walks.samples[:, [WALK_X, WALK_Y]])
        for line, signal, mouth in _crossing_lines(town, boxes):
            distance, nearest = tree.query(line.reshape(2, 2))
            if (distance <= WALK_NEAR_M).all():
                rows.append((line, np.asarray(nearest, np.int64), signal, mouth))
    ends = np.array([line for line, _, _, _ in rows]).reshape(-1, 4)
    nearest = np.array([near for _, near, _, _ in rows], np.int64).reshape(-1, 2)
    walk = np.searchsorted(walks.first, nearest, side="right") - 1
    station = np.zeros(nearest.shape)
    stop_at = np.full(len(walks.samples), -1, np.int64)
    for c, end in np.ndindex(*nearest.shape):
        row, w = nearest[c, end], walk[c, end]
        x, y, cos, sin = walks.samples[row, [WALK_X, WALK_Y, WALK_COS, WALK_SIN]]
        dx, dy = ends[c, 2 * end] - x, ends[c, 2 * end + 1] - y
        where = (row - walks.first[w]) * walks.step_m[w] + dx * cos + dy * sin
        station[c, end] = where % walks.length[w]
        at = walks.first[w] + int(station[c, end] / walks.step_m[w])
        while stop_at[at] >= 0:
            at = at + 1 if at + 2 < walks.first[w + 1] else walks.first[w]
        stop_at[at] = 2 * c + end
    return Crossings(
        ends=ends,
        length=np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1]),
        walk=walk.astype(np.int64),
        station=station,
        signal=np.array([signal for _, _, signal, _ in rows], np.int64),
        mouth=np.array([mouth for _, _, _, mouth in rows], np.bool_),
        stop_at=stop_at,
    )


def _crossing_lines(town: CompiledTown, boxes: Points) -> Iterator[tuple[Points, int, bool]]:
    """Lines (4,) over the road, the signal of each, and whether it is at a junction's mouth."""
    signals = {signal.lane: k for k, signal in enumerate(town.signals)}
    crossed: set[int] = set()
    for number, lane in enumerate(town.lanes):
        if lane.in_junction:
            continue
        if any(town.lanes[k].in_junction for k in town.successors[number]):
            oncoming = _oncoming(town, number, lane.length_m)
            line = _line_across(town, lane, oncoming, lane.length_m + STOP_LINE_GAP_M)
            yield line, signals.get(lane.index, -1), True
        straight = abs(lane.heading_change_rad) < 0.05
        if number in crossed or not straight or lane.length_m <= MIDBLOCK_FROM_M:
            continue
        count = max(1, round(lane.length_m / MIDBLOCK_EVERY_M))
        every_m = (lane.length_m - 2.0 * MIDBLOCK_MARGIN_M) / count
        for k in range(count):
            station = MIDBLOCK_MARGIN_M + (k + 0.5) * every_m
            oncoming = _oncoming(town, number, station)
            if oncoming is not None:
                crossed.add(oncoming)
            low, high = MIDBLOCK_MARGIN_M, lane.length_m - MIDBLOCK_MARGIN_M
            places = [min(max(station + shift, low), high) for shift in SHIFTS_M]
            lines = [_line_across(town, lane, oncoming, place) for place in places]
            free = (line for line in lines if _has_free_ends(town, line, boxes))
            yield next(free, lines[0]), -1, False


def _oncoming(town: CompiledTown, number: int, station_m: float) -> int | None:
    """The antiparallel road lane to the left of a lane at a station, within 8 m."""
    x, y, heading = town.lanes[number].pose_at(station_m)
    cos, sin = math.cos(heading), math.sin(heading)
    best, best_m = None, SIDEWAYS_M
    for other, lane in enumerate(town.lanes):
        if lane.in_junction or other == number:
            continue
        where, distance = lane.nearest(x, y)
        px, py, other_heading = lane.pose_at(where)
        left = (px - x) * sin - (py - y) * cos
        if left > 0.0 and distance < best_m and math.cos(other_heading - heading) < -0.9:
            best, best_m = other, distance
    return best


def _line_across(town: CompiledTown, lane: Lane, oncoming: int | None, station_m: float) -> Points:
    """Line (4,) square to a lane from its right kerb to the left kerb of the road."""
    shoulder_m = town.cross_section.shoulder_m
    x, y, heading = lane.pose_at(station_m)
    cos, sin = math.cos(heading), math.sin(heading)
    beyond = max(0.0, station_m - lane.length_m)
    x, y = x + beyond * cos, y + beyond * sin
    right = float(lane.half_width[-1]) + shoulder_m
    left = right
    if oncoming is not None:
        other = town.lanes[oncoming]
        px, py, _ = other.pose_at(other.nearest(x, y)[0])
        left = (px - x) * sin - (py - y) * cos + float(other.half_width[-1]) + shoulder_m
    # beyond the stop line the kerb may already swing outwards
    classes = town.classes()
    for _ in range(20):
        ax, ay, bx, by = x - right * sin, y + right * cos, x + left * sin, y - left * cos
        step = 0.5 / classes.grid.px_per_m
        a = raster_value(classes.pixels, classes.grid, ax - step * sin, ay + step * cos)
        b = raster_value(classes.pixels, classes.grid, bx + step * sin, by - step * cos)
        if not (a | b) & ROAD_BIT:
            break
        right += 0.05 if a & ROAD_BIT else 0.0
        left += 0.05 if b & ROAD_BIT else 0.0
    return np.array([x - right * sin, y + right * cos, x + left * sin, y - left * cos])


def _has_free_ends(town: CompiledTown, line: Points, boxes: Points) -> bool:
    """Whether nothing stands between a line's ends and the middle of the sidewalks there."""
    way = line[2:] - line[:2]
    way = way / np.hypot(*way)
    beyond = np.arange(0.0, town.cross_section.sidewalk_m / 2.0, 0.25)
    spots = np.vstack([line[:2] - beyond[:, None] * way, line[2:] + beyond[:, None] * way])
    room = clearances(spots, np.zeros_like(spots), np.zeros(1), boxes)
    return bool((room >= CLEAR_M).all())


def clearances(points: Points, ways: Points, right: Points, boxes: Points) -> Points:
    """Distance (n, L) to the nearest box from each sample's points at lateral offsets (L,)."""
    from scipy.spatial import KDTree

    room = np.full((len(points), len(right)), np.inf)
    if len(boxes) == 0:
        return room
    halves = boxes[:, [SOLID_LENGTH, SOLID_WIDTH]] / 2.0
    reach = np.hypot(*halves.T) + float(np.abs(right).max()) + CLEAR_M
    for box, half, found in zip(
        boxes, halves, KDTree(points).query_ball_point(boxes[:, :2], reach), strict=True
    ):
        near = np.array(found, np.int64)
        if len(near) == 0:
            continue
        normal = np.column_stack([-ways[near, 1], ways[near, 0]])
        spots = points[near, None] + right[None, :, None] * normal[:, None] - box[:2]
        cos, sin = math.cos(box[SOLID_HEADING]), math.sin(box[SOLID_HEADING])
        ahead = np.abs(spots[..., 0] * cos + spots[..., 1] * sin) - half[0]
        aside = np.abs(spots[..., 1] * cos - spots[..., 0] * sin) - half[1]
        inside = np.minimum(np.maximum(ahead, aside), 0.0)
        distance = np.hypot(np.maximum(ahead, 0.0), np.maximum(aside, 0.0)) + inside
        room[near] = np.minimum(room[near], distance)
    return room
