"""``bev-bench study``: which metric of perception foretells driving?"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bev_driving_env.checks import require_count
from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_bytes, write_text
from bev_driving_env.logs.errors import LogError
from bev_driving_env.sources.expressions import TRUTH
from bev_driving_env.sources.protocol import BEVSourceError

from .drive import EpisodeResult
from .run_folder import footnote, open_run, used_hashes
from .runner import run_jobs
from .study.driving import study_routes, summed_up, variant_jobs
from .study.figure import draw
from .study.findings import Row, findings
from .study.frames import LOGS, Frames, collect_logs
from .study.metrics import online_metrics, open_loop_metrics
from .study.open_loop import measure_all
from .study.text import as_csv, as_markdown
from .study.variants import Variant, check_variant, chosen_variants
from .suite_options import add_folder_arguments, checked_specs, distinct, require_seed
from .suites import SUITES, Job

TOWNS = ("Town01", "Town02")
OPEN_LOOP_FOLDER = "open_loop"


@dataclass(frozen=True)
class StudyOptions:
    """Options of ``bev-bench study``; see its ``--help``.

    Raises:
        ValueError: A value is out of range.
    """

    agent: str
    variants: tuple[str, ...]
    checkpoints: tuple[str, ...]
    routes: int
    samples: int
    seed: int
    workers: int
    out: Path
    overwrite: bool

    def __post_init__(self) -> None:
        for name in ("routes", "samples", "workers"):
            require_count(f"--{name}", getattr(self, name))
        require_seed(self.seed)


def add_parser(verbs: Any) -> None:
    """Add the verb ``study``."""
    parser = verbs.add_parser(
        "study",
        help="find out which metric of perception foretells driving",
        description="Measure many variants of perception (true BEVs with errors, predictors, both "
        "mixed by channel) on fixed frames, let a policy drive on each, and correlate every metric "
        "with the driving. Writes study.csv, study.md and study.png; resumes.",
        epilog="The default, 115 variants on 20 routes without traffic, takes two "
        "hours on two cores; time is in proportion to variants and routes.",
    )
    add = parser.add_argument
    add("--agent", default="bc", metavar="AGENT", help="who drives; default: bc")
    add(
        "--variants",
        nargs="+",
        default=[],
        metavar="PATTERN",
        help="those of the default variants that match, such as 'cvt_kde' or "
        "'ground_truth~shift=*'; default: all",
    )
    add(
        "--checkpoints",
        nargs="+",
        default=[],
        metavar="FILE",
        help="predictors to add, such as checkpoints along a training",
    )
    add("--routes", type=int, default=20, metavar="N", help="of both towns together; default: 20")
    add(
        "--samples",
        type=int,
        default=300,
        metavar="N",
        help="frames of each town for open-loop metrics; default: 300",
    )
    add("--seed", type=int, default=0, metavar="N", help="default: 0")
    add_folder_arguments(parser)
    parser.set_defaults(
        command=run,
        interrupted="; what is done is kept, the same command resumes (without --overwrite)",
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb; returns 1 if a drive failed, else 0.

    Raises:
        UsageError: The arguments are not valid (nothing has been written then), or a variant
            fails.
    """
    try:
        options, variants = _checked(namespace)
        routes = study_routes(TOWNS, options.routes)
    except ValueError as error:
        raise UsageError(str(error)) from error
    hashes = used_hashes([options.agent], [variant.spec for variant in variants])
    identity = _identity(options, variants)
    note = open_run(
        options.out, argv, identity, hashes, [options.seed], overwrite=options.overwrite
    )
    try:
        metrics = _open_loop(options, variants, note)
    except (BEVSourceError, LogError) as error:
        raise UsageError(str(error)) from error
    jobs = {
        variant: variant_jobs(variant, options.agent, routes, options.seed) for variant in variants
    }
    every = [job for mine in jobs.values() for job in mine]
    driven = run_jobs(every, options.out, options.workers, moments=True)
    results = dict(zip(every, driven, strict=True))
    rows = [_row(variant, metrics[variant], jobs[variant], results) for variant in variants]
    return _report(options, rows, note)


def _checked(namespace: argparse.Namespace) -> tuple[StudyOptions, list[Variant]]:
    options = StudyOptions(
        agent=namespace.agent,
        variants=distinct(namespace.variants),
        checkpoints=distinct(namespace.checkpoints),
        routes=namespace.routes,
        samples=namespace.samples,
        seed=namespace.seed,
        workers=namespace.workers,
        out=namespace.out,
        overwrite=namespace.overwrite,
    )
    variants = chosen_variants(options.variants, options.checkpoints)
    if len(variants) < 3:
        raise ValueError(f"a correlation needs at least 3 variants, got {len(variants)}")
    # also compiles, before workers start
    checked_specs([TRUTH], [options.agent], TOWNS[0], SUITES["routes"])
    for variant in variants:
        check_variant(variant)
    return options, variants


def _identity(options: StudyOptions, variants: Sequence[Variant]) -> dict[str, Any]:
    """The options that make two studies the same."""
    chosen = {name: getattr(options, name) for name in ("agent", "routes", "samples", "seed")}
    return {"verb": "study", **chosen, "variants": [asdict(variant) for variant in variants]}


def _open_loop(
    options: StudyOptions, variants: Sequence[Variant], note: dict[str, Any]
) -> dict[Variant, dict[str, float]]:
    """Open-loop metrics of each variant."""
    folders = collect_logs(options.out / LOGS, TOWNS, options.seed, options.workers, note=note)
    # workers may not share this process's folder
    frames = Frames(tuple(path.resolve() for path in folders), options.samples, options.seed)
    folder = options.out / OPEN_LOOP_FOLDER
    measured = measure_all(variants, options.agent, frames, folder, options.workers)
    return {
        variant: open_loop_metrics(found) for variant, found in zip(variants, measured, strict=True)
    }


def _row(
    variant: Variant,
    open_loop: dict[str, float],
    jobs: Sequence[Job],
    results: dict[Job, EpisodeResult],
) -> Row:
    drives = [results[job] for job in jobs]
    online = online_metrics(variant.spec, [drive.online for drive in drives])
    return Row(variant, summed_up(drives), {**open_loop, **online})


def _report(options: StudyOptions, rows: Sequence[Row], note: dict[str, Any]) -> int:
    write_text(options.out / "study.csv", as_csv(rows, note))
    failed = sum(row.driving.failed for row in rows)
    if failed:
        print(f"{failed} drives failed; tracebacks are in {options.out / 'episodes'}")
    try:
        found = findings(rows, options.seed)
    except ValueError as error:  # the table is written: it says why
        raise UsageError(str(error)) from error
    text = as_markdown(found, options.agent, footnote(note))
    write_text(options.out / "study.md", text)
    write_bytes(options.out / "study.png", draw(found, note))
    print(text)
    print(f"results in {options.out}: study.csv, study.md, study.png")
    return 1 if failed else 0
