"""How fast to drive where: a speed profile along a route, planned from its curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SpeedLimits:
    """What the plan keeps to.

    Attributes:
        cruise_mps: Greatest speed.
        lateral_mps2: Greatest lateral acceleration in curves.
        braking_mps2: Deceleration before them.
        final_mps: Speed at the end of the route. The route is a drive cut short, not a parking
            manoeuvre, so it need not be zero.
    """

    cruise_mps: float = 6.0
    lateral_mps2: float = 2.0
    braking_mps2: float = 2.0
    final_mps: float = 3.0

    def __post_init__(self) -> None:
        for name in ("cruise_mps", "lateral_mps2", "braking_mps2", "final_mps"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)!r}")


def curvature(points: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """Signed curvature (R,) of evenly spaced points (R, 4), in 1/m, positive to the right."""
    heading = np.unwrap(np.arctan2(points[:, 3], points[:, 2]))
    return np.gradient(heading, spacing_m)


def plan_speed(
    points: NDArray[np.float64], spacing_m: float, limits: SpeedLimits
) -> NDArray[np.float64]:
    """Greatest speed (R,) at each route point that respects curves ahead and braking.

    Args:
        points: Route points (R, 4): x, y and unit direction.
        spacing_m: Distance between them.
        limits: What to keep to.

    Returns:
        Speeds in m/s.

    >>> straight = np.column_stack([np.arange(5.0), *np.zeros((3, 5))]) + [0, 0, 1, 0]
    >>> limits = SpeedLimits(cruise_mps=4.0, braking_mps2=1.5, final_mps=2.0)
    >>> plan_speed(straight, 1.0, limits).round(3).tolist()
    [4.0, 3.606, 3.162, 2.646, 2.0]
    """
    bend = np.maximum(np.abs(curvature(points, spacing_m)), 1e-6)
    speed = np.minimum(limits.cruise_mps, np.sqrt(limits.lateral_mps2 / bend))
    speed[-1] = min(speed[-1], limits.final_mps)
    for i in range(len(speed) - 2, -1, -1):
        reachable = np.sqrt(speed[i + 1] ** 2 + 2.0 * limits.braking_mps2 * spacing_m)
        speed[i] = min(speed[i], reachable)
    return speed
