"""``EpisodeLog``: one recorded drive as arrays, and the tables it is stored in.

Two Parquet files an episode, because their rows differ: ``NAME.steps.parquet`` has one row a step,
``NAME.actors.parquet`` one for each actor and step at which it could be seen, sorted by actor. The
file of the steps is written last: an episode that has it is complete.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import LogError
from .header import EpisodeHeader
from .packing import SIGNALS_A_WORD, differences, pack_signals, summed, unpack_signals
from .parquet import CURE, read_columns, read_metadata, write_table

STEPS, ACTORS = ".steps.parquet", ".actors.parquet"
EGO_NAMES = ("x", "y", "heading", "speed", "pitch", "roll", "route_position")
CLEAN_NAMES = ("clean_acceleration", "clean_steering")
APPLIED_NAMES = ("applied_acceleration", "applied_steering")
ORDERS = {"x": 2, "y": 2, "heading": 1, "speed": 1}
"""How often each column of the actors is replaced by its differences: what compresses best."""


@dataclass(frozen=True, eq=False)
class EpisodeLog:
    """One recorded drive; row t is the state in which action t was chosen.

    Attributes:
        header: What it is.
        motion: (T, 7) float64 x, y, heading, speed, pitch, roll, route position.
        clean: (T, 2) float32 what the expert asked for: acceleration, steering.
        applied: (T, 2) float32 what the car was given.
        infractions: (T,) int32 bits of those that began in the step that led to this state.
        signals: (T, S) uint8.
        first: (T + 1,) int64 where each step's part of the next two begins.
        actors: (M,) int32 numbers of actors, vehicles first, ascending within a step.
        rows: (M, 4) int32 their x, y, heading, speed in steps of the grid.
    """

    header: EpisodeHeader
    motion: NDArray[np.float64]
    clean: NDArray[np.float32]
    applied: NDArray[np.float32]
    infractions: NDArray[np.int32]
    signals: NDArray[np.uint8]
    first: NDArray[np.int64]
    actors: NDArray[np.int32]
    rows: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.motion)

    def write(self, folder: Path) -> None:
        """Write both files; the episode is there once the second one is."""
        text = self.header.as_text()
        steps = np.repeat(np.arange(len(self), dtype=np.int32), np.diff(self.first))
        order = np.lexsort((steps, self.actors))
        columns = {"actor": self.actors[order], "step": steps[order]}
        for column, (name, differed) in enumerate(ORDERS.items()):
            columns[name] = differences(self.rows[order, column], differed)
        delta = ("actor", "step")
        write_table(folder / (self.header.name + ACTORS), columns, _mark(self.header), delta)
        words = pack_signals(self.signals)
        names = tuple(f"signals_{k}" for k in range(len(words)))
        table: dict[str, NDArray[Any]] = dict(zip(EGO_NAMES, _columns(self.motion), strict=True))
        table |= dict(zip(CLEAN_NAMES, _columns(self.clean), strict=True))
        table |= dict(zip(APPLIED_NAMES, _columns(self.applied), strict=True))
        table |= {"infractions": self.infractions, **dict(zip(names, words, strict=True))}
        steps_file = folder / (self.header.name + STEPS)
        write_table(steps_file, table, text, (*names, "infractions"))


def read_header(path: Path) -> tuple[EpisodeHeader, int]:
    """Description and number of steps of an episode, given its file of steps.

    Raises:
        LogError: The file is truncated, foreign, or of a newer version.
    """
    text, steps = read_metadata(path)
    return EpisodeHeader.from_text(text, path), steps


def read_actions(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Clean and applied actions (T, 2) of an episode, given its file of steps."""
    found = read_columns(path, dict.fromkeys((*CLEAN_NAMES, *APPLIED_NAMES), np.float32))
    return _stacked(found, CLEAN_NAMES), _stacked(found, APPLIED_NAMES)


def read_episode(path: Path) -> EpisodeLog:
    """All of an episode, given its file of steps.

    Raises:
        LogError: One of its files is missing, truncated or damaged, or they do not belong together.
    """
    header, steps = read_header(path)
    words = [f"signals_{k}" for k in range(-(-header.signals // SIGNALS_A_WORD))]
    kinds: dict[str, Any] = dict.fromkeys(EGO_NAMES, np.float64)
    kinds |= dict.fromkeys((*CLEAN_NAMES, *APPLIED_NAMES), np.float32)
    kinds |= {"infractions": np.int32, **dict.fromkeys(words, np.int64)}
    found = read_columns(path, kinds)
    packed = np.stack([found[name] for name in words]) if words else np.zeros((0, steps), np.int64)
    first, actors, rows = _read_actors(path, header, steps)
    return EpisodeLog(
        header=header,
        motion=_stacked(found, EGO_NAMES),
        clean=_stacked(found, CLEAN_NAMES),
        applied=_stacked(found, APPLIED_NAMES),
        infractions=found["infractions"],
        signals=unpack_signals(packed, header.signals),
        first=first,
        actors=actors,
        rows=rows,
    )


def _read_actors(
    steps_file: Path, header: EpisodeHeader, steps: int
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Where each step begins, and number and row of each actor, sorted by step."""
    path = steps_file.with_name(header.name + ACTORS)
    found = read_columns(path, dict.fromkeys(("actor", "step", *ORDERS), np.int32))
    mark, _ = read_metadata(path)
    actor, step = found["actor"], found["step"]
    count = len(header.vehicle_sizes) + len(header.pedestrian_sizes)
    outside = len(actor) and (actor.min() < 0 or actor.max() >= count or step.max() >= steps)
    if mark != _mark(header) or outside:
        raise LogError(f"{path} does not belong to {steps_file.name}; {CURE}")
    rows = np.stack([summed(found[name], order) for name, order in ORDERS.items()], axis=1)
    # sorted by actor already, so that a stable sort leaves them ascending within each step
    order = np.argsort(step, kind="stable")
    first = np.searchsorted(step[order], np.arange(steps + 1))
    return first, actor[order], rows[order]


def _mark(header: EpisodeHeader) -> str:
    """What the actors' file keeps of the description, to tell that both belong together."""
    return f"{header.name} {header.episode_seed}"


def _columns(table: NDArray[Any]) -> list[NDArray[Any]]:
    return [np.ascontiguousarray(column) for column in table.T]


def _stacked(found: dict[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any]:
    return np.stack([found[name] for name in names], axis=1)
