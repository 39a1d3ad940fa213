"""Measuring drive logs: steps a second to collect, bytes a sample, samples a second to read."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from tqdm import tqdm

from agents.collect import claim_folder, collect, jobs_of, log_settings
from bev_driving_env.logs.drive_log import DriveLog, log_bytes
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.settings import EnvSettings

from .speed_figure import Figure

PAPER_SAMPLES = 201_980
BUDGET_MB = 50.0
LONG_LOG = 20_000
"""Samples of a log that tells how large the paper's would be."""
CHUNK = 100
"""Samples rendered between two looks at the clock."""


@dataclass(frozen=True)
class LogSpeed:
    """What was measured of one log.

    Attributes:
        samples: Its length.
        bytes_per_sample: Size on disk, everything included.
        collected_per_s: Steps a second while it was collected, in one process.
        bev_per_s: Median samples a second in random order, BEV and measurements.
        cameras_per_s: The same with four cameras, 112 x 240.
    """

    samples: int
    bytes_per_sample: float
    collected_per_s: float
    bev_per_s: float
    cameras_per_s: float


def measure_log(
    town: str, traffic: str, *, samples: int, rounds: int, seconds: float, seed: int
) -> LogSpeed:
    """Collect a log of at least so many samples, and read it.

    Episodes are of perturbation level 0 and 1 in turn.

    Args:
        town: Name of the town.
        traffic: Preset; with any, the signals work.
        samples: Least number of samples.
        rounds: How often reading is timed.
        seconds: Roughly how long each timing takes.
        seed: Seed of the log and of the order of samples.
    """
    settings = EnvSettings(traffic=traffic, traffic_lights=traffic != "none")
    header = LogHeader(town, log_settings(town, settings), 10, 20, seed, (0.0, 1.0) * 50)
    with tempfile.TemporaryDirectory() as folder:
        claim_folder(Path(folder), header)
        jobs = jobs_of(header)
        taken_s, steps = 0.0, 0
        for number, job in enumerate(jobs):
            start = time.perf_counter()
            ((_, driven),) = collect(Path(folder), header, [job], 1)
            # the first one also compiles and builds the town
            if number > 0:
                taken_s += time.perf_counter() - start
                steps += driven
            if steps >= samples:
                break
        log = DriveLog(folder)
        rates: dict[str, list[float]] = {"bev": [], "cameras": []}
        renders: dict[str, Callable[[int], object]] = {
            "bev": lambda index: (log.bev(index), log.measurements(index)),
            "cameras": log.images,
        }
        order = np.random.default_rng(seed).permutation(len(log)).tolist()
        # every episode is in memory and every look is drawn before the clock starts
        for begin in log.starts[:-1].tolist():
            for render in renders.values():
                render(begin)
        for _ in tqdm(range(rounds), unit="round", desc=f"reading {town}"):
            for name, render in renders.items():
                rates[name].append(_rate(render, order, seconds))
        return LogSpeed(
            samples=len(log),
            bytes_per_sample=log_bytes(Path(folder)) / len(log),
            collected_per_s=steps / taken_s,
            bev_per_s=median(rates["bev"]),
            cameras_per_s=median(rates["cameras"]),
        )


def _rate(render: Callable[[int], object], order: list[int], seconds: float) -> float:
    """Samples a second, in the order given, over and over."""
    start, done = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        for k in range(CHUNK):
            render(order[(done + k) % len(order)])
        done += CHUNK
    return done / (time.perf_counter() - start)


def log_length(seconds: float) -> int:
    """How many samples to collect where each timing takes so long: for a quick look fewer.

    >>> log_length(0.5), log_length(0.05)
    (20000, 2000)
    """
    return max(1, min(LONG_LOG, round(LONG_LOG * seconds / 0.5)))


def figures(rounds: int, seconds: float, seed: int = 0, samples: int | None = None) -> list[Figure]:
    """Drive logs of both towns with dense traffic, on one core.

    Args:
        rounds: How often reading is timed.
        seconds: Roughly how long each timing takes.
        seed: Seed of the logs and of the order of samples.
        samples: Least number of samples of each log; None for what suits ``seconds``.
    """
    samples = log_length(seconds) if samples is None else samples
    measured = []
    for town in ("Town01", "Town02"):
        speed = measure_log(
            town, "dense", samples=samples, rounds=rounds, seconds=seconds, seed=seed
        )
        megabytes = speed.bytes_per_sample * PAPER_SAMPLES / 1e6
        what = f"drive log, {town}, dense traffic"
        measured += [
            Figure(f"{what}, collecting", speed.collected_per_s, "steps/s"),
            Figure(
                f"{what}, the paper's {PAPER_SAMPLES:,} points",
                megabytes,
                "MB",
                # a short log says little about one ten times as long
                f"at most {BUDGET_MB:g}" if speed.samples >= LONG_LOG else "",
                megabytes <= BUDGET_MB,
            ),
            Figure(
                f"{what}, BEV and measurements",
                speed.bev_per_s,
                "samples/s",
                "at least 3,000",
                speed.bev_per_s >= 3000.0,
            ),
            Figure(
                f"{what}, four cameras at 112 x 240",
                speed.cameras_per_s,
                "samples/s",
                "at least 300",
                speed.cameras_per_s >= 300.0,
            ),
        ]
    return measured
