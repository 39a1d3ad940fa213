"""``EpisodeReplay``: the states of one recorded drive, as far as anything that is drawn shows."""

from __future__ import annotations

import numpy as np

from ..kernels.layout import LENGTH, ROUTE_POSITION
from ..towns.compiled import CompiledTown
from ..towns.plan import sparse_plan
from ..towns.route import Route
from ..world.state import WorldState
from .episode import EpisodeLog
from .packing import ACTOR_GRID


class EpisodeReplay:
    """Lays out the states of one episode, one at a time, in arrays that it keeps.

    Args:
        town: The town it was driven in.
        log: The recorded drive.

    Attributes:
        log: See above.
    """

    def __init__(self, town: CompiledTown, log: EpisodeLog) -> None:
        header = log.header
        route = Route(town, header.lanes, header.start_m, header.end_m)
        vehicles, pedestrians = len(header.vehicle_sizes), len(header.pedestrian_sizes)
        state = WorldState.empty(
            1, vehicles=vehicles, pedestrians=pedestrians, signals=header.signals
        )
        state.set_route(0, route.points, route.length_m, sparse_plan(route))
        state.episode_seed[0] = header.episode_seed
        self.log = log
        self._state = state
        self._vehicles = vehicles
        sizes = [*header.vehicle_sizes, *header.pedestrian_sizes]
        self._sizes = np.array(sizes, np.float64).reshape(-1, 2)

    def at(self, step: int) -> WorldState:
        """The state (of one world) at a step; the next call overwrites it."""
        log, state = self.log, self._state
        motion = log.motion[step]
        state.ego[0] = motion[:4]
        state.attitude[0] = motion[4:6]
        state.progress[0, ROUTE_POSITION] = motion[6]
        # what was applied one step ago is the last command now
        state.command[0] = log.applied[step - 1] if step else 0.0
        state.steps[0] = step
        state.signals[0] = log.signals[step]
        begin, end = log.first[step], log.first[step + 1]
        numbers = log.actors[begin:end]
        rows = log.rows[begin:end] / ACTOR_GRID
        split = int(np.searchsorted(numbers, self._vehicles))
        for table, chosen, offset in (
            (state.vehicles[0], slice(0, split), 0),
            (state.pedestrians[0], slice(split, None), self._vehicles),
        ):
            table[:] = 0.0
            table[numbers[chosen] - offset, :LENGTH] = rows[chosen]
            table[numbers[chosen] - offset, LENGTH:] = self._sizes[numbers[chosen]]
        return state
