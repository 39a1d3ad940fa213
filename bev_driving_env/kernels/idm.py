"""The Intelligent Driver Model with highway-env's parameters (Treiber et al. 2000)."""

from __future__ import annotations

import math

from .jit import leaf_kernel

COMFORT_MPS2 = 3.0
BRAKING_MPS2 = 5.0
TIME_GAP_S = 1.5
JAM_GAP_M = 5.0
"""Between bumpers; highway-env's 10 m are from centre to centre of 5 m cars."""
CLIP_MPS2 = 6.0
SHORTEST_M = 0.1
_CLOSING = 1.0 / (2.0 * math.sqrt(COMFORT_MPS2 * BRAKING_MPS2))


@leaf_kernel
def idm_free(speed_mps: float, wanted_mps: float) -> float:
    """Acceleration on an empty road (m/s^2); braking if the wanted speed is 0."""
    if wanted_mps <= 0.0:
        return -BRAKING_MPS2
    ratio = speed_mps / wanted_mps
    ratio *= ratio
    return COMFORT_MPS2 * (1.0 - ratio * ratio)


@leaf_kernel
def idm_interaction(speed_mps: float, distance_m: float, jam_m: float, closing_mps: float) -> float:
    """What something ahead takes off the free acceleration (m/s^2, at least 0).

    Args:
        speed_mps: Own speed.
        distance_m: Distance to it; between centres if ``jam_m`` is.
        jam_m: Distance kept at standstill.
        closing_mps: Own speed minus its speed.
    """
    gap = jam_m + speed_mps * TIME_GAP_S + speed_mps * closing_mps * _CLOSING
    # highway-env squares negative gaps too: it brakes for a leader that flees fast enough
    ratio = max(gap, 0.0) / max(distance_m, SHORTEST_M)
    return COMFORT_MPS2 * ratio * ratio
