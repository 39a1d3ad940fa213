"""Collecting drive logs: the expert drives a town's routes while its actions are perturbed."""

from __future__ import annotations

import dataclasses
import functools
import json
import multiprocessing
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.kernels.layout import BLOCKED, DISTANCE
from bev_driving_env.logs.drive_log import EPISODES
from bev_driving_env.logs.episode import STEPS, EpisodeLog, read_header
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import HEADER_FILE, EpisodeHeader, LogHeader, episode_name
from bev_driving_env.logs.recorder import EpisodeRecorder
from bev_driving_env.settings import EnvSettings
from bev_driving_env.towns.registry import compiled_town, route_book
from bev_driving_env.workers import become_worker
from bev_driving_env.world.core import World

from .expert import Expert
from .perturbation import Perturbation

LOST_M = 8.0
"""Farther than this from the route, an episode is given up."""


@dataclasses.dataclass(frozen=True)
class EpisodeJob:
    """One episode to drive.

    Attributes:
        collection: Number of the collection.
        route: Number of the route in the town's book.
        level: Perturbation level.
        collection_seed: Decides all that is random in the collection.
    """

    collection: int
    route: int
    level: float
    collection_seed: int

    @property
    def name(self) -> str:
        """What its files are called."""
        return episode_name(self.collection, self.route)

    @property
    def seeds(self) -> tuple[int, int]:
        """Seeds of the environment's reset and of the perturbation."""
        drawn = np.random.SeedSequence([self.collection_seed, self.route]).generate_state(2)
        return int(drawn[0]), int(drawn[1])

    def recorder(self, world: World) -> EpisodeRecorder:
        """A recorder of the episode, which must have been reset to its start."""
        return EpisodeRecorder(
            world,
            collection=self.collection,
            collection_seed=self.collection_seed,
            route=self.route,
            level=self.level,
        )


def perturbation_levels(collections: int) -> tuple[float, ...]:
    """Levels of so many collections, evenly from 0 (none) to 1.

    >>> perturbation_levels(5)
    (0.0, 0.25, 0.5, 0.75, 1.0)
    """
    return tuple(np.linspace(0.0, 1.0, collections).tolist())


def log_settings(town: str, settings: EnvSettings) -> dict[str, Any]:
    """The keywords of an environment that a log keeps, with all names turned into numbers."""
    config = settings.world_config(compiled_town(town))
    return {
        "traffic": {
            "vehicles": config.traffic.vehicles,
            "pedestrians": config.traffic.pedestrians,
        },
        "traffic_lights": config.traffic.lights,
        "appearance": settings.appearance,
        "camera_motion": settings.camera_motion,
        "max_speed_mps": config.cruise_speed_mps,
        "time_limit_s": config.time_limit_s,
        "vehicle": dataclasses.asdict(config.vehicle),
        "rules": dataclasses.asdict(config.rules),
        # a driver learns to recover from what would have ended the episode
        "terminate_on": [],
    }


def log_header(
    town: str,
    settings: EnvSettings,
    levels: Sequence[float],
    seed: int,
    note: Mapping[str, Any] | None = None,
) -> LogHeader:
    """Describe a log to be collected; also compiles, so that it fails here and not in a worker.

    Args:
        town: Town.
        settings: Of the environment that is driven in.
        levels: Perturbation level of each collection.
        seed: Seed.
        note: Where it comes from.

    Raises:
        ValueError: The environment cannot be made.
    """
    kept = log_settings(town, settings)
    config = BEVTownEnv(town, **kept).world.config
    return LogHeader(
        town=town,
        settings=kept,
        control_hz=config.control_hz,
        physics_hz=config.physics_hz,
        seed=seed,
        levels=tuple(levels),
        provenance=dict(note or {}),
    )


def jobs_of(header: LogHeader, routes: Sequence[int] | None = None) -> list[EpisodeJob]:
    """All episodes of a log, one a collection and route.

    Args:
        header: The log.
        routes: Numbers of the routes; all of the town's book if None.

    Raises:
        ValueError: The town has no such route.
    """
    count = route_book(header.town).size("route")
    if count == 0:
        raise ValueError(f"town {header.town!r} has no 'route' routes to collect on")
    chosen = range(count) if routes is None else routes
    for route in chosen:
        if not 0 <= route < count:
            raise ValueError(f"town {header.town!r} has routes 0 to {count - 1}, got {route}")
    jobs = []
    for collection, level in enumerate(header.levels):
        seed = header.collection_seed(collection)
        jobs += [EpisodeJob(collection, route, level, seed) for route in chosen]
    return jobs


