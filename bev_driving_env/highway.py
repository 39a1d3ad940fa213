"""``BEVObservation``: the same bird's-eye view from any highway-env environment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from highway_env.envs.common.action import ContinuousAction
from highway_env.road.road import LaneIndex, RoadNetwork
from highway_env.vehicle.kinematics import Vehicle
from numpy.typing import NDArray

from .bev import ROUTE_AHEAD_M, BEVRenderer
from .checks import configured
from .frames import CHANNELS, BEVGeometry
from .kernels.jit import announce_compilation, drop_stale_caches
from .kernels.layout import ACTOR_COLUMNS
from .spaces import observation_space
from .towns.compiled import CompiledTown, Lane, compile_network
from .towns.route import lane_offsets, resample
from .world.state import WorldState

Observation = dict[str, NDArray[Any]]

GAP_M = 8.0
"""A route is drawn on across a gap this long: roundabout-v1 leaves 5.6 m before its ring."""


class BEVObservation(gym.ObservationWrapper[Any, Any, Any]):
    """Replaces a highway-env observation by BEVTown's: six-channel ``bev`` and ``measurements``.

    The road and lane channels come from the environment's road network, the vehicles channel from
    its other vehicles, the route channel from the ego's own planned route where it has one.
    Pedestrians and lights do not exist in highway-env, so their channels are empty; obstacles
    that are not vehicles are not drawn. Commands are scaled by highway-env's ranges
    (5 m/s^2, pi/4).

    >>> import gymnasium, highway_env
    >>> env = BEVObservation(gymnasium.make("intersection-v2"))
    >>> env.reset(seed=0)[0]["bev"].shape
    (6, 192, 192)

    Args:
        env: Any environment built on highway-env's ``AbstractEnv``.
        bev: Geometry of the view: a ``BEVGeometry`` or a mapping of its fields.

    Raises:
        TypeError: The environment has no highway-env road.
    """

    def __init__(
        self, env: gym.Env[Any, Any], bev: BEVGeometry | Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(env)
        if not hasattr(env.unwrapped, "road") or not hasattr(env.unwrapped, "vehicle"):
            raise TypeError(
                f"BEVObservation needs a highway-env environment with a road and a vehicle, "
                f"got {type(env.unwrapped).__name__}"
            )
        self.geometry: BEVGeometry = configured(BEVGeometry, bev or BEVGeometry())
        self.observation_space = observation_space(
            # highway-env lets its limits be overshot while it steers back to them
            self.geometry,
            2.0 * Vehicle.MAX_SPEED,
            2.0 * Vehicle.MIN_SPEED,
        )
        self._state = WorldState.empty(1)
        self._compiled: tuple[RoadNetwork, CompiledTown] | None = None
        self._rendering: tuple[CompiledTown, BEVRenderer] | None = None
        self._numbers: dict[LaneIndex, int] = {}
        drop_stale_caches()

    def observation(self, observation: Any) -> Observation:
        """Draw the view of the environment's present state; its own observation is not used."""
        road, ego = self.env.unwrapped.road, self.env.unwrapped.vehicle  # type: ignore[attr-defined]
        town = self._town(road.network)
        self._state.ego[0] = (*ego.position, ego.heading, ego.speed)
        others = [vehicle for vehicle in road.vehicles if vehicle is not ego]
        self._state.vehicles = _boxes(others)[None]
        self._set_route(town, ego)
        bev = np.empty((1, len(CHANNELS), self.geometry.size, self.geometry.size), np.uint8)
        self._renderer(town).render(self._state, np.ones(1, np.bool_), bev)
        return {"bev": bev[0], "measurements": _measurements(ego)}

    def _town(self, network: RoadNetwork) -> CompiledTown:
        """Compile the network, unless it equals the last one (highway-env rebuilds it at reset)."""
        if self._compiled is not None and self._compiled[0] is network:
            return self._compiled[1]
        town = compile_network(type(self.env.unwrapped).__name__, network, allow_dead_ends=True)
        if self._compiled is not None and _same_lanes(town.lanes, self._compiled[1].lanes):
            town = self._compiled[1]
        self._compiled = (network, town)
        self._numbers = {lane.index: number for number, lane in enumerate(town.lanes)}
        return town

    def _renderer(self, town: CompiledTown) -> BEVRenderer:
        """The renderer of a town, made and its kernel compiled on first use."""
        if self._rendering is None or self._rendering[0] is not town:
            size = self.geometry.size
            with announce_compilation():
                renderer = BEVRenderer(town, self.geometry)
                nothing = np.empty((1, len(CHANNELS), size, size), np.uint8)
                renderer.render(WorldState.empty(1), np.zeros(1, np.bool_), nothing)
            self._rendering = (town, renderer)
        return self._rendering[1]

    def _set_route(self, town: CompiledTown, ego: Vehicle) -> None:
        chain = self._route_lanes(town, ego)
        length_m = 0.0
        if chain:
            start_m, _ = chain[0].nearest(*ego.position)
            whole_m = lane_offsets(chain)[-1] + chain[-1].length_m
            length_m = min(whole_m - start_m, ROUTE_AHEAD_M)
        if length_m < 1.0:
            self._state.route_size[0] = 0
            return
        self._state.set_route(0, resample(chain, start_m, length_m), length_m)

    def _route_lanes(self, town: CompiledTown, ego: Vehicle) -> list[Lane]:
        """The ego's own route as lanes, as far as they lead on to each other."""
        chain: list[Lane] = []
        here = np.asarray(ego.position, dtype=np.float64)
        for start, end, number in getattr(ego, "route", None) or []:
            count = len(ego.road.network.graph[start][end])
            numbers = range(count) if number is None else [number]
            lanes = [town.lanes[self._numbers[(start, end, k)]] for k in numbers]
            # the first lane is the one the ego is on, the next ones start where the last ended
            gaps = [
                float(np.hypot(*(lane.points[0, :2] - here))) if chain else lane.nearest(*here)[1]
                for lane in lanes
            ]
            nearest = int(np.argmin(gaps))
            if chain and gaps[nearest] > GAP_M:
                break
            chain.append(lanes[nearest])
            here = chain[-1].points[-1, :2]
        return chain


def _same_lanes(lanes: Sequence[Lane], others: Sequence[Lane]) -> bool:
    """Whether two networks have the same lanes in the same places."""
    return len(lanes) == len(others) and all(
        a.index == b.index
        and a.lines == b.lines
        and np.array_equal(a.points, b.points)
        and np.array_equal(a.half_width, b.half_width)
        for a, b in zip(lanes, others, strict=True)
    )


def _boxes(vehicles: Sequence[Vehicle]) -> NDArray[np.float64]:
    """Footprints (V, 6): x, y, heading, speed, length, width."""
    rows = [(*v.position, v.heading, v.speed, v.LENGTH, v.WIDTH) for v in vehicles]
    return np.array(rows, dtype=np.float64).reshape(-1, ACTOR_COLUMNS)


def _measurements(ego: Vehicle) -> NDArray[np.float32]:
    action = ego.action if isinstance(ego.action, dict) else {}
    acceleration = float(action.get("acceleration", 0.0)) / ContinuousAction.ACCELERATION_RANGE[1]
    steering = float(action.get("steering", 0.0)) / ContinuousAction.STEERING_RANGE[1]
    values = (ego.speed, min(max(acceleration, -1.0), 1.0), min(max(steering, -1.0), 1.0))
    assert all(math.isfinite(value) for value in values)
    return np.array(values, dtype=np.float32)
