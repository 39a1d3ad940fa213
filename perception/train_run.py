"""What ``bev-perception train`` does."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

from bev_driving_env.cameras.rig import CameraRig
from bev_driving_env.command_line import UsageError
from bev_driving_env.logs.order import open_logs
from bev_driving_env.training.command import run_in_processes
from bev_driving_env.training.device import usable_device
from bev_driving_env.training.folder import claim_folder, discard_training
from bev_driving_env.training.interrupts import noted_interrupts
from bev_driving_env.training.kept_steps import kept_steps
from bev_driving_env.training.processes import first_process_does
from bev_driving_env.training.progress import events_writer

from .models.presets import model_spec
from .sample_weights import effective_sizes, sample_weights
from .samples import BEVSamples
from .starting import start_from
from .train_command import CHOICES, NUMBERS
from .training import Trainer
from .training_config import TrainingConfig
from .training_report import CHECKPOINT, METRICS, WEIGHTS, Report, TrainOptions

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
        raise UsageError(_told(error)) from error
    return 0


def _told(error: Exception) -> str:
    """What an error says; of one in a worker process, without the report around it."""
    text = str(error)
    if "in DataLoader worker process" not in text:
        return text
    return text.strip().rpartition("\n")[2].partition(": ")[2]


def _options(namespace: argparse.Namespace) -> TrainOptions:
    names = [name for name, *_ in (*NUMBERS, *CHOICES)]
    if namespace.tensorboard:
        events_writer()  # is it there?
    spec = model_spec(namespace.preset).changed(**dict(namespace.set))
    if namespace.channels is not None:
        spec = spec.with_channels(tuple(dict.fromkeys(namespace.channels)))
    return TrainOptions(
        preset=namespace.preset,
        data=tuple(dict.fromkeys(namespace.data)),
        out=namespace.out,
        start=namespace.start,
        spec=spec,
        training=TrainingConfig(
            **{name: getattr(namespace, name) for name in names}, flips=not namespace.no_flips
        ),
        workers=namespace.workers,
        until=namespace.until,
        checkpoint_s=60.0 * namespace.checkpoint_minutes,
        device=usable_device(namespace.device),
        overwrite=namespace.overwrite,
        tensorboard=namespace.tensorboard,
    )


def _train(options: TrainOptions, argv: Sequence[str], *, chief: bool) -> None:
    config, spec = options.training, options.spec
    start = None if options.start is None else start_from(options.start, spec)
    trainer = Trainer(config, spec, options.device, start)
    logs, rig = open_logs(options.data), CameraRig(size=spec.camera_size)
    needs = trainer.module.needs
    samples = BEVSamples(logs, "train", needs, looks=config.looks, rig=rig)  # type: ignore[arg-type]
    validation = BEVSamples(logs, "val", needs, rig=rig)  # type: ignore[arg-type]
    checkpoint = options.out / CHECKPOINT
    first_process_does(lambda: _claim(options))
    if checkpoint.exists():
        trainer.restore(checkpoint)
    last = options.until or config.steps
    done = trainer.step >= last or trainer.exhausted
    weights = sample_weights(samples, config, spec.config.channels, shown=chief)
    effective = effective_sizes(weights, spec.config.channels)
    if chief and effective is not None and not done:
        print(_effective_line(config.weighting, len(samples), effective))
    origin = None if start is None else {"sha256": start.digest, **start.card}
    report = Report(options, argv, trainer, chief, len(samples), effective, origin)
    with noted_interrupts() as interrupted, report:
        steps = () if done else trainer.train(samples, weights, until=last, workers=options.workers)
        for measured in kept_steps(steps, report.keep, interrupted, options.checkpoint_s):
            report.advance(measured.loss)
            if trainer.step % config.validate_every == 0 or trainer.step == config.steps:
                report.validated(measured, trainer.validate(validation))
            if trainer.exhausted:
                break
        if not done:  # or others that started from this predictor would not know it again
            report.keep()
    if chief:
        print(report.summary())


def _effective_line(weighting: str, count: int, effective: Mapping[str, float]) -> str:
    """What weights leave of the samples."""
    sizes = set(effective.values())
    text = (
        f"{sizes.pop():,.0f}"
        if len(sizes) == 1
        else ", ".join(f"{name} {size:,.0f}" for name, size in effective.items())
    )
    return f"weighting {weighting}: effective sample size {text} of {count:,} samples"


def _claim(options: TrainOptions) -> None:
    """Make the output folder this training's own.

    Raises:
        ValueError: The folder holds a predictor that learned from something else.
    """
    if options.overwrite:
        discard_training(options.out, OWN_FILES)
    recipe = {
        "preset": options.preset,
        "data": [str(folder) for folder in options.data],
        "weighting": options.training.weighting,
    }
    claim_folder(options.out, recipe, OWN_FILES)
