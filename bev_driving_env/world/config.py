"""Configuration of the world, one frozen dataclass per concern."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from ..checks import is_number, require_count, require_positive
from ..frames import BEVGeometry
from ..kernels.layout import Physics
from .infractions import INFRACTIONS, bits_of
from .traffic import TrafficConfig


def _require_all_positive(owner: Any) -> None:
    for item in fields(owner):
        require_positive(item.name, getattr(owner, item.name))


@dataclass(frozen=True)
class VehicleModel:
    """The ego car.

    Attributes:
        length_m: Both axles sit at its ends, as in highway-env.
        width_m: Width of the footprint.
        max_acceleration_mps2: What an acceleration command of 1 asks for, and -1 brakes with.
        max_steering_rad: Front wheel angle of a steering command of 1. At 1.22 rad the centre
            turns on a radius of 3.1 m; the tightest right turn of the towns has 3.8 m.
        speed_limit_mps: Above it the car slows down whatever is asked for (highway-env's limit).
    """

    length_m: float = 5.0
    width_m: float = 2.0
    max_acceleration_mps2: float = 5.0
    max_steering_rad: float = 1.22
    speed_limit_mps: float = 40.0

    def __post_init__(self) -> None:
        _require_all_positive(self)
        if self.max_steering_rad >= math.pi / 2.0:
            raise ValueError(f"max_steering_rad must be below pi/2, got {self.max_steering_rad!r}")


@dataclass(frozen=True)
class Rules:
    """When an infraction occurs and when a route counts as complete.

    Attributes:
        deviation_m: Distance from the planned lane centre that counts as ``route_deviation``.
        wrong_lane_s: Time in an opposing lane that counts as ``wrong_lane``.
        blocked_s: Time below ``blocked_mps``, with nothing to wait for, that counts as ``blocked``.
        blocked_mps: See above.
        success_fraction: Share of the route that must be done ...
        success_distance_m: ... and distance to its end, for success.
    """

    deviation_m: float = 3.5
    wrong_lane_s: float = 1.0
    blocked_s: float = 30.0
    blocked_mps: float = 0.1
    success_fraction: float = 0.99
    success_distance_m: float = 10.0

    def __post_init__(self) -> None:
        _require_all_positive(self)
        if self.success_fraction > 1.0:
            raise ValueError(f"success_fraction must be at most 1, got {self.success_fraction!r}")


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward terms (see ``kernels.reward``); a cruising step earns ``progress``."""

    progress: float = 1.0
    lateral: float = 0.5
    heading: float = 0.5
    comfort: float = 0.1
    infraction: float = 10.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (is_number(value) and value >= 0.0):
                raise ValueError(f"reward weight {item.name} must be a number >= 0, got {value!r}")


@dataclass(frozen=True)
class WorldConfig:
    """Everything that shapes a world, apart from the town.

    Attributes:
        control_hz: Actions per second.
        physics_hz: Integration steps per second, a multiple of ``control_hz``.
        cruise_speed_mps: Speed that the reward and the expert aim for.
        terminate_on: Infractions that end an episode.
        time_limit_s: Simulated time after which an episode is truncated; None gives each route
            30 s plus 0.8 s a metre (the CARLA Leaderboard's pace).
        dense_furniture: Whether more stands beside the roads than usual (``hard`` appearance).
        traffic: Other road users.
        vehicle: The ego car.
        rules: Thresholds of the infractions.
        reward: Weights of the reward.
        bev: Geometry of the bird's-eye view.
    """

    control_hz: int = 10
    physics_hz: int = 20
    cruise_speed_mps: float = 6.0
    terminate_on: tuple[str, ...] = tuple(INFRACTIONS)
    time_limit_s: float | None = None
    dense_furniture: bool = False
    traffic: TrafficConfig = field(default_factory=TrafficConfig)
    vehicle: VehicleModel = field(default_factory=VehicleModel)
    rules: Rules = field(default_factory=Rules)
    reward: RewardWeights = field(default_factory=RewardWeights)
    bev: BEVGeometry = field(default_factory=BEVGeometry)

    def __post_init__(self) -> None:
        require_positive("cruise_speed_mps", self.cruise_speed_mps)
        for name in ("control_hz", "physics_hz"):
            require_count(name, getattr(self, name))
        if self.physics_hz % self.control_hz:
            raise ValueError(
                f"physics_hz must be a multiple of control_hz, "
                f"got {self.physics_hz!r} and {self.control_hz!r}"
            )
        if self.time_limit_s is not None:
            require_positive("time_limit_s", self.time_limit_s)
        bits_of(self.terminate_on)

    @property
    def top_speed_mps(self) -> float:
        """Speed that is never exceeded: the limit, and one physics step of acceleration."""
        overshoot = self.vehicle.max_acceleration_mps2 / self.physics_hz
        return float(self.vehicle.speed_limit_mps + overshoot)

    @property
    def step_s(self) -> float:
        """Simulated seconds per control step."""
        return 1.0 / self.control_hz

    def time_limit_for(self, route_length_m: float) -> float:
        """Seconds after which an episode on a route of some length is truncated."""
        if self.time_limit_s is not None:
            return self.time_limit_s
        return 30.0 + 0.8 * route_length_m

    def physics(self) -> Physics:
        """The constants of the step kernel."""
        return Physics(
            dt_s=1.0 / self.physics_hz,
            substeps=self.physics_hz // self.control_hz,
            half_length_m=self.vehicle.length_m / 2.0,
            half_width_m=self.vehicle.width_m / 2.0,
            max_acceleration_mps2=float(self.vehicle.max_acceleration_mps2),
            max_steering_rad=float(self.vehicle.max_steering_rad),
            speed_limit_mps=float(self.vehicle.speed_limit_mps),
            cruise_speed_mps=float(self.cruise_speed_mps),
            deviation_m=float(self.rules.deviation_m),
            wrong_lane_after_s=float(self.rules.wrong_lane_s),
            blocked_after_s=float(self.rules.blocked_s),
            blocked_speed_mps=float(self.rules.blocked_mps),
            success_fraction=float(self.rules.success_fraction),
            success_distance_m=float(self.rules.success_distance_m),
            reward_progress=float(self.reward.progress),
            reward_lateral=float(self.reward.lateral),
            reward_heading=float(self.reward.heading),
            reward_comfort=float(self.reward.comfort),
            reward_infraction=float(self.reward.infraction),
        )
