"""Who was at fault in a collision, where that can be told."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..kernels.layout import HEADING, LENGTH, SPEED, X, Y

EGO, OTHER, UNKNOWN = "ego", "other", ""
STANDING_MPS = 0.1
"""CARLA's scenario runner blames nobody who is slower than this."""
ALONG_RAD = math.radians(45.0)


def vehicle_fault(ego: Sequence[float], ego_length_m: float, other: Sequence[float]) -> str:
    """Who ran into whom.

    Whoever stands while the other moves is not at fault; if both have come to a stop, the ego is,
    for the others stop in time. Of two that drive the same way, the one behind is. Else it cannot
    be told from their places alone.

    Args:
        ego: x, y, heading, speed.
        ego_length_m: Its length.
        other: The same of the other vehicle, and its length and width.

    Returns:
        ``"ego"``, ``"other"`` or ``""``.

    >>> vehicle_fault((0, 0, 0, 0.0), 5.0, (-4.9, 0, 0, 3.0, 5.0, 2.0))
    'other'
    >>> vehicle_fault((0, 0, 0, 4.0), 5.0, (4.9, 0, 0, 3.0, 5.0, 2.0))
    'ego'
    """
    if other[SPEED] < STANDING_MPS:
        return EGO
    if ego[SPEED] < STANDING_MPS:
        return OTHER
    turn = math.remainder(other[HEADING] - ego[HEADING], 2.0 * math.pi)
    if abs(turn) > ALONG_RAD:
        return UNKNOWN
    dx, dy = other[X] - ego[X], other[Y] - ego[Y]
    ahead = dx * math.cos(ego[HEADING]) + dy * math.sin(ego[HEADING])
    overlapping = 0.25 * (ego_length_m + other[LENGTH])
    if abs(ahead) < overlapping:
        return UNKNOWN  # side by side
    return EGO if ahead > 0.0 else OTHER


def pedestrian_fault(ego: Sequence[float], pedestrian: Sequence[float]) -> str:
    """``"ego"``, unless it stood and the pedestrian walked into it; rows x, y, heading, speed."""
    walked = pedestrian[SPEED] >= STANDING_MPS
    return OTHER if walked and ego[SPEED] < STANDING_MPS else EGO
