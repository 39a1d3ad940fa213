"""Sidewalks as closed loops around the blocks, and the pedestrian crossings between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..kernels.detect import raster_value
from ..kernels.layout import ROAD_BIT
from ..kernels.overlap import SOLID_HEADING, SOLID_LENGTH, SOLID_WIDTH
from ..kernels.walks import (
    BEND,
    FREE_FROM_M,
    FREE_TO_M,
    WALK_COLUMNS,
    WALK_COS,
    WALK_SIN,
    WALK_X,
    WALK_Y,
    Crossings,
    Walks,
)
from .route import lane_offsets, resample

if TYPE_CHECKING:
    from .compiled import CompiledTown, Lane
    from .solids import Solids

NARROWEST_M = 1.5
STEP_M = 0.5
FINE_M = 0.1
EDGE_M = 0.4
"""Walkers keep this far from both edges of the sidewalk."""
CLEAR_M = 0.45
SPREAD_M = 1.0
DRIFT_SLOPE = 0.3
"""How far to the side walkers come per metre, at 0.4 m/s and a usual pace."""
LEVEL_M = 0.05
SQUEEZES, SQUEEZE_M, SQUEEZE_BY_M = 6, 3.0, 0.1
COMFORTABLE_M = 1.0
"""Bands are not narrowed below this ahead of an obstacle."""
STOP_LINE_GAP_M = 1.3
SIDEWAYS_M = 8.0
WALK_NEAR_M = 4.0
MIDBLOCK_FROM_M = 45.0
MIDBLOCK_EVERY_M = 60.0
MIDBLOCK_MARGIN_M = 15.0
SHIFTS_M = tuple(sign * k / 2.0 for k in range(11) for sign in ((1.0, -1.0) if k else (1.0,)))

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sidewalks:
    """Where a town's pedestrians walk.

    Attributes:
        walks: Closed loops with their free bands.
        crossings: Ways over the road.
    """

    walks: Walks
    crossings: Crossings


def build_sidewalks(town: CompiledTown, solids: Solids | None = None) -> Sidewalks:
    """Find a town's walks and crossings.

    Args:
        town: The town.
        solids: What stands in the way on the sidewalks; ``None`` for nothing.

    Returns:
        The sidewalks; without any where the town's are narrower than 1.5 m.
    """
    width_m = town.cross_section.sidewalk_m
    boxes = np.zeros((0, 5)) if solids is None else solids.boxes
    loops: list[Points] = []
    if width_m >= NARROWEST_M:
        for lanes in lane_loops(town):
            middle = _walk_line([town.lanes[k] for k in lanes], town)
            if middle is not None and not _is_on_road(town, middle):
                loops.append(middle)
    walks = _walk_tables(loops, width_m, boxes)
    return Sidewalks(walks, _crossings(town, walks, boxes))


def lane_loops(town: CompiledTown) -> list[tuple[int, ...]]:
    """Lanes around each block in driving order: at every choice, the way farthest to the right.

    A road lane belongs to at most one loop; to none if it leads to a dead end, or into a loop that
    it is not part of.
    """
    seen = [False] * len(town.lanes)
    loops = []
    for start, lane in enumerate(town.lanes):
        path: list[int] = []
        place: dict[int, int] = {}
        current: int | None = None if lane.in_junction else start
        while current is not None and current not in place and not seen[current]:
            place[current] = len(path)
            path.append(current)
            options = town.successors[current]
            current = max(options, key=lambda k: _turn_rad(town, k)) if options else None
        if current in place:
            loops.append(tuple(path[place[current] :]))
        for number in path:
            # different movements may share what lies inside a junction, not the roads
            seen[number] = not town.lanes[number].in_junction
    return loops


def _turn_rad(town: CompiledTown, lane: int) -> float:
    """Heading change, positive to the right, of the whole movement that starts with a lane."""
    change = 0.0
    for _ in range(len(town.lanes)):
        change += town.lanes[lane].heading_change_rad
        following = town.successors[lane]
        if len(following) != 1 or not town.lanes[following[0]].in_junction:
            break
        lane = following[0]
    return change


def _walk_line(chain: list[Lane], town: CompiledTown) -> Points | None:
    """Middle of the sidewalk (n, 2) to the right of a closed chain of lanes, finely sampled.

    The sidewalk's outer edge is found first, without what tight bends fold over; the middle keeps
    half a sidewalk to the left of it, which rounds the corners.
    """
    from scipy.spatial import KDTree

    half_m = town.cross_section.sidewalk_m / 2.0
    half_lane_m = max(float(lane.half_width.max()) for lane in chain)
    outer_m = half_lane_m + town.cross_section.shoulder_m + 2.0 * half_m
    gap_m = float(np.hypot(*(chain[0].points[0, :2] - chain[-1].points[-1, :2])))
    length_m = lane_offsets(chain)[-1] + chain[-1].length_m
    curve = resample([*chain, chain[0]], 0.0, length_m + gap_m)
    along = np.linspace(0.0, length_m + gap_m, len(curve))
    fine = np.arange(0.0, length_m + gap_m, FINE_M)
    curve = np.column_stack([np.interp(fine, along, column) for column in curve.T])
    edge = curve[:, :2] + outer_m * np.column_stack([-curve[:, 3], curve[:, 2]])
    distance = np.asarray(KDTree(curve[:, :2]).query(edge)[0], np.float64)
    kept: NDArray[np.bool_] = distance > outer_m - 0.02
    # what is left on both sides of a fold may still reach a little into it
    folded = ~kept
    for shift in range(-3, 4):
        folded |= np.roll(~kept, shift)
    if folded.all():
        return None
    # begin on an unfolded place, so that no fold lies across the ends
    begin = int(np.flatnonzero(~folded)[0])
    edge, curve = np.roll(edge, -begin, axis=0), np.roll(curve, -begin, axis=0)
    folded = np.roll(folded, -begin)
    places = np.flatnonzero(~folded)
    corners = [
        _intersection(edge[i], curve[i, 2:], edge[j], curve[j, 2:]) if j > i + 1 else None
        for i, j in zip(places, np.append(places[1:], len(edge)) % len(edge), strict=True)
    ]
    outline = []
    for i, corner in zip(places, corners, strict=True):
        outline += [edge[i]] if corner is None else [edge[i], corner]
    return _offset_left(np.array(outline), half_m)


def _intersection(p: Points, p_way: Points, q: Points, q_way: Points) -> Points | None:
    """Where the line ahead of p meets the line behind q; ``None`` if nowhere in between."""
    cross = float(p_way[0] * q_way[1] - p_way[1] * q_way[0])
    if abs(cross) < 0.05:
        return None
    dx, dy = q - p
    ahead = float(dx * q_way[1] - dy * q_way[0]) / cross
    behind = float(dx * p_way[1] - dy * p_way[0]) / cross
    return p + ahead * p_way if ahead > 0.0 and behind < 0.0 else None


def _offset_left(line: Points, offset_m: float) -> Points:
    """A closed line to the left of another (n, 2), with arcs around its right-hand corners."""
    spans = np.roll(line, -1, axis=0) - line
    keep = np.hypot(*spans.T) > 1e-9
    line, spans = line[keep], spans[keep]
    heading = np.arctan2(spans[:, 1], spans[:, 0])
    before = np.roll(heading, 1)
    turn = np.remainder(heading - before + math.pi, 2.0 * math.pi) - math.pi
    points = []
    for (x, y), start, change in zip(line, before, turn, strict=True):
        # an arc to the right; to the left, where the offset line is the shorter one, a mitre
        count = max(1, math.ceil(change / 0.05))
        reach_m = offset_m / math.cos(min(abs(change), 1.0) / (2.0 * count))
        for k in range(count):
            h = start + (k + 0.5) / count * change
            points.append((x + reach_m * math.sin(h), y - reach_m * math.cos(h)))
    return np.array(points)


def _is_on_road(town: CompiledTown, middle: Points) -> bool:
    """Whether a walk runs over the road somewhere, as beside an inner lane."""
    classes = town.classes()
    values = [raster_value(classes.pixels, classes.grid, x, y) for x, y in middle[::5]]
    return bool((np.array(values) & ROAD_BIT).any())


def _walk_tables(loops: list[Points], width_m: float, boxes: Points) -> Walks:
    """Resample loops evenly and measure what is free beside their middle."""
    first, steps, lengths, tables = [0], [], [], []
    for line in loops:
        closed = np.vstack([line, line[:1]])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
        count = math.ceil(along[-1] / STEP_M)
        wanted = np.arange(count) * (along[-1] / count)
        points = np.column_stack([np.interp(wanted, along, column) for column in closed.T])
        ways = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
        ways /= np.hypot(*ways.T)[:, None]
        table = np.zeros((count, WALK_COLUMNS))
        table[:, [WALK_X, WALK_Y]], table[:, [WALK_COS, WALK_SIN]] = points, ways
        step_m = float(along[-1]) / count
        table[:, [FREE_FROM_M, FREE_TO_M]] = _free_bands(points, ways, step_m, width_m, boxes)
        before, after = np.roll(ways, 1, axis=0), np.roll(ways, -1, axis=0)
        turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        table[:, BEND] = np.arcsin(np.clip(turn, -1.0, 1.0)) / (2.0 * step_m)
        tables.append(np.vstack([table, table[:1]]))
        steps.append(step_m)
        lengths.append(float(along[-1]))
        first.append(first[-1] + count + 1)
    return Walks(
        first=np.array(first, np.int64),
        step_m=np.array(steps, np.float64),
        length=np.array(lengths, np.float64),
        half_width_m=width_m / 2.0,
        samples=np.vstack(tables) if tables else np.zeros((0, WALK_COLUMNS)),
    )


def _free_bands(
    points: Points, ways: Points, step_m: float, width_m: float, boxes: Points
) -> Points:
    """Free band (n, 2) at each sample of a loop: from and to which distance from the kerb."""
    levels = np.linspace(EDGE_M, width_m - EDGE_M, round((width_m - 2.0 * EDGE_M) / LEVEL_M) + 1)
    right = levels - width_m / 2.0
    room = _clearances(points, ways, right, boxes)
    # what stands between two samples counts for both
    room = np.minimum.reduce([np.roll(room, k, axis=0) for k in (-1, 0, 1)])
    # where nothing is free, the best there is
    enough = np.minimum(CLEAR_M, room.max(axis=1) - LEVEL_M)
    bands = levels[_connected_runs(room >= enough[:, None])]
    for _ in range(SQUEEZES):
        following = np.roll(bands, -1, axis=0)
        apart = (bands[:, 0] > following[:, 1]) | (following[:, 0] > bands[:, 1])
        if not apart.any():
            break
        # no way past: squeeze through there
        around = math.ceil(SQUEEZE_M / step_m)
        near = np.any([np.roll(apart, k) for k in range(-around, around + 1)], axis=0)
        enough = np.where(near, enough - SQUEEZE_BY_M, enough)
        bands = levels[_connected_runs(room >= enough[:, None])]
    return _tapered(bands, step_m)


def _clearances(points: Points, ways: Points, right: Points, boxes: Points) -> Points:
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


def _connected_runs(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First and last level (n, 2) of one run of free levels per sample of a closed loop.

    Runs are wide on the whole, and those of neighbours overlap wherever that is possible: a path
    of greatest total width through the runs (Viterbi 1967).
    """
    padded = np.pad(free, ((0, 0), (1, 1))).astype(np.int8)
    edges = np.diff(padded, axis=1)
    widest = int(np.argmax(free.sum(axis=1)))  # a sample where there is hardly a choice
    order = np.roll(np.arange(len(free)), -widest)
    runs = [
        np.column_stack([np.flatnonzero(row == 1), np.flatnonzero(row == -1) - 1])
        for row in edges[order]
    ]
    start = int(np.argmax(np.diff(runs[0], axis=1)))
    runs[0] = runs[0][start : start + 1]
    total = np.zeros(1)
    came_from = []
    apart = 10.0 * free.shape[1]
    for earlier, later in itertools.pairwise(runs):
        overlap = np.minimum(earlier[:, None, 1], later[None, :, 1])
        overlap = overlap - np.maximum(earlier[:, None, 0], later[None, :, 0])
        scores = total[:, None] - apart * (overlap < 0)
        came_from.append(scores.argmax(axis=0))
        total = scores.max(axis=0) + np.diff(later, axis=1)[:, 0]
    chosen = [int(total.argmax())]
    for before in reversed(came_from):
        chosen.append(int(before[chosen[-1]]))
    path = np.array([run[k] for run, k in zip(runs, reversed(chosen), strict=True)])
    return np.roll(path, widest, axis=0)


