"""``World``: N worlds of one town, stepped and rendered together."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bev import BEVRenderer
from ..frames import CHANNELS
from ..kernels.jit import announce_compilation, drop_stale_caches
from ..kernels.layout import (
    INVOLVED_PEDESTRIAN,
    INVOLVED_SIGNAL,
    INVOLVED_VEHICLE,
    REWARD_TERMS,
    ROUTE_DONE,
    ROUTE_POSITION,
)
from ..kernels.step import Ground, step_worlds
from ..towns.compiled import CompiledTown
from ..towns.plan import sparse_plan
from ..towns.route import Route
from .config import WorldConfig
from .fault import EGO, pedestrian_fault, vehicle_fault
from .infractions import InfractionEvent, bits_of, names_of
from .state import WorldState
from .streets import Streets


@dataclasses.dataclass(frozen=True, eq=False)
class WorldSnapshot:
    """Everything needed to continue from a moment, bit for bit."""

    config: WorldConfig
    state: WorldState
    routes: tuple[Route | None, ...]
    episode_ids: tuple[str, ...]
    events: tuple[tuple[InfractionEvent, ...], ...]
    rng_states: tuple[Mapping[str, Any], ...]


class World:
    """The one implementation of driving; a single environment is the case of one world.

    Attributes:
        town: The compiled town.
        config: The configuration.
        state: Arrays over the worlds.
        routes: Each world's route.
        episode_ids: Name of each world's episode, for results.
        events: Each world's infractions since reset.
        rngs: Each world's random generator, the only source of randomness.
        began: (N,) infraction bits that began in the last step.
        success: (N,) whether the route was completed in the last step.
        reward_terms: (N, 5) terms of the last step's reward.
        rewards: (N,) their sums; like the terms, 0 right after a reset.
    """

    def __init__(self, town: CompiledTown, config: WorldConfig, worlds: int = 1) -> None:
        self.town = town
        self.config = config
        self.state = WorldState.empty(
            worlds,
            vehicles=config.traffic.vehicles,
            pedestrians=config.traffic.pedestrians,
            signals=len(town.signals),
        )
        self.routes: list[Route | None] = [None] * worlds
        self.episode_ids = [""] * worlds
        self.events: list[tuple[InfractionEvent, ...]] = [()] * worlds
        self.rngs = [np.random.default_rng() for _ in range(worlds)]
        self.began = np.zeros(worlds, np.int64)
        self.success = np.zeros(worlds, np.bool_)
        self.reward_terms = np.zeros((worlds, REWARD_TERMS))
        self.rewards = np.zeros(worlds)
        self._terminating = bits_of(config.terminate_on)
        self._physics = config.physics()
        self._everyone = np.ones(worlds, np.bool_)
        drop_stale_caches()
        with announce_compilation():
            self._ground = _ground(town, dense=config.dense_furniture)
            self._streets = Streets(town, config) if config.traffic.moves else None
            self._renderer = BEVRenderer(town, config.bev)
            self._warm_up()

    def _warm_up(self) -> None:
        """Compile or load the kernels now, so that no later step pays for it."""
        nobody = np.zeros(len(self), np.bool_)
        self.step(np.zeros((len(self), 2)), nobody)
        self.render(np.zeros((len(self), *self.bev_shape), np.uint8), nobody)

    def __len__(self) -> int:
        return len(self.routes)

    @property
    def bev_shape(self) -> tuple[int, int, int]:
        """Shape of one BEV: channels, rows, columns."""
        return len(CHANNELS), self.config.bev.size, self.config.bev.size

    def place(self, world: int, route: Route, episode_id: str = "") -> None:
        """Start a world anew at the beginning of a route, standing still.

        Draws the episode's seed, on which its looks and noise depend, from the world's generator.
        """
        points = route.points
        self.state.clear(world)
        self.state.set_route(world, points, route.length_m, sparse_plan(route))
        self.state.episode_seed[world] = self.rngs[world].integers(1 << 62)
        self.state.ego[world, :3] = *points[0, :2], math.atan2(points[0, 3], points[0, 2])
        limit_s = self.config.time_limit_for(route.length_m)
        self.state.time_limit[world] = max(1, round(limit_s * self.config.control_hz))
        if self._streets is not None:
            self._streets.fill(self.state, world, route)
        self.routes[world] = route
        self.episode_ids[world] = episode_id
        self.events[world] = ()
        self._forget_last_step(world)

    def _forget_last_step(self, world: int | slice) -> None:
        self.began[world] = 0
        self.success[world] = False
        self.reward_terms[world] = 0.0
        self.rewards[world] = 0.0

    def step(self, actions: NDArray[np.float64], running: NDArray[np.bool_] | None = None) -> None:
        """Advance all running worlds by one control step.

        Args:
            actions: (N, 2) float64 in [-1, 1]: acceleration, steering.
            running: (N,) bool, all if None.
        """
        state = self.state
        running = self._everyone if running is None else running
        self.step_traffic(running)
        step_worlds(
            self._physics,
            self._ground,
            running,
            actions,
            state.vehicles,
            state.pedestrians,
            state.signals,
            state.waiting,
            state.ego,
            state.command,
            state.route_points,
            state.route_size,
            state.route_spacing,
            state.route_length,
            state.progress,
            state.timers,
            state.travelled,
            state.involved,
            state.attitude,
            state.holding,
            state.steps,
            state.returns,
            self.began,
            self.success,
            self.reward_terms,
            self.rewards,
        )
        if self.began.any():
            for world in np.flatnonzero(self.began):
                self._log(int(world))

    def step_traffic(self, running: NDArray[np.bool_] | None = None) -> None:
        """Advance all but the egos by one control step; a part of ``step``.

        Args:
            running: (N,) bool, all if None.
        """
        if self._streets is not None:
            self._streets.step(self.state, self._everyone if running is None else running)

    def _log(self, world: int) -> None:
        x, y, heading, speed = self.state.ego[world].tolist()
        time_s = float(self.state.steps[world]) * self.config.step_s
        route_m = float(self.state.progress[world, ROUTE_DONE])
        self.events[world] += tuple(
            InfractionEvent(name, time_s, x, y, heading, speed, route_m, *self._blame(world, name))
            for name in names_of(int(self.began[world]))
        )

    def _blame(self, world: int, name: str) -> tuple[str, str]:
        """The other party of an infraction that has just begun, and who was at fault."""
        state, ego = self.state, self.state.ego[world].tolist()
        involved = state.involved[world].tolist()
        if name == "collision_vehicle":
            number = involved[INVOLVED_VEHICLE]
            other = state.vehicles[world, number].tolist()
            return f"vehicle {number}", vehicle_fault(ego, self.config.vehicle.length_m, other)
        if name == "collision_pedestrian":
            number = involved[INVOLVED_PEDESTRIAN]
            pedestrian = state.pedestrians[world, number].tolist()
            return f"pedestrian {number}", pedestrian_fault(ego, pedestrian)
        return f"signal {involved[INVOLVED_SIGNAL]}" if name == "red_light" else "", EGO

    def allowance(self, world: int) -> float:
        """How much the traffic around takes off a careful driver's acceleration, in m/s^2.

        That is the ego's IDM interaction with leaders, signals, junctions and people on crossings,
        by the rules that the other vehicles keep to; 0 where nothing is in the way.
        """
        return 0.0 if self._streets is None else self._streets.allowance(self.state, world)

    def terminated(self) -> NDArray[np.bool_]:
        """(N,) whether the last step ended a world: success or a terminating infraction."""
        return self.success | (self.began & self._terminating != 0)

    def truncated(self) -> NDArray[np.bool_]:
        """(N,) whether the time limit, and nothing else, ended a world."""
        return (self.state.steps >= self.state.time_limit) & ~self.terminated()

    def render(self, bev: NDArray[np.uint8], selected: NDArray[np.bool_] | None = None) -> None:
        """Render the ground-truth BEV of selected worlds into (N, 6, size, size) uint8."""
        self._renderer.render(self.state, self._everyone if selected is None else selected, bev)

    def route_position_m(self, world: int) -> float:
        """Where along its route a world's ego is now, in metres."""
        return float(self.state.progress[world, ROUTE_POSITION])

    def snapshot(self) -> WorldSnapshot:
        """Copy everything that the future depends on."""
        return WorldSnapshot(
            config=self.config,
            state=self.state.copy(),
            routes=tuple(self.routes),
            episode_ids=tuple(self.episode_ids),
            events=tuple(self.events),
            rng_states=tuple(copy.deepcopy(rng.bit_generator.state) for rng in self.rngs),
        )

    def restore(self, snapshot: WorldSnapshot) -> None:
        """Go back to a snapshot; from there the same actions give the same bits.

        Raises:
            TypeError: It is not a ``WorldSnapshot``.
            ValueError: It is of another number of worlds, town or configuration. Only the BEV's
                geometry may differ.
        """
        if not isinstance(snapshot, WorldSnapshot):
            raise TypeError(f"expected a WorldSnapshot, got {type(snapshot).__name__}")
        for route in snapshot.routes:
            if route is not None and route.town.name != self.town.name:
                raise ValueError(
                    f"snapshot was taken in {route.town.name}, this environment is {self.town.name}"
                )
        theirs = dataclasses.replace(snapshot.config, bev=self.config.bev)
        for item in dataclasses.fields(theirs):
            if getattr(theirs, item.name) != getattr(self.config, item.name):
                raise ValueError(
                    f"snapshot was taken with {item.name} {getattr(theirs, item.name)!r}, "
                    f"this environment has {getattr(self.config, item.name)!r}"
                )
        if len(snapshot.routes) != len(self):
            raise ValueError(
                f"snapshot holds {len(snapshot.routes)} worlds, this environment {len(self)}"
            )
        self.state = snapshot.state.copy()
        self.routes = list(snapshot.routes)
        self.episode_ids = list(snapshot.episode_ids)
        self.events = list(snapshot.events)
        for rng, state in zip(self.rngs, snapshot.rng_states, strict=True):
            rng.bit_generator.state = copy.deepcopy(state)
        self._forget_last_step(slice(None))


def _ground(town: CompiledTown, *, dense: bool) -> Ground:
    """What the rules see of a town, which must not depend on how finely the view is drawn."""
    classes, directions, solids = town.classes(), town.directions, town.solids(dense=dense)
    return Ground(
        classes=classes.pixels,
        classes_grid=classes.grid,
        directions=directions.pixels,
        directions_grid=directions.grid,
        solids=solids.boxes,
        solid_start=solids.cell_start,
        solid_items=solids.cell_items,
        solid_grid=solids.grid,
        stop_lines=town.stop_lines,
    )
