"""What ``bev-agents train`` does: phases of training, and the policy's drives between them."""

from __future__ import annotations

import argparse
import functools
import threading
from collections.abc import Sequence
from pathlib import Path

from bev_driving_env.command_line import UsageError
from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.logs.order import open_logs
from bev_driving_env.training.command import run_in_processes
from bev_driving_env.training.device import usable_device
from bev_driving_env.training.folder import claim_folder, discard_training, holds_training
from bev_driving_env.training.interrupts import noted_interrupts
from bev_driving_env.training.kept_steps import kept_steps
from bev_driving_env.training.processes import first_process_does
from bev_driving_env.training.progress import events_writer

from .batches import SampleSet, rare_action_weights
from .collect import discard
from .dagger import drive_round
from .network import NetworkConfig
from .policy import BetaPolicy
from .train_command import NUMBERS
from .training import Trainer
from .training_config import TrainingConfig
from .training_report import (
    CHECKPOINT,
    METRICS,
    WEIGHTS,
    Report,
    TrainOptions,
)

DAGGER = "dagger"
OWN_FILES = (CHECKPOINT, WEIGHTS, METRICS)


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments or the data are not valid.
    """
    try:
        options = _options(namespace)
        run_in_processes(namespace.threads, lambda chief: _train(options, argv, chief=chief))
    except (ValueError, ImportError) as error:
        raise UsageError(str(error)) from error
    return 0


def _options(namespace: argparse.Namespace) -> TrainOptions:
    names = (*(name for name, _ in NUMBERS), "precision")
    if namespace.tensorboard:
        events_writer()  # is it there?
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
        device=usable_device(namespace.device),
        overwrite=namespace.overwrite,
        tensorboard=namespace.tensorboard,
    )


def _train(options: TrainOptions, argv: Sequence[str], *, chief: bool) -> None:
    depth = max(options.network.channels) + 1
    # the thread that renders training batches has logs of its own
    validation = SampleSet(open_logs(options.data), "val", channels=depth)
    trainer = Trainer(options.training, options.network, options.device)
    checkpoint = options.out / CHECKPOINT
    first_process_does(lambda: _claim(options))
    if checkpoint.exists():
        trainer.restore(checkpoint)
    resumed_at = trainer.step
    report = Report(options, argv, trainer, chief)
    with noted_interrupts() as interrupted, report:
        ends = options.ends()
        for phase, end in enumerate(ends):
            rounds = [_round_folder(options, number) for number in range(phase)]
            if trainer.step < end and not _stopped_early(options, trainer):
                if phase and trainer.step == ends[phase - 1]:
                    # so that a round that is interrupted goes on with the policy that began it
                    report.keep()
                    drive = functools.partial(_drive, options, trainer.policy, phase - 1)
                    first_process_does(drive)
                    # what was best before its own mistakes were seen may not drive well
                    trainer.forget_best()
                logs = open_logs([*options.data, *rounds])
                weigh = rare_action_weights if options.weighting == "kde" else None
                samples = SampleSet(logs, "train", channels=depth, weigh=weigh)
                _phase(options, trainer, report, (samples, validation, end), interrupted)
        if trainer.step > resumed_at:  # or what knows a finished policy by its hash would not again
            report.keep()
    if chief:
        print(
            f"{options.out / WEIGHTS}: validation NLL {trainer.best_value:.3f} after "
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
    steps = trainer.train(samples, end)
    for measured in kept_steps(steps, report.keep, interrupted, options.checkpoint_s):
        report.advance(measured.loss)
        if trainer.step % options.training.validate_every == 0 or trainer.step == last:
            report.validated(measured, trainer.validate(validation))
        if _stopped_early(options, trainer):
            return


def _stopped_early(options: TrainOptions, trainer: Trainer) -> bool:
    """Whether validation has stopped to improve; never before the last DAgger round is driven."""
    rounds_end = options.ends()[-2] if options.dagger else 0
    return trainer.exhausted and trainer.step > rounds_end


def _claim(options: TrainOptions) -> None:
    """Make the output folder this training's own.

    Raises:
        ValueError: The folder holds a policy that learned from something else.
    """
    if options.overwrite and holds_training(options.out):
        for folder in (options.out / DAGGER).glob("round_*"):
            discard(folder)
        discard_training(options.out, OWN_FILES)
    recipe = {
        "data": [str(folder) for folder in options.data],
        "weighting": options.weighting,
        "dagger": options.dagger,
    }
    claim_folder(options.out, recipe, OWN_FILES)


def _round_folder(options: TrainOptions, number: int) -> Path:
    return options.out / DAGGER / f"round_{number:02d}"


def _drive(options: TrainOptions, policy: BetaPolicy, number: int) -> None:
    """One DAgger round with the policy as it is now, on the first log's town."""
    policy.set_training_mode(False)
    base, seed = LogHeader.read(options.data[0]), options.training.seed
    drive_round(_round_folder(options, number), base, policy, number, seed)