def _tapered(bands: Points, step_m: float) -> Points:
    """Narrow bands (n, 2) before and behind what narrows them, so that walkers drift over in time.

    The first metre is as narrow as can be, from there on by as much as walkers come to the side.
    """
    low, high = bands[:, 0].copy(), bands[:, 1].copy()
    for k in range(1, math.ceil(10.0 / step_m)):
        give = DRIFT_SLOPE * max(0.0, step_m * k - SPREAD_M)
        for shift in (-k, k):
            low = np.maximum(low, np.roll(bands[:, 0], shift) - give)
            high = np.minimum(high, np.roll(bands[:, 1], shift) + give)
    # but leave room to pass, and never cross over
    wanted = np.minimum(bands[:, 1] - bands[:, 0], COMFORTABLE_M)
    taken = (bands[:, 1] - bands[:, 0]) - (high - low)
    spare = (bands[:, 1] - bands[:, 0]) - wanted
    share = np.clip(np.divide(spare, taken, out=np.ones_like(taken), where=taken > 0.0), 0.0, 1.0)
    low = bands[:, 0] + share * (low - bands[:, 0])
    high = bands[:, 1] + share * (high - bands[:, 1])
    return np.column_stack([low, high])


def _crossings(town: CompiledTown, walks: Walks, boxes: Points) -> Crossings:
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
    room = _clearances(spots, np.zeros_like(spots), np.zeros(1), boxes)
    return bool((room >= CLEAR_M).all())
