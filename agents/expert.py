"""The privileged expert: follows the planned route with the environment's own knowledge."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.kernels.idm import idm_free
from bev_driving_env.kernels.layout import SPEED
from bev_driving_env.kernels.progress import route_pose
from bev_driving_env.towns.route import Route

from .speed_plan import SpeedLimits, plan_speed


class Expert:
    """Drives the route of a ``BEVTownEnv`` without looking at the observation.

    Steering: the centre of a kinematic bicycle moves along heading + slip, so the slip is set to
    point at the route a short way ahead (pure pursuit of the velocity, not of the body). Speed:
    a profile planned from curvature, tracked with a proportional law; in traffic no faster than
    the Intelligent Driver Model allows behind leaders, before stop lines, junctions that are not
    free, and crossings with people on them.

    Args:
        env: A ``BEVTownEnv``, wrapped or not.
        lookahead_m: Distance to the point steered at, at standstill.
        lookahead_s: What it grows by, in seconds of driving.

    Raises:
        TypeError: The environment is not a ``BEVTownEnv``.
    """

    def __init__(
        self, env: gym.Env[Any, Any], lookahead_m: float = 0.6, lookahead_s: float = 0.25
    ) -> None:
        if not isinstance(env.unwrapped, BEVTownEnv):
            raise TypeError(f"the expert drives a BEVTownEnv, got {type(env.unwrapped).__name__}")
        self.env: BEVTownEnv = env.unwrapped
        self.lookahead_m = lookahead_m
        self.lookahead_s = lookahead_s
        self._planned: Route | None = None
        self._speed: NDArray[np.float64] = np.zeros(0)

    def reset(self, seed: int | None = None) -> None:
        """Forget the last route; the seed is not used, the expert is deterministic."""
        self._planned = None

    def act(self, observation: Mapping[str, NDArray[Any]] | None = None) -> NDArray[np.float32]:
        """Choose the action for the environment's present state."""
        route = self.env.route
        if route is not self._planned:
            limits = SpeedLimits(cruise_mps=self.env.world.config.cruise_speed_mps)
            self._speed = plan_speed(route.points, route.spacing_m, limits)
            self._planned = route
        position_m = self.env.world.route_position_m(0)
        speed = float(self.env.world.state.ego[0, SPEED])
        return np.array(
            [self._accelerate(route, position_m, speed), self._steer(route, position_m, speed)],
            dtype=np.float32,
        )

    def _steer(self, route: Route, position_m: float, speed_mps: float) -> float:
        """Steering command that points the velocity at the route ahead."""
        x, y, heading = self.env.ego_pose
        ahead_m = self.lookahead_m + self.lookahead_s * speed_mps
        points = route.points
        target_m = position_m + ahead_m
        target_x, target_y, dx, dy = route_pose(points, len(points), route.spacing_m, target_m)
        beyond = max(0.0, target_m - route.length_m)
        wanted = math.atan2(target_y + beyond * dy - y, target_x + beyond * dx - x)
        slip = math.remainder(wanted - heading, 2.0 * math.pi)
        vehicle = self.env.world.config.vehicle
        largest = math.atan(0.5 * math.tan(vehicle.max_steering_rad))
        slip = min(max(slip, -largest), largest)
        return math.atan(2.0 * math.tan(slip)) / vehicle.max_steering_rad

    def _accelerate(self, route: Route, position_m: float, speed_mps: float) -> float:
        """Acceleration command that tracks the planned speed half a second ahead."""
        where = (position_m + 0.5 * speed_mps) / route.spacing_m
        wanted = float(np.interp(where, np.arange(len(self._speed)), self._speed))
        config = self.env.world.config
        acceleration = (wanted - speed_mps) / 0.5
        if config.traffic.moves:
            free = idm_free(speed_mps, config.cruise_speed_mps)
            acceleration = min(acceleration, free - self.env.world.allowance(0))
        return min(max(acceleration / config.vehicle.max_acceleration_mps2, -1.0), 0.5)
