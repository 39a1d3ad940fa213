"""``Streets``: the traffic of N worlds in one town, as the world core asks for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.signals import show_signals
from ..kernels.traffic import ego_allowance, make_workspace, step_traffic
from ..towns.compiled import CompiledTown
from ..towns.rails import route_rails
from ..towns.route import Route
from .config import WorldConfig
from .pedestrians import place_pedestrians
from .state import WorldState
from .traffic import traffic_room
from .vehicles import place_vehicles, vehicle_slots


class Streets:
    """Places traffic at reset and moves it at each step; all that changes is in the state.

    Args:
        town: The town.
        config: The world's configuration.

    Raises:
        ValueError: The town has not enough room for so much traffic.
    """

    def __init__(self, town: CompiledTown, config: WorldConfig) -> None:
        streets = town.traffic(dense=config.dense_furniture)
        self.traffic = config.traffic
        self._step_s = config.step_s
        self._network, self._sidewalks = streets.network, streets.sidewalks
        self._plan = streets.plan if config.traffic.lights else streets.no_plan
        self._half_length_m = config.vehicle.length_m / 2.0
        self._half_width_m = config.vehicle.width_m / 2.0
        tables = streets.network.tables
        self._work = make_workspace(
            config.traffic.vehicles,
            config.traffic.pedestrians,
            len(tables.length),
            len(streets.sidewalks.crossings.length),
        )
        self._slots = vehicle_slots(tables)
        for name, room in traffic_room(town, dense=config.dense_furniture).items():
            wanted = getattr(config.traffic, name)
            if wanted > room:
                raise ValueError(
                    f"{town.name} has room for {room} {name}, got {wanted}; ask for fewer"
                )

    def fill(self, state: WorldState, world: int, route: Route) -> None:
        """Put a world's traffic where its episode seed says; everybody stands."""
        seed = int(state.episode_seed[world])
        rng = np.random.default_rng(seed)
        state.set_route_rails(world, *route_rails(self._network, route))
        ego = float(state.ego[world, 0]), float(state.ego[world, 1])
        rows, track, motion = place_vehicles(
            self._network.tables, self._slots, self.traffic.vehicles, seed, ego, rng
        )
        state.vehicles[world], state.vehicle_track[world] = rows, track
        state.vehicle_motion[world] = motion
        rows, track, motion = place_pedestrians(self._sidewalks, self.traffic.pedestrians, rng)
        state.pedestrians[world], state.pedestrian_track[world] = rows, track
        state.pedestrian_motion[world] = motion
        if len(self._plan.phase):
            show_signals(self._plan, 0.0, seed, state.signals[world])

    def step(self, state: WorldState, running: NDArray[np.bool_]) -> None:
        """Advance the traffic of running worlds by one control step."""
        step_traffic(
            self._network.tables,
            self._sidewalks.walks,
            self._sidewalks.crossings,
            self._plan,
            self._work,
            self._step_s,
            self._half_length_m,
            self._half_width_m,
            running,
            state.episode_seed,
            state.steps,
            state.ego,
            state.progress,
            state.timers,
            state.route_rails,
            state.route_rail_m,
            state.route_rail_count,
            state.vehicles,
            state.vehicle_track,
            state.vehicle_motion,
            state.pedestrians,
            state.pedestrian_track,
            state.pedestrian_motion,
            state.signals,
            state.waiting,
        )

    def allowance(self, state: WorldState, world: int) -> float:
        """See ``World.allowance``."""
        return float(
            ego_allowance(
                self._network.tables,
                self._sidewalks.crossings,
                self._work,
                self._half_length_m,
                state.ego[world],
                state.progress[world],
                state.timers[world],
                bool(state.waiting[world]),
                state.route_rails[world],
                state.route_rail_m[world],
                state.route_rail_count[world],
                state.vehicles[world],
                state.vehicle_track[world],
                state.vehicle_motion[world],
                state.pedestrian_track[world],
                state.pedestrian_motion[world],
                state.signals[world],
            )
        )
