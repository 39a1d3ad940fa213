"""The kinematic bicycle of highway-env's ``Vehicle``, one explicit Euler step at a time."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import kernel
from .layout import HEADING, SPEED, X, Y


@kernel
def braked(
    acceleration_mps2: float, speed_mps: float, speed_limit_mps: float, dt_s: float
) -> float:
    """Limit an acceleration so that brakes stop the car and never reverse it.

    Above the speed limit the car slows by 1/s times the excess, as in highway-env.
    """
    if speed_mps > speed_limit_mps:
        acceleration_mps2 = min(acceleration_mps2, speed_limit_mps - speed_mps)
    return max(acceleration_mps2, -speed_mps / dt_s)


@kernel
def advance(
    ego: NDArray, acceleration_mps2: float, steering_rad: float, half_length_m: float, dt_s: float
) -> None:
    """Move one vehicle row (x, y, heading, speed, ...) by one step, in place.

    The reference point is the centre of the vehicle; both axles sit at its ends, so the slip angle
    is atan(tan(steering) / 2) (highway-env, ``Vehicle.step``).
    """
    slip = math.atan(0.5 * math.tan(steering_rad))
    course = ego[HEADING] + slip
    ego[X] += ego[SPEED] * math.cos(course) * dt_s
    ego[Y] += ego[SPEED] * math.sin(course) * dt_s
    ego[HEADING] += ego[SPEED] * math.sin(slip) / half_length_m * dt_s
    if acceleration_mps2 == -ego[SPEED] / dt_s:
        ego[SPEED] = 0.0  # the sum below would leave a rest of 1e-17, of either sign
    else:
        ego[SPEED] += acceleration_mps2 * dt_s
