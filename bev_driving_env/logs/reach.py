"""Which actors can be seen at a moment: the others need no row in a log."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..cameras.conditions import HARD_CONDITIONS, TRAIN_CONDITIONS
from ..cameras.rig import CameraRig
from ..frames import BEVGeometry
from ..kernels.layout import LENGTH, X, Y
from ..kernels.scenery import PEOPLE_M, SIGHT_M

MOUNT_M = 5.0
"""Cameras may sit this far from the ego's centre."""
SLACK_M = 1.0
"""What a camera that is mounted wrongly, on a body that leans, can be nearer."""
SHADOW_SIGHT_M = 70.0
"""Shadows are drawn up to this distance (``kernels.shadows``)."""
TALLEST_PERSON_M = 1.95
LOWEST_SUN_DEG = min(
    condition.sun_elevation_deg[0]
    for condition in (*TRAIN_CONDITIONS, *HARD_CONDITIONS)
    if condition.sun[1] > 0.0
)
LONGEST_SHADOW_M = TALLEST_PERSON_M / math.tan(math.radians(LOWEST_SUN_DEG))
VEHICLE_REACH_M = SIGHT_M + MOUNT_M + SLACK_M
"""Vehicles farther than this and their length cannot be seen."""
PERSON_REACH_M = max(PEOPLE_M, SHADOW_SIGHT_M + LONGEST_SHADOW_M) + MOUNT_M + SLACK_M
"""People farther than this cannot be seen, nor can their shadows in a low sun."""


def within_sight(
    ego: NDArray[np.float64], vehicles: NDArray[np.float64], pedestrians: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which actors cameras or the BEV could show.

    Args:
        ego: (4,).
        vehicles: (V, 6).
        pedestrians: (P, 6).

    Returns:
        (V + P,), False for empty slots too.
    """
    reach = np.concatenate(
        [vehicles[:, LENGTH] + VEHICLE_REACH_M, np.full(len(pedestrians), PERSON_REACH_M)]
    )
    actors = np.concatenate([vehicles, pedestrians])
    distance = np.hypot(actors[:, X] - ego[X], actors[:, Y] - ego[Y])
    return (distance <= reach) & (actors[:, LENGTH] > 0.0)


def require_bev_within(geometry: BEVGeometry) -> None:
    """Check that a view shows nothing that logs leave out.

    Raises:
        ValueError: It looks farther than people are kept.
    """
    ahead = max(geometry.ego_row, geometry.size - geometry.ego_row)
    farthest_m = math.hypot(ahead, geometry.size / 2.0) / geometry.px_per_m + SLACK_M
    if farthest_m > PERSON_REACH_M:
        raise ValueError(
            f"a BEV of {geometry.size} pixels at {geometry.px_per_m:g} px/m shows "
            f"{farthest_m:.0f} m, logs keep what is within {PERSON_REACH_M:.0f} m: ask for less"
        )


def require_rig_within(rig: CameraRig) -> None:
    """Check that cameras see nothing that logs leave out.

    Raises:
        ValueError: A camera sits too far from the ego's centre.
    """
    for camera in rig.cameras:
        if math.hypot(camera.x_m, camera.y_m) > MOUNT_M:
            raise ValueError(
                f"camera {camera.name!r} sits {math.hypot(camera.x_m, camera.y_m):.1f} m from the "
                f"ego's centre; logs keep what is seen from within {MOUNT_M:g} m"
            )
