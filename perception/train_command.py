"""``bev-perception train``: teach a network to see the BEV in drive logs."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bev_driving_env.frames import CHANNELS
from bev_driving_env.training.command import add_run_options

from .training_config import LOOKS, LOSSES, WEIGHTINGS, TrainingConfig

DEFAULTS = TrainingConfig()
NUMBERS = (
    ("steps", int, "batches in all"),
    ("batch_size", int, "samples in a batch, over all processes"),
    ("learning_rate", float, "at its peak"),
    ("weight_decay", float, "AdamW's"),
    ("clip_norm", float, "longest gradient"),
    ("seed", int, "of first weights, order, looks and flips"),
    ("validate_every", int, "steps between validations"),
    ("validation_samples", int, "samples that each looks at"),
    ("patience", int, "validations without a new best after which it stops"),
    ("bandwidth", float, "of the KDE, in units of the action"),
    ("clip", float, "largest weight of the KDE, in means"),
    ("temper", float, "exponent of the KDE's weights, from 0 to 1"),
)
CHOICES = (
    (
        "weighting",
        WEIGHTINGS,
        "'kde' makes rare actions count more, as in the paper, 'actors' rare numbers of vehicles, "
        "pedestrians and lights in their channels",
    ),
    ("loss", LOSSES, "of each channel"),
    ("looks", LOOKS, "'random' paints and lights every sample anew, 'wild' in any colours"),
    ("precision", TrainingConfig.precisions, "'auto' is bf16 where that is faster"),
)
"""Options that go into ``TrainingConfig`` as they are."""


def add_parser(verbs: Any) -> None:
    """Add the verb ``train``."""
    parser = verbs.add_parser(
        "train",
        help="train a predictor on drive logs",
        description="Train a camera-to-BEV network on drive logs, whose images are rendered as it "
        "goes. Writes predictor.safetensors (the best by validation loss on route 0), metrics.csv "
        "and checkpoint.pt; the same command resumes. Runs under torchrun too: every process "
        "takes its share of each batch.",
    )
    add = parser.add_argument
    add("--preset", required=True, metavar="NAME", help="network: one of perception's PRESETS")
    add("--data", nargs="+", type=Path, required=True, metavar="FOLDER", help="drive logs")
    add("--out", type=Path, required=True, help="folder for the predictor")
    add(
        "--start",
        type=Path,
        metavar="FILE",
        help="predictor of the same preset whose weights to start from; its output layer starts "
        "anew if it predicts other channels",
    )
    add(
        "--channels",
        nargs="+",
        choices=CHANNELS,
        metavar="NAME",
        help=f"BEV channels to predict, of {', '.join(CHANNELS)}; default: the preset's",
    )
    add(
        "--set",
        nargs="+",
        type=_field,
        default=[],
        metavar="NAME=VALUE",
        help="change fields of the network's configuration: positions=tied trunk_widths=[8,16]",
    )
    for name, kind, text in NUMBERS:
        value = getattr(DEFAULTS, name)
        flag = f"--{name.replace('_', '-')}"
        add(flag, type=kind, default=value, metavar="X", help=f"{text}; default: {value}")
    for name, known, text in CHOICES:
        value = getattr(DEFAULTS, name)
        add(f"--{name}", choices=known, default=value, help=f"{text}; default: {value}")
    add(
        "--until",
        type=int,
        metavar="STEP",
        help="stop after this step, in the middle of the learning rate's cycle; the same command "
        "without it goes on; default: the last one",
    )
    add("--no-flips", action="store_true", help="do not mirror half of the samples")
    add("--workers", type=int, default=1, metavar="N", help="processes that render; default: 1")
    add_run_options(parser)
    parser.set_defaults(
        command=run, interrupted="; predictor and checkpoint are kept, the same command resumes"
    )


def _field(text: str) -> tuple[str, Any]:
    """Name and value of ``NAME=VALUE``; what is no JSON is a string."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got {text!r}")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments or the data are not valid.
    """
    # what is only asked for help needs no PyTorch, which takes seconds to load
    from .train_run import run as train

    return train(namespace, argv)