def outcome_of(world: World) -> str:
    """How the first world's episode has ended, or "" if it goes on; see ``EpisodeHeader``."""
    if world.success[0]:
        return "success"
    if world.state.progress[0, DISTANCE] > LOST_M:
        return "lost"
    if world.state.holding[0] & BLOCKED:
        return "blocked"
    return "time_limit" if world.truncated()[0] else ""


def drive_episode(env: BEVTownEnv, job: EpisodeJob) -> EpisodeLog:
    """Drive one episode, perturbed, and take it down; nothing is rendered on the way."""
    reset_seed, perturbation_seed = job.seeds
    env.reset(seed=reset_seed, options={"route": job.route})
    expert, world = Expert(env), env.world
    recorder = job.recorder(world)
    step_s = world.config.step_s
    until_s = float(world.state.time_limit[0]) * step_s
    perturbation = Perturbation(job.level, perturbation_seed, until_s)
    outcome = ""
    while not outcome:
        clean = expert.act()
        applied = perturbation.applied(clean, len(recorder) * step_s)
        recorder.record(clean, applied)
        world.step(applied.astype(np.float64)[None])
        outcome = outcome_of(world)
    return recorder.finish(outcome)


def claim_folder(folder: Path, header: LogHeader) -> None:
    """Make a folder this log's own, or find that it already is.

    Raises:
        LogError: It holds something else.
    """
    if not (folder / HEADER_FILE).exists():
        if (folder / EPISODES).exists():
            raise LogError(f"{folder} holds episodes but no {HEADER_FILE}: choose another --out")
        header.write(folder)
        return
    kept = LogHeader.read(folder)
    mine, theirs = _identity(header), _identity(kept)
    for name, value in mine.items():
        if theirs[name] != value:
            raise LogError(
                f"{folder} holds a log with {name} {theirs[name]!r}, this one has {value!r}: "
                "choose another --out, or add --overwrite"
            )


def _identity(header: LogHeader) -> dict[str, Any]:
    """What makes two logs the same, so that one may go on with the other."""
    names = ("town", "control_hz", "physics_hz", "seed", "levels")
    commit = header.provenance.get("git_commit")
    return {name: getattr(header, name) for name in names} | {
        **header.settings,
        "git_commit": commit,
    }


def discard(folder: Path) -> None:
    """Remove a log's own files from a folder, and nothing else."""
    if (folder / HEADER_FILE).exists():
        LogHeader.read(folder)  # a foreign log.json is not ours to remove
        shutil.rmtree(folder / EPISODES, ignore_errors=True)
        (folder / HEADER_FILE).unlink()


def collect(
    folder: Path, header: LogHeader, jobs: Sequence[EpisodeJob], workers: int
) -> list[tuple[EpisodeHeader, int]]:
    """Drive all episodes that are not there yet, and keep each as soon as it has ended.

    Args:
        folder: The log, claimed.
        header: What all episodes have in common.
        jobs: What to drive.
        workers: Processes; with 1 the episodes are driven in this one.

    Returns:
        Description and number of steps of each episode, in the order of the jobs.
    """
    paths = {job: folder / EPISODES / f"{job.name}{STEPS}" for job in jobs}
    missing = [job for job, path in paths.items() if not path.exists()]
    total = len(paths)
    with tqdm(total=total, initial=total - len(missing), unit="episode", desc="collecting") as bar:
        for steps in _collect_all(folder, header, missing, workers):
            bar.update()
            bar.set_postfix(steps=steps)
    return [read_header(path) for path in paths.values()]


def _collect_all(
    folder: Path, header: LogHeader, jobs: Sequence[EpisodeJob], workers: int
) -> Iterator[int]:
    settings, episodes = json.dumps(dict(header.settings)), folder / EPISODES
    if workers == 1 or len(jobs) <= 1:
        for job in jobs:
            yield _drive_and_keep(header.town, settings, job, episodes)
        return
    # spawned, not forked: the parent may hold threads (progress bar, numerical libraries)
    context = multiprocessing.get_context("spawn")
    size = min(workers, len(jobs))
    with ProcessPoolExecutor(size, mp_context=context, initializer=become_worker) as pool:
        futures = [
            pool.submit(_drive_and_keep, header.town, settings, job, episodes) for job in jobs
        ]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            # episodes under way are finished and kept, the others are left for the next time
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _drive_and_keep(town: str, settings: str, job: EpisodeJob, episodes: Path) -> int:
    """Drive one episode and write it; returns its number of steps."""
    log = drive_episode(_env(town, settings), job)
    log.write(episodes)
    return len(log)


@functools.lru_cache(maxsize=1)
def _env(town: str, settings: str) -> BEVTownEnv:
    """The environment of this process, which episode after episode is driven in."""
    return BEVTownEnv(town, **json.loads(settings))
