"""Sidewalks as closed loops around the blocks, and which part of them is free to walk on."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..kernels.detect import raster_value
from ..kernels.layout import ROAD_BIT
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
from .crossings import CLEAR_M, Points, clearances, find_crossings
from .route import lane_offsets, resample

if TYPE_CHECKING:
    from .compiled import CompiledTown, Lane
    from .solids import Solids

NARROWEST_M = 1.5
STEP_M = 0.5
FINE_M = 0.1
EDGE_M = 0.4
"""Walkers keep this far from both edges of the sidewalk."""
SPREAD_M = 1.0
DRIFT_SLOPE = 0.3
"""How far to the side walkers come per metre, at 0.4 m/s and a usual pace."""
LEVEL_M = 0.05
SQUEEZES, SQUEEZE_M, SQUEEZE_BY_M = 6, 3.0, 0.1
COMFORTABLE_M = 1.0
"""Bands are not narrowed below this ahead of an obstacle."""


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
    return Sidewalks(walks, find_crossings(town, walks, boxes))


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
    outline = []
    for i, j in zip(places, np.append(places[1:], len(edge)) % len(edge), strict=True):
        corner = _intersection(edge[i], curve[i, 2:], edge[j], curve[j, 2:]) if j > i + 1 else None
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
    return any(raster_value(classes.pixels, classes.grid, x, y) & ROAD_BIT for x, y in middle[::5])


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
    room = clearances(points, ways, right, boxes)
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
