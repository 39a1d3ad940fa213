"""Reward terms of one control step."""

from __future__ import annotations

import math

from numpy.typing import NDArray

from .jit import leaf_kernel
from .layout import (
    ACCELERATION,
    HEADING_ERROR,
    LATERAL,
    REWARD_COMFORT,
    REWARD_HEADING,
    REWARD_INFRACTIONS,
    REWARD_LATERAL,
    REWARD_PROGRESS,
    ROUTE_DONE,
    STEERING,
    Physics,
)

LATERAL_SCALE_M = 3.5


@leaf_kernel
def fill_reward_terms(
    physics: Physics,
    route_done_before_m: float,
    progress: NDArray,
    command_before: NDArray,
    command: NDArray,
    infractions: int,
    terms: NDArray,
) -> None:
    """Fill one world's reward terms (5,), each already weighted; their sum is the reward.

    * progress: new route metres over what cruising covers in a step, at most 1 (speeding pays
      nothing), so a cruising car on its route earns the weight each step;
    * lateral: minus the distance to the side of the lane centre over 3.5 m, at most 1;
    * heading: minus the heading error over pi;
    * comfort: minus the mean change of the two commands over their range;
    * infractions: minus 1 for each infraction that began in this step.
    """
    step_s = physics.dt_s * physics.substeps
    gained_m = progress[ROUTE_DONE] - route_done_before_m
    terms[REWARD_PROGRESS] = physics.reward_progress * min(
        gained_m / (physics.cruise_speed_mps * step_s), 1.0
    )
    terms[REWARD_LATERAL] = -physics.reward_lateral * min(
        abs(progress[LATERAL]) / LATERAL_SCALE_M, 1.0
    )
    terms[REWARD_HEADING] = -physics.reward_heading * abs(progress[HEADING_ERROR]) / math.pi
    jerk = abs(command[ACCELERATION] - command_before[ACCELERATION])
    jerk += abs(command[STEERING] - command_before[STEERING])
    terms[REWARD_COMFORT] = -physics.reward_comfort * jerk / 4.0
    count = 0
    while infractions:
        count += infractions & 1
        infractions >>= 1
    terms[REWARD_INFRACTIONS] = -physics.reward_infraction * count
