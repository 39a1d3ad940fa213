"""``bev-agents ppo``: reinforcement learning with the Beta policy."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bev_driving_env.world.traffic import PRESETS

from .ppo_config import FINE_TUNING, FROM_SCRATCH

NUMBERS = (
    ("steps", int, "of all worlds together"),
    ("worlds", int, "stepped together"),
    ("horizon", int, "steps of a world between updates"),
    ("batch_size", int, "samples in a gradient step"),
    ("epochs", int, "how often a sample is learned from"),
    ("learning_rate", float, "at the start; falls to a tenth"),
    ("gamma", float, "discount of a step"),
    ("gae_lambda", float, "of generalised advantage estimation"),
    ("clip_range", float, "of the ratio of likelihoods"),
    ("entropy_weight", float, "in the loss"),
    ("target_kl", float, "ends an update early"),
    ("critic_steps", int, "in which only the critic learns"),
    ("seed", int, "of weights, worlds and samples"),
    ("validate_every", int, "steps between validations"),
    ("validation_routes", int, "of the val split"),
)
"""Options that go into ``PPOConfig`` as they are."""


def add_parser(verbs: Any) -> None:
    """Add the verb ``ppo``."""
    parser = verbs.add_parser(
        "ppo",
        help="train a policy by reinforcement learning",
        description="Train a Beta policy by Stable-Baselines3's PPO on many worlds in one process, "
        "from scratch or from weights. Writes the learning curve (curve.csv, curve.png), the best "
        "weights by validation (policy.safetensors) and the model (model.zip, for PPO.load); the "
        "same command goes on where it was stopped, on new episodes.",
    )
    add = parser.add_argument
    add("--town", default="Town01", help="default: Town01")
    add(
        "--from",
        dest="start",
        metavar="POLICY",
        help="'bc' or PATH.safetensors to go on from; default: random weights",
    )
    add("--out", type=Path, required=True, help="folder for what is learned")
    add("--traffic", choices=PRESETS, default="none", help="default: none")
    add("--lights", action="store_true", help="let the signals work")
    for name, kind, text in NUMBERS:
        scratch, tuning = getattr(FROM_SCRATCH, name), getattr(FINE_TUNING, name)
        said = f"{scratch}" if scratch == tuning else f"{scratch}, with --from {tuning}"
        flag = f"--{name.replace('_', '-')}"
        add(flag, type=kind, metavar="X", help=f"{text}; default: {said}")
    add("--threads", type=int, metavar="N", help="of torch; default: torch's own")
    add("--overwrite", action="store_true", help="discard what the folder already holds")
    parser.set_defaults(
        command=run, interrupted="; what was kept at the last validation stays, the same command "
        "goes on"
    )  # fmt: skip


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid.
    """
    # the other verbs need no PyTorch, which takes seconds to load
    from .ppo_run import run as train

    return train(namespace, argv)
