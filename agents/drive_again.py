"""Recorded drives, driven again: what a log leaves out follows from the seeds and the actions.

A log has neither rewards nor the state after the last action. Each drive is taken down again while
it is driven, and counts only if that gives the same log to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.logs.episode import EpisodeLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import EpisodeHeader

from .collect import EpisodeJob


@dataclass(frozen=True, eq=False)
class Transitions:
    """Consecutive steps of one drive.

    Attributes:
        first_step: Number of the first one in the drive.
        bev: (T + 1, C, size, size) uint8.
        measurements: (T + 1, 3) float32.
        actions: (T, 2) float32 what the car was given.
        clean: (T + 1, 2) float32 what the expert asked for; NaN at the end.
        rewards: (T,) float64.
        terminations: (T,) bool.
        truncations: (T,) bool; at the end also where the drive or this part of it was cut.
    """

    first_step: int
    bev: NDArray[np.uint8]
    measurements: NDArray[np.float32]
    actions: NDArray[np.float32]
    clean: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]

    @classmethod
    def empty(cls, space: gym.spaces.Dict, log: EpisodeLog, steps: range) -> Transitions:
        """Steps of a recorded drive, still without what driving it again will show."""
        rows, part = len(steps), slice(steps.start, steps.stop)
        nothing = np.full((1, 2), np.nan, np.float32)
        return cls(
            first_step=steps.start,
            bev=np.empty((rows + 1, *(space["bev"].shape or ())), np.uint8),
            measurements=np.empty((rows + 1, 3), np.float32),
            actions=log.applied[part],
            clean=np.concatenate([log.clean[part], nothing]),
            rewards=np.empty(rows, np.float64),
            terminations=np.zeros(rows, np.bool_),
            truncations=np.zeros(rows, np.bool_),
        )

    def observe(self, row: int, observation: Mapping[str, NDArray[Any]]) -> None:
        """Keep an observation."""
        self.bev[row] = observation["bev"]
        self.measurements[row] = observation["measurements"]


def reset_arguments(header: EpisodeHeader) -> dict[str, Any]:
    """What the environment's ``reset`` was called with: ``seed`` and ``options``."""
    seed, _ = _job(header).seeds
    return {"seed": seed, "options": {"route": header.route}}


def _job(header: EpisodeHeader) -> EpisodeJob:
    """What the drive was collected for."""
    return EpisodeJob(header.collection, header.route, header.level, header.collection_seed)


def drive_again(
    env: gym.Env[Any, Any], log: DriveLog, number: int, max_steps: int | None = None
) -> Iterator[Transitions]:
    """Drive an episode of a log once more, by its seed and the actions that were applied.

    Args:
        env: The environment of the log's header.
        log: The log.
        number: Of the episode.
        max_steps: Cut the drive into parts of at most so many steps.

    Yields:
        The whole drive, or its parts in order.

    Raises:
        LogError: It was another drive this time; parts that came before do not count then.
    """
    world_env: Any = env.unwrapped
    recorded = log.replay(number).log
    header, total = recorded.header, len(recorded)
    observation, _ = world_env.reset(**reset_arguments(header))
    recorder = _job(header).recorder(world_env.world)
    for begin in range(0, total, max_steps or total):
        steps = range(begin, min(begin + (max_steps or total), total))
        part = Transitions.empty(world_env.observation_space, recorded, steps)
        part.observe(0, observation)
        for row, step in enumerate(steps):
            recorder.record(recorded.clean[step], recorded.applied[step])
            observation, reward, terminated, truncated, _ = world_env.step(recorded.applied[step])
            if (terminated or truncated) and step < total - 1:
                raise _another_drive(log, header, step)
            part.observe(row + 1, observation)
            part.rewards[row] = reward
            part.terminations[row], part.truncations[row] = terminated, truncated
        # what the collection gave up, or what goes on in the next part, ends by truncation
        part.truncations[-1] |= not part.terminations[-1]
        if steps.stop == total:
            _require_same(log, recorded, recorder.finish(header.outcome))
        yield part


def _require_same(log: DriveLog, recorded: EpisodeLog, driven: EpisodeLog) -> None:
    """Raise LogError unless two recordings are equal to the last bit."""
    for name, before in vars(recorded).items():
        after = getattr(driven, name)
        if isinstance(before, np.ndarray):
            if not np.array_equal(before, after):
                step = 0
                if before.shape == after.shape and len(before) == len(recorded):
                    step = int(np.argmax((before != after).reshape(len(before), -1).any(axis=1)))
                raise _another_drive(log, recorded.header, step)
        elif before != after:
            raise _another_drive(log, recorded.header, 0)


def _another_drive(log: DriveLog, header: EpisodeHeader, step: int) -> LogError:
    made = log.header.provenance
    return LogError(
        f"{log.folder}: {header.name} driven again differs (from step {step} on at the latest), so "
        f"its rewards are not known; the log is of commit {made.get('git_commit')} on "
        f"{made.get('machine')}: collect it again here"
    )
