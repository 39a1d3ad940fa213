"""``bev-agents train``: clone the expert's behaviour from drive logs."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bev_driving_env.frames import CHANNELS
from bev_driving_env.training.command import add_run_options

from .training_config import WEIGHTINGS, TrainingConfig

DEFAULTS = TrainingConfig()
NUMBERS = (
    ("steps", int),
    ("batch_size", int),
    ("learning_rate", float),
    ("weight_decay", float),
    ("clip_norm", float),
    ("seed", int),
    ("validate_every", int),
    ("patience", int),
)
"""Options that go into ``TrainingConfig`` as they are."""


def add_parser(verbs: Any) -> None:
    """Add the verb ``train``."""
    parser = verbs.add_parser(
        "train",
        help="train a policy on drive logs",
        description="Clone the expert's behaviour from drive logs. Writes policy.safetensors (the "
        "best by validation since the last DAgger round), metrics.csv and checkpoint.pt; the same "
        "command resumes. Runs under torchrun too: every process takes its share of each batch.",
    )
    add = parser.add_argument
    add("--data", nargs="+", type=Path, required=True, metavar="FOLDER", help="drive logs")
    add("--out", type=Path, required=True, help="folder for the policy")
    add(
        "--channels",
        nargs="+",
        choices=CHANNELS,
        default=list(CHANNELS[:3]),
        metavar="NAME",
        help=f"BEV channels that the policy sees, of {', '.join(CHANNELS)}; "
        "default: the paper's road route lane",
    )
    add(
        "--commands",
        action="store_true",
        help="the policy also sees the last two commands, as in the paper; without, it cannot "
        "learn to repeat them",
    )
    add("--dagger", type=int, default=0, metavar="N", help="DAgger rounds; default: 0")
    for name, kind in NUMBERS:
        value = getattr(DEFAULTS, name)
        flag = f"--{name.replace('_', '-')}"
        add(flag, type=kind, default=value, metavar="X", help=f"default: {value}")
    add(
        "--weighting",
        choices=WEIGHTINGS,
        default="kde",
        help="'kde' makes rare actions (starting off, corners) count more; default: kde",
    )
    add("--precision", choices=DEFAULTS.precisions, default="fp32", help="default: fp32")
    add_run_options(parser)
    parser.set_defaults(
        command=run, interrupted="; policy and checkpoint are kept, the same command resumes"
    )


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments or the data are not valid.
    """
    # the other verbs need no PyTorch, which takes seconds to load
    from .train_run import run as train

    return train(namespace, argv)
