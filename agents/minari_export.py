"""Drive logs as Minari datasets."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
from tqdm import tqdm

from bev_driving_env import __version__
from bev_driving_env.logs.drive_log import SPLITS, DriveLog
from bev_driving_env.logs.header import EpisodeHeader

from .drive_again import Transitions, drive_again, reset_arguments

FORMATS = ("arrow", "parquet")
DESCRIPTION = (
    "Drives of BEVTown. actions: what the car was given, perturbations included, so they explain "
    "the next observation and the reward. infos['clean_action']: what the privileged expert asked "
    "for in the same state; clone that one. Row t belongs to observation t; the last observation "
    "of an episode has none (NaN). The metadata of an episode has its outcome and infractions."
)


def chosen_episodes(
    log: DriveLog,
    split: str = "all",
    levels: Sequence[float] | None = None,
    limit: int | None = None,
) -> list[int]:
    """Numbers of a log's episodes.

    Args:
        log: The log.
        split: One of ``SPLITS``.
        levels: Perturbation levels; all if None.
        limit: At most so many, the first ones.

    Raises:
        ValueError: No episode is left, or the log has no such level.
    """
    there = sorted({episode.level for episode in log.episodes})
    for level in levels or ():
        if level not in there:
            listed = ", ".join(f"{other:g}" for other in there)
            raise ValueError(f"{log.folder} has no level {level:g}; its levels are: {listed}")
    if limit is not None and limit < 1:
        raise ValueError(f"the limit must be at least 1 episode, got {limit}")
    chosen = [
        number
        for number, episode in enumerate(log.episodes)
        if SPLITS[split](episode.route) and (levels is None or episode.level in levels)
    ]
    if not chosen:
        raise ValueError(f"{log.folder} has no episode of split {split!r} and the levels asked for")
    return chosen[:limit]


def export(
    log: DriveLog,
    dataset_id: str,
    episodes: Sequence[int],
    *,
    overwrite: bool = False,
    data_format: str = "arrow",
    max_steps: int | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Write episodes of a log as a Minari dataset, which appears when it is complete.

    Args:
        log: The log.
        dataset_id: Such as ``"bevtown/town01-v0"``.
        episodes: Their numbers.
        overwrite: Replace a dataset of that name.
        data_format: One of ``FORMATS``.
        max_steps: Cut longer drives into several episodes; Minari holds a whole one in memory.
        provenance: How the dataset came about, for its metadata.

    Returns:
        Folder of the dataset.

    Raises:
        ImportError: Minari is not installed.
        LogError: An episode cannot be read, or driven again exactly.
        ValueError: Not a name of a dataset, or it is taken; or a number is not positive.
    """
    if max_steps is not None and max_steps < 1:
        raise ValueError(f"episodes must be cut at 1 step or more, got {max_steps}")
    minari = _minari("minari")
    root = Path(_minari("minari.storage.datasets_root_dir").get_dataset_path())
    namespace, folder = _free_folder(root, dataset_id, overwrite)
    env = gym.make(f"bev_driving_env:BEV{log.header.town}-v0", **log.header.settings)
    # a hidden folder of the same file system: Minari does not list it, and it can be renamed
    with tempfile.TemporaryDirectory(dir=root, prefix=".bevtown-") as stage:
        made = Path(stage) / "dataset"
        made.mkdir()
        storage = _minari("minari.dataset.minari_storage").MinariStorage.new(
            made / "data",
            observation_space=env.observation_space,
            action_space=env.action_space,
            env_spec=env.spec,
            data_format=data_format,
        )
        for number in tqdm(episodes, unit="episode", desc="exporting"):
            for part in drive_again(env, log, number, max_steps):
                _append(storage, log.episodes[number], part)
                del part  # up to a gigabyte, which would stay while the next one is driven
        storage.update_metadata(
            {
                "dataset_id": dataset_id,
                "minari_version": minari.__version__,
                "algorithm_name": "BEVTown expert, its actions perturbed or replaced",
                "description": DESCRIPTION,
                "requirements": [f"bev-driving-env>={__version__}"],
                "bevtown": {
                    "log": {**asdict(log.header), "levels": list(log.header.levels)},
                    "export": dict(provenance or {}),
                },
            }
        )
        spaces = _minari("minari.namespace")
        if namespace is not None and namespace not in spaces.list_local_namespaces():
            spaces.create_namespace(namespace)
        if folder.exists():
            folder.rename(Path(stage) / "replaced")
        made.rename(folder)
    return folder


def _append(storage: Any, header: EpisodeHeader, part: Transitions) -> None:
    """Write one episode and what is known about it."""
    buffer = _minari("minari.data_collector.episode_buffer").EpisodeBuffer(
        **reset_arguments(header),
        observations={"bev": part.bev, "measurements": part.measurements},
        actions=part.actions,
        rewards=part.rewards,
        terminations=part.terminations,
        truncations=part.truncations,
        infos={"clean_action": part.clean},
    )
    number = storage.total_episodes
    storage.update_episodes([buffer])
    known = ("episode_id", "episode_seed", "collection", "route", "level", "outcome")
    described = {name: getattr(header, name) for name in known}
    described |= {"first_step": part.first_step, "infractions": list(header.infractions)}
    storage.update_episode_metadata([described], [number])


def _free_folder(root: Path, dataset_id: str, overwrite: bool) -> tuple[str | None, Path]:
    """Namespace and folder of a dataset; ValueError unless the name is one and may be taken."""
    parse = _minari("minari.dataset.minari_dataset").parse_dataset_id
    try:
        namespace, _, _ = parse(dataset_id)
    except (TypeError, ValueError) as error:  # the former without a version
        raise ValueError(
            f"{dataset_id!r} is no id of a Minari dataset; it must look like bevtown/town01-v0, "
            "of letters, digits, _ and -, at least two in the namespace, and have a version"
        ) from error
    folder = root / dataset_id
    if folder.exists() and not (folder / "data" / "metadata.json").is_file():
        raise ValueError(f"{folder} exists and is no Minari dataset; choose another id")
    if folder.exists() and not overwrite:
        raise ValueError(
            f"the dataset {dataset_id} exists in {root}; choose another id, or add --overwrite"
        )
    return namespace, folder


def _minari(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            "the export needs Minari: pip install 'bev-driving-env[minari]'"
        ) from error
