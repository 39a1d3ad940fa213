"""Rails: the lane graph as traffic drives on it, and where things are along it."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import NDArray

from .jit import leaf_kernel

RAIL_X, RAIL_Y, RAIL_HEADING, RAIL_TOP_MPS = range(4)
RAIL_COLUMNS = 4

OTHER, RELATION, CLEAR_M, YIELDS = range(4)
CONFLICT_COLUMNS = 4
DIVERGES, CROSSES, MERGES = range(3)
"""How another movement meets one: they start, meet, or end at the same place."""

CROSSING, CROSSING_M, CROSSING_SIDE = range(3)
CROSSING_COLUMNS = 3


class Rails(NamedTuple):
    """A town's lane graph for traffic: G rails, each a chain of lanes without a choice on the way.

    A rail is a road, from one junction to the next, or a movement, through one junction. Traffic
    moves along rails by its station, the metres of its centre from the rail's start.

    Attributes:
        first: (G + 1,) int64, where each rail's part of ``samples`` begins.
        step_m: (G,) metres between samples of a rail, at most 0.5.
        length: (G,) metres.
        samples: (M, 4) x, y, heading (radians, without jumps along a rail) and the greatest speed
            that curves here and ahead on this rail, and the speed limit, allow.
        following: (G, D) int64 rails that a rail leads on to, padded with -1.
        approach: (G,) int64, the road that leads into a movement; -1 for roads.
        movement: (G,) whether a rail lies inside a junction.
        signal: (G,) int64, the signal at the end of a road; -1 for none.
        conflict_first: (G + 1,) int64, where each rail's part of ``conflicts`` begins.
        conflicts: (K, 4) for each pair of movements whose traffic could touch: the other rail, the
            relation, the station on the other beyond which its vehicles are out of the way (as
            seen from the other's start; may lie beyond its end), and whether its traffic goes
            first where no signal decides.
        crossing_first: (G + 1,) int64, where each rail's part of ``crossings`` begins.
        crossings: (Q, 3) pedestrian crossings on a rail in driving order: number, station, and
            which half of it (0 the one where the crossing begins, 1 where it ends).
    """

    first: NDArray
    step_m: NDArray
    length: NDArray
    samples: NDArray
    following: NDArray
    approach: NDArray
    movement: NDArray
    signal: NDArray
    conflict_first: NDArray
    conflicts: NDArray
    crossing_first: NDArray
    crossings: NDArray


@leaf_kernel
def rail_pose(rails: Rails, rail: int, station_m: float) -> tuple[float, float, float]:
    """Pose (x, y, heading) at a station; beyond the ends the first and last step go on straight."""
    where = station_m / rails.step_m[rail]
    first, last = rails.first[rail], rails.first[rail + 1] - 1
    row = min(max(int(where), 0), last - first - 1) + first
    part = where - (row - first)
    samples = rails.samples
    x = samples[row, RAIL_X] + part * (samples[row + 1, RAIL_X] - samples[row, RAIL_X])
    y = samples[row, RAIL_Y] + part * (samples[row + 1, RAIL_Y] - samples[row, RAIL_Y])
    turn = min(max(part, 0.0), 1.0)
    heading = samples[row, RAIL_HEADING]
    heading += turn * (samples[row + 1, RAIL_HEADING] - heading)
    return x, y, heading


@leaf_kernel
def top_speed(rails: Rails, rail: int, station_m: float) -> float:
    """Greatest speed at a station that the rail's own curves and limits allow."""
    first, last = rails.first[rail], rails.first[rail + 1] - 1
    row = min(max(int(station_m / rails.step_m[rail]), 0), last - first) + first
    return rails.samples[row, RAIL_TOP_MPS]
