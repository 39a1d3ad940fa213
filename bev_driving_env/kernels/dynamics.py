"""The kinematic bicycle of highway-env's ``Vehicle``, one explicit Euler step at a time."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import HEADING, PITCH, ROLL, SPEED, X, Y

LEAN_RAD_PER_MPS2 = math.radians(0.4)
"""How far the body pitches or rolls per acceleration: 2 degrees under full braking."""
MOST_LEAN_RAD = math.radians(2.0)
LEAN_TIME_S = 0.3


@leaf_kernel
def braked(
    acceleration_mps2: float, speed_mps: float, speed_limit_mps: float, dt_s: float
) -> float:
    """Limit an acceleration so that brakes stop the car and never reverse it.

    Above the speed limit the car slows by 1/s times the excess, as in highway-env.
    """
    if speed_mps > speed_limit_mps:
        acceleration_mps2 = min(acceleration_mps2, speed_limit_mps - speed_mps)
    return max(acceleration_mps2, -speed_mps / dt_s)


@leaf_kernel
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


@leaf_kernel
def sway(attitude: NDArray, acceleration_mps2: float, lateral_mps2: float, dt_s: float) -> None:
    """Move the body's pitch and roll (2,) towards what the accelerations ask for, in place.

    Braking lowers the nose; a right turn, whose acceleration is positive, lowers the left side.
    The angles follow with a lag of 0.3 s and never exceed 2 degrees.
    """
    pitch = min(max(-acceleration_mps2 * LEAN_RAD_PER_MPS2, -MOST_LEAN_RAD), MOST_LEAN_RAD)
    roll = min(max(-lateral_mps2 * LEAN_RAD_PER_MPS2, -MOST_LEAN_RAD), MOST_LEAN_RAD)
    share = dt_s / LEAN_TIME_S if dt_s < LEAN_TIME_S else 1.0
    attitude[PITCH] += share * (pitch - attitude[PITCH])
    attitude[ROLL] += share * (roll - attitude[ROLL])
