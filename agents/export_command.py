"""``bev-agents export``: a drive log in a format that others read."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bev_driving_env.command_line import UsageError
from bev_driving_env.logs.drive_log import SPLITS, DriveLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.provenance import provenance

from .minari_export import FORMATS, chosen_episodes, export


def add_parser(verbs: Any) -> None:
    """Add the verb ``export``."""
    parser = verbs.add_parser(
        "export",
        help="write a drive log as a Minari dataset",
        description="Drive the episodes of a log again, which also gives their rewards, and write "
        "them as a Minari dataset: actions are what the car was given, infos['clean_action'] is "
        "what the expert asked for. The dataset appears when it is complete.",
    )
    parser.add_argument("folder", type=Path, help="folder of the log")
    parser.add_argument(
        "--minari",
        required=True,
        metavar="DATASET_ID",
        help="such as bevtown/town01-v0; goes where MINARI_DATASETS_PATH says",
    )
    parser.add_argument("--split", choices=SPLITS, default="all", help="default: all")
    parser.add_argument(
        "--levels", nargs="+", type=float, metavar="LEVEL", help="perturbation levels; default: all"
    )
    parser.add_argument("--limit", type=int, metavar="N", help="the first N drives; default: all")
    parser.add_argument(
        "--max-steps",
        type=int,
        metavar="N",
        help="cut longer drives into several episodes: Minari holds a whole one in memory, and "
        "writing 1,000 steps takes 1 GB (parquet 4 GB); default: do not cut",
    )
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default="arrow",
        help="arrow: 222 kB a step, fast; parquet: about 1 kB a step, slow; default: arrow",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a dataset of the same id")
    parser.set_defaults(command=run, interrupted="; no dataset was written")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid, or Minari is not installed.
        LogError: The log cannot be read, or not driven again exactly.
    """
    log = DriveLog(namespace.folder, cached_episodes=1)
    note = provenance(argv, [log.header.seed])
    note["command"] = shlex.join(["bev-agents", *argv])
    try:
        episodes = chosen_episodes(log, namespace.split, namespace.levels, namespace.limit)
        folder = export(
            log,
            namespace.minari,
            episodes,
            overwrite=namespace.overwrite,
            data_format=namespace.format,
            max_steps=namespace.max_steps,
            provenance=note,
        )
    except LogError:
        raise
    except (ImportError, ValueError) as error:
        raise UsageError(str(error)) from error
    steps = int(np.diff(log.starts)[episodes].sum())
    print(f"{len(episodes)} drives, {steps:,} steps in {folder}")
    print(f"read them with: minari.load_dataset({namespace.minari!r})")
    return 0
