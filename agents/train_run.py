"""What ``bev-agents train`` does: phases of training, and the policy's drives between them."""

from __future__ import annotations

import argparse
import json
import math
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import torch
import torch.distributed as dist

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_json
from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.header import LogHeader

from .batches import SampleSet, open_logs
from .collect import discard
from .dagger import drive_round
from .network import NetworkConfig
from .processes import distributed
from .train_command import NUMBERS
from .training import Trainer
from .training_config import TrainingConfig
from .training_report import CHECKPOINT, METRICS, WEIGHTS, Report, TrainOptions
from .weighting import kde_weights

DAGGER = "dagger"
RECIPE = "training.json"


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments or the data are not valid.
    """
    if namespace.threads is not None:
        torch.set_num_threads(max(1, namespace.threads))
    try:
        options = _options(namespace)
        with distributed() as (rank, _):
            _train(options, argv, chief=rank == 0)
    except (ValueError, ImportError) as error:
        raise UsageError(str(error)) from error
    return 0


def _options(namespace: argparse.Namespace) -> TrainOptions:
    names = (*(name for name, _ in NUMBERS), "precision")
    try:
        device = torch.device(namespace.device)
    except RuntimeError as error:
        raise ValueError(f"--device {namespace.device!r} is none of torch's") from error
    return TrainOptions(
        data=tuple(dict.fromkeys(namespace.data)),
        out=namespace.out,
        network=NetworkConfig(
            channels=tuple(CHANNELS.index(name) for name in dict.fromkeys(namespace.channels)),
            measurements=(0, 1, 2) if namespace.commands else (0,),
            # raw, as in the paper: most of a drive is at one speed, and what the others ask for
            # is learned from few samples
            speed_scale_mps=1.0,
        ),
        training=TrainingConfig(**{name: getattr(namespace, name) for name in names}),
        weighting=namespace.weighting,
        dagger=namespace.dagger,
        checkpoint_s=60.0 * namespace.checkpoint_minutes,
        device=device,
        overwrite=namespace.overwrite,
        tensorboard=namespace.tensorboard,
    )


def _train(options: TrainOptions, argv: Sequence[str], *, chief: bool) -> None:
    depth = max(options.network.channels) + 1
    # the thread that renders training batches has logs of its own
    validation = SampleSet(open_logs(options.data), "val", channels=depth)
    trainer = Trainer(options.training, options.network, options.device)
    checkpoint = options.out / CHECKPOINT
    if chief:
        if options.overwrite:
            _discard(options)
        _claim(options)
    _wait(trainer)
    if checkpoint.exists():
        trainer.restore(checkpoint)
    report = Report(options, argv, trainer, chief)
    with _interrupts() as interrupted, report:
        for phase, end in enumerate(options.ends()):
            rounds = [_round_folder(options, number) for number in range(phase)]
            if trainer.step < end and not trainer.exhausted:
                if phase:
                    # so that a round that is interrupted goes on with the policy that began it
                    report.keep()
                    if chief:
                        _drive(options, trainer, phase - 1)
                _wait(trainer)
                logs = open_logs([*options.data, *rounds])
                weigh = kde_weights if options.weighting == "kde" else None
                samples = SampleSet(logs, "train", channels=depth, weigh=weigh)
                _phase(options, trainer, report, (samples, validation, end), interrupted)
        report.keep()
    if chief:
        print(
            f"{options.out / WEIGHTS}: validation NLL {trainer.best_nll:.3f} after "
            f"{trainer.step} steps in {trainer.trained_s / 60:.1f} minutes"
        )


def _phase(
    options: TrainOptions,
    trainer: Trainer,
    report: Report,
    work: tuple[SampleSet, SampleSet, int],
    interrupted: threading.Event,
) -> None:
    """Train on one set of samples up to a step."""
    samples, validation, end = work
    last = options.training.steps
    kept = time.monotonic()
    for measured in trainer.train(samples, end):
        report.step(measured)
        if trainer.step % options.training.validate_every == 0 or trainer.step == last:
            report.validated(measured, trainer.validate(validation))
        if interrupted.is_set():
            report.keep()
            raise KeyboardInterrupt
        if time.monotonic() - kept > options.checkpoint_s:
            report.keep()
            kept = time.monotonic()
        if trainer.exhausted:
            return


def _claim(options: TrainOptions) -> None:
    """Note what is learned from, or find that it is what this folder was made of.

    Raises:
        ValueError: The folder holds a policy that learned from something else.
    """
    path = options.out / RECIPE
    recipe: dict[str, Any] = {
        "data": [str(folder) for folder in options.data],
        "weighting": options.weighting,
        "dagger": options.dagger,
    }
    if not path.exists():
        write_json(path, recipe)
        return
    try:
        kept = dict(json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is not the file of a training: {error}") from error
    for name, value in recipe.items():
        if kept.get(name) != value:
            raise ValueError(
                f"{options.out} holds a training with {name} {kept.get(name)!r}, this one has "
                f"{value!r}: choose another --out, or add --overwrite"
            )


def _discard(options: TrainOptions) -> None:
    """Remove this command's own files from the output folder, and nothing else."""
    for name in (CHECKPOINT, WEIGHTS, METRICS, RECIPE):
        (options.out / name).unlink(missing_ok=True)
    for folder in (options.out / DAGGER).glob("round_*"):
        discard(folder)


def _round_folder(options: TrainOptions, number: int) -> Path:
    return options.out / DAGGER / f"round_{number:02d}"


def _drive(options: TrainOptions, trainer: Trainer, number: int) -> None:
    """One DAgger round with the policy as it is now, on the first log's town."""
    policy = trainer.policy
    policy.set_training_mode(False)
    base, seed = LogHeader.read(options.data[0]), options.training.seed
    drive_round(_round_folder(options, number), base, policy, number, seed)
    # what was best before its own mistakes were seen may not drive well
    trainer.best_nll = math.inf


def _wait(trainer: Trainer) -> None:
    """Let all processes come to this point."""
    if trainer.ranks > 1:
        dist.barrier()


@contextmanager
def _interrupts() -> Iterator[threading.Event]:
    """Turn Ctrl-C and a polite kill into a flag: a step is finished before training stops."""
    flag = threading.Event()

    def note(_: int, __: FrameType | None) -> None:
        if flag.is_set():  # the second time at once, such as in a long DAgger round
            raise KeyboardInterrupt
        flag.set()

    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield flag
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
