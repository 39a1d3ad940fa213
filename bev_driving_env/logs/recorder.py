"""``EpisodeRecorder``: takes down a drive while it happens."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernels.layout import LENGTH, ROUTE_POSITION, WIDTH
from ..world.core import World
from .episode import EpisodeLog
from .header import EpisodeHeader
from .packing import on_grid
from .reach import within_sight


class EpisodeRecorder:
    """Takes down one episode of the first world, from its reset on.

    Args:
        world: A world that has just been placed on its route.
        collection: Number of the collection.
        collection_seed: Its seed.
        route: Number of the route in the town's book.
        level: Perturbation level.

    Raises:
        ValueError: The world is not at the start of an episode.
    """

    def __init__(
        self, world: World, *, collection: int, collection_seed: int, route: int, level: float
    ) -> None:
        driven, state = world.routes[0], world.state
        if driven is None or state.steps[0] != 0:
            raise ValueError(
                f"recording must start right after a reset, got step {int(state.steps[0])}"
            )
        self._world = world
        self._motion: list[NDArray[np.float64]] = []
        self._actions: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
        self._infractions: list[int] = []
        self._signals: list[NDArray[np.uint8]] = []
        self._actors: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.int32]] = []
        self.header = EpisodeHeader(
            episode_id=world.episode_ids[0],
            episode_seed=int(state.episode_seed[0]),
            collection=collection,
            collection_seed=collection_seed,
            route=route,
            level=level,
            lanes=tuple(int(lane) for lane in driven.lanes),
            start_m=float(driven.start_m),
            end_m=float(driven.end_m),
            vehicle_sizes=_sizes(state.vehicles[0]),
            pedestrian_sizes=_sizes(state.pedestrians[0]),
            signals=state.signals.shape[1],
        )

    def __len__(self) -> int:
        return len(self._motion)

    def record(self, clean: ArrayLike, applied: ArrayLike) -> None:
        """Take down the present state, and the actions chosen in it, before the world is stepped.

        Args:
            clean: (2,) what the expert asks for: acceleration, steering.
            applied: (2,) what the car will be given.

        Raises:
            ValueError: A step was left out.
        """
        state = self._world.state
        if state.steps[0] != len(self):
            raise ValueError(f"expected step {len(self)}, the world is at {int(state.steps[0])}")
        self._motion.append(
            np.concatenate([state.ego[0], state.attitude[0], [state.progress[0, ROUTE_POSITION]]])
        )
        self._actions.append((np.array(clean, np.float32), np.array(applied, np.float32)))
        self._infractions.append(int(self._world.began[0]))
        self._signals.append(state.signals[0].copy())
        vehicles, pedestrians = state.vehicles[0], state.pedestrians[0]
        numbers = np.flatnonzero(within_sight(state.ego[0], vehicles, pedestrians))
        self._actors.append(numbers)
        self._rows.append(on_grid(np.concatenate([vehicles, pedestrians])[numbers, :LENGTH]))

    def finish(self, outcome: str) -> EpisodeLog:
        """The drive so far.

        Args:
            outcome: How it ended, see ``EpisodeHeader``.

        Raises:
            ValueError: No step was recorded, or an actor has changed its size.
        """
        if not len(self):
            raise ValueError("an episode without a step cannot be logged: call record() first")
        state = self._world.state
        for rows, sizes in (
            (state.vehicles[0], self.header.vehicle_sizes),
            (state.pedestrians[0], self.header.pedestrian_sizes),
        ):
            if _sizes(rows) != sizes:
                raise ValueError("an actor has changed its size, which logs cannot hold")
        events = tuple(dataclasses.asdict(event) for event in self._world.events[0])
        counts = [len(numbers) for numbers in self._actors]
        return EpisodeLog(
            header=dataclasses.replace(self.header, outcome=outcome, infractions=events),
            motion=np.stack(self._motion),
            clean=np.stack([clean for clean, _ in self._actions]),
            applied=np.stack([applied for _, applied in self._actions]),
            infractions=np.array(self._infractions, np.int32),
            signals=np.stack(self._signals),
            first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            actors=np.concatenate(self._actors).astype(np.int32),
            rows=np.concatenate(self._rows),
        )


def _sizes(rows: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    return tuple((float(length), float(width)) for length, width in rows[:, [LENGTH, WIDTH]])
