"""``bev-perception evaluate``: how well predictors see, on frames of drive logs."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tqdm import tqdm

from bev_driving_env.cameras.look import APPEARANCES
from bev_driving_env.checks import is_int, require_count
from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_bytes, write_json, write_text
from bev_driving_env.logs.drive_log import SPLITS, DriveLog
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import HEADER_FILE
from bev_driving_env.provenance import file_hash, provenance
from bev_driving_env.sources.protocol import BEVSourceError
from bev_driving_env.sources.registry import make_bev_source, source_file

from .evaluation import Evaluation, evaluate, worker_pool
from .evaluation_frames import AS_RECORDED, CHANGES, spread_keys
from .evaluation_tables import NOTE, as_csv, frame_figures, rows, tables, turn_figures
from .mosaics import mosaic_of, picks, png


def add_parser(verbs: Any) -> None:
    """Add the verb ``evaluate``."""
    parser = verbs.add_parser(
        "evaluate",
        help="measure how well predictors see",
        description="Measure the IoU of predictors on frames of drive logs, rendered anew: by "
        "channel, on straights and at critical places, by distance, and of the route in turns. "
        "Prints a table a log, and writes evaluation.md, .csv and .json.",
    )
    add = parser.add_argument
    add(
        "--bev",
        nargs="+",
        required=True,
        metavar="NAME",
        help="predictors: names, checkpoints or module:factory; ipm and blind are good to "
        "compare with",
    )
    add("--data", nargs="+", type=Path, required=True, metavar="FOLDER", help="drive logs")
    add("--split", choices=tuple(SPLITS), default="all", help="val: route 0; default: all")
    add("--samples", type=int, default=500, metavar="N", help="frames a log; default: 500")
    add(
        "--appearance",
        choices=(*APPEARANCES, AS_RECORDED),
        default="test",
        help="looks to draw each frame's from; 'log': as recorded; default: test",
    )
    add(
        "--leaks",
        action="store_true",
        help="also with black cameras, cameras of another place, and likewise the route map: what "
        "does a predictor really use?",
    )
    add(
        "--pictures",
        type=int,
        default=0,
        metavar="N",
        help="also draw the N critical frames where the route is worst, and N in the middle",
    )
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores")
    add("--seed", type=int, default=0, help="decides the looks; default: 0")
    add("--out", type=Path, default=Path("runs/eval"), help="default: runs/eval")
    parser.set_defaults(command=run, interrupted="")


@dataclass(frozen=True)
class EvaluateOptions:
    """Options of ``bev-perception evaluate``; see its ``--help``.

    Raises:
        ValueError: One is out of range.
    """

    bev: tuple[str, ...]
    data: tuple[Path, ...]
    split: str
    samples: int
    appearance: str
    leaks: bool
    pictures: int
    workers: int
    seed: int
    out: Path

    def __post_init__(self) -> None:
        require_count("--samples", self.samples)
        require_count("--workers", self.workers)
        for name in ("pictures", "seed"):
            value = getattr(self, name)
            if not (is_int(value) and value >= 0):
                raise ValueError(f"--{name} must be at least 0, got {value}")


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        LogError: A log cannot be read.
        UsageError: The arguments are not valid, or a predictor fails.
    """
    values = {item.name: getattr(namespace, item.name) for item in fields(EvaluateOptions)}
    for name in ("bev", "data"):
        values[name] = tuple(dict.fromkeys(values[name]))
    try:
        _run(EvaluateOptions(**values), argv)
    except LogError:
        raise
    except (BEVSourceError, ValueError) as error:
        raise UsageError(str(error)) from error
    return 0


def _run(options: EvaluateOptions, argv: Sequence[str]) -> None:

    logs = [DriveLog(folder) for folder in options.data]
    sources = {name: make_bev_source(name) for name in options.bev}
    for log in logs:  # mistakes are told before hours of work
        spread_keys([log], options.split, options.samples)
    note = _note(options, argv)
    with worker_pool(options.workers) as pool:
        found = [_evaluated(options, log, pool) for log in logs]
    texts, table, results = [f"# BEV predictors\n\n{_about(options)} {NOTE}"], [], []
    for log, evaluations in zip(logs, found, strict=True):
        about = {"log": str(log.folder), "town": log.header.town, "split": options.split}
        texts.append(f"## {log.folder} ({log.header.town})\n\n{tables(evaluations)}")
        for each in evaluations:
            figures = rows(each, about)
            table += figures
            place = {key: figures[0][key] for key in (*about, "appearance", "source", "change")}
            results.append({**place, "turns": turn_figures(each), "frames": frame_figures(each)})
    text = "\n\n".join(texts)
    write_text(options.out / "evaluation.md", f"{text}\n")
    write_text(options.out / "evaluation.csv", as_csv(table))
    write_json(
        options.out / "evaluation.json", {"provenance": note, "results": results, "iou": table}
    )
    print(text)
    for log, evaluations in zip(logs, found, strict=True):
        for name, content in _pictures(options, log, evaluations, sources).items():
            write_bytes(options.out / "pictures" / name, content)
    print(f"\nwritten to {options.out}")


def _evaluated(options: EvaluateOptions, log: DriveLog, pool: Executor | None) -> list[Evaluation]:
    """Evaluations of all predictors on one log."""
    changes = list(CHANGES) if options.leaks else ["none"]
    frames = min(options.samples, len(log.indices(options.split)))
    total = frames * len(options.bev) * len(changes)
    found = []
    with tqdm(total=total, unit="frame", desc=log.folder.name) as bar:
        for name in options.bev:
            for change in changes:
                bar.set_postfix(bev=Path(name).name, change=change)
                found.append(
                    evaluate(
                        name,
                        [log],
                        options.split,
                        samples=options.samples,
                        appearance=options.appearance,
                        change=change,
                        seed=options.seed,
                        pool=pool,
                        progress=bar.update,
                    )
                )
    return found


def _about(options: EvaluateOptions) -> str:
    looks = options.appearance
    looks = "as recorded" if looks == AS_RECORDED else f"drawn from {looks!r}"
    return f"Split {options.split!r}, looks {looks}, seed {options.seed}."


def _note(options: EvaluateOptions, argv: Sequence[str]) -> dict[str, Any]:
    """Where the figures came from."""
    files = {name: source_file(name) for name in options.bev}
    files |= {str(folder): folder / HEADER_FILE for folder in options.data}
    hashes = {name: file_hash(path) for name, path in files.items() if path is not None}
    note = provenance(argv, [options.seed], hashes)
    note["command"] = shlex.join(["bev-perception", *argv])
    if "torch" in sys.modules:
        note["versions"]["torch"] = importlib.metadata.version("torch")
    return note


def _pictures(
    options: EvaluateOptions,
    log: DriveLog,
    evaluations: Sequence[Evaluation],
    sources: Mapping[str, Any],
) -> dict[str, bytes]:
    """Contents of the pictures of one log, by name."""
    made = {}
    for each in evaluations:
        if each.view.change != "none" or "route" not in each.channels:
            continue
        stem = re.sub(r"[^\w.-]+", "_", f"{log.folder}_{each.source}").strip("_.")
        for pick in picks(each, options.pictures):
            image = mosaic_of(each, pick.number, sources[each.source], [log])
            made[f"{stem}_{pick.name}.png"] = png(image)
    return made
