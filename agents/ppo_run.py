"""What ``bev-agents ppo`` does: PPO with the Beta policy, validated and kept as it goes."""

from __future__ import annotations

import argparse
import io
import shlex
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from bev_driving_env.command_line import UsageError
from bev_driving_env.files import write_bytes
from bev_driving_env.provenance import file_hash, provenance
from bev_driving_env.training.folder import claim_folder, discard_training
from bev_driving_env.vector_env import BEVTownVectorEnv

from .checkpoint import load_weights, save_weights
from .learning_curve import CURVE_CSV, CURVE_PNG, read_curve, write_curve
from .policy import BetaPolicy
from .ppo_config import FINE_TUNING, FROM_SCRATCH, PPOConfig
from .registry import agent_source
from .sb3_vec_env import SB3VecEnv
from .split_drive import SplitDrive

MODEL, WEIGHTS = "model.zip", "policy.safetensors"
OWN_FILES = (MODEL, WEIGHTS, CURVE_CSV, CURVE_PNG)
VALIDATION = "val"


@dataclass(frozen=True)
class PPOOptions:
    """Options of ``bev-agents ppo``.

    Attributes:
        town: Where it drives.
        start: Name or file of the policy to go on from; None starts with random weights.
        settings: Keywords of the environment.
        config: Of PPO.
        out: Folder for model, weights and learning curve.
        overwrite: Discard what the folder holds.
    """

    town: str
    start: str | None
    settings: dict[str, Any]
    config: PPOConfig
    out: Path
    overwrite: bool

    def recipe(self) -> dict[str, Any]:
        """What must be the same for a run to go on where another stopped."""
        config = asdict(self.config)
        del config["steps"]
        return {"town": self.town, "from": self.start, "settings": self.settings, **config}

    def title(self) -> str:
        """Of the learning curve."""
        start = "from scratch" if self.start is None else f"from {self.start}"
        return f"PPO with a Beta policy, {self.town}, {start}, seed {self.config.seed}"


@dataclass(frozen=True)
class Falling:
    """A learning rate that falls linearly to a tenth; a class, so that it can be pickled."""

    peak: float

    def __call__(self, remaining: float) -> float:
        """The rate when this share of the training remains."""
        return self.peak * (0.1 + 0.9 * remaining)


def run(namespace: argparse.Namespace, argv: Sequence[str]) -> int:
    """Run the verb.

    Raises:
        UsageError: The arguments are not valid, or the folder holds another run.
    """
    if namespace.threads is not None:
        torch.set_num_threads(max(1, namespace.threads))
    try:
        options = _options(namespace)
        _train(options, argv)
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error
    return 0


def _options(namespace: argparse.Namespace) -> PPOOptions:
    defaults = FROM_SCRATCH if namespace.start is None else FINE_TUNING
    given = {name: getattr(namespace, name) for name in asdict(defaults)}
    config = replace(defaults, **{k: v for k, v in given.items() if v is not None})
    settings = {"traffic": namespace.traffic, "traffic_lights": namespace.lights}
    return PPOOptions(
        namespace.town, namespace.start, settings, config, namespace.out, namespace.overwrite
    )


def _train(options: PPOOptions, argv: Sequence[str]) -> None:
    config, start = options.config, _start(options.start)
    worlds = BEVTownVectorEnv(
        config.worlds, options.town, autoreset_mode="SameStep", **options.settings
    )
    envs = SB3VecEnv(worlds)
    # nothing is written or discarded before all that can be wrong has been looked at
    if options.overwrite:
        discard_training(options.out, OWN_FILES)
    claim_folder(options.out, options.recipe(), OWN_FILES)
    saved = options.out / MODEL
    if saved.exists():
        model = PPO.load(saved, env=envs, device="cpu")
        # or it would drive its first episodes again
        model.set_random_seed(config.seed + model.num_timesteps)
    else:
        model = _new_model(config, envs, start)
    left = config.steps - model.num_timesteps
    rows = read_curve(options.out / CURVE_CSV)
    if left > 0:
        follower = Follower(options, argv, rows, model.num_timesteps)
        with follower.bar:
            model.learn(left, callback=follower, reset_num_timesteps=False)
            follower.finish()
    best = max(rows, key=_merit)
    print(
        f"{options.out / WEIGHTS}: after {best['steps']:,.0f} steps {best['val_clean']:.0%} of the "
        f"validation routes clean, {best['val_route_share']:.0%} driven; {options.out / CURVE_PNG}"
    )


def _start(name: str | None) -> BetaPolicy | None:
    """The policy to go on from; None for random weights."""
    return None if name is None else load_weights(_source(name))


def _new_model(config: PPOConfig, envs: SB3VecEnv, start: BetaPolicy | None) -> PPO:
    """A model with new weights, or with those to go on from."""
    # one peak, and only the speed: what it did before it may only learn to repeat
    keywords: dict[str, Any] = {"concentration_floor": 1.0, "measurements": (0,)}
    if start is not None:
        keywords = start.config.policy_kwargs
    model = PPO(
        BetaPolicy,
        envs,
        learning_rate=Falling(config.learning_rate),
        n_steps=config.horizon,
        batch_size=config.batch_size,
        n_epochs=config.epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip_range,
        ent_coef=config.entropy_weight,
        target_kl=config.target_kl,
        policy_kwargs=keywords,
        seed=config.seed,
        device="cpu",
    )
    if start is not None:
        assert isinstance(model.policy, BetaPolicy)
        model.policy.actor().load_state_dict(start.actor().state_dict())
    return model


def _source(start: str) -> Path:
    path = agent_source(start)
    if path is None or path.suffix != ".safetensors":
        raise ValueError(
            f"--from {start!r} must be 'bc' or the .safetensors file of a Beta policy "
            "(Stable-Baselines3's own zips go on with PPO.load)"
        )
    return path


def _merit(row: dict[str, float]) -> tuple[float, float]:
    return row["val_clean"], row["val_return"]


class Follower(BaseCallback):
    """Validates, moves the bar, and keeps model, weights and curve after each validation.

    Args:
        options: Of the run.
        argv: Arguments of the command.
        rows: Of the learning curve; new ones are added.
        first: Steps done before.
    """

    def __init__(
        self,
        options: PPOOptions,
        argv: Sequence[str],
        rows: list[dict[str, float]],
        first: int,
    ) -> None:
        super().__init__()
        self._options, self._argv = options, argv
        self._drive = SplitDrive(
            options.town, VALIDATION, options.config.validation_routes, **options.settings
        )
        self.rows = rows
        self._minutes = self.rows[-1]["minutes"] if self.rows else 0.0
        self._since = time.monotonic()
        self._ended: list[dict[str, Any]] = []
        self.bar: tqdm[Any] = tqdm(
            total=options.config.steps, initial=first, unit="step", desc="PPO"
        )

    def _on_training_start(self) -> None:
        self._set_actor_learns()
        if not self.rows:  # what it knows before it has learned anything
            self._validate()

    def _on_step(self) -> bool:
        self._ended += [i["episode_summary"] for i in self.locals["infos"] if i]
        return True

    def _on_rollout_start(self) -> None:
        # the update on the rollout before this one is done
        self.bar.update(self.num_timesteps - self.bar.n)
        self._set_actor_learns()
        if self.num_timesteps - self.rows[-1]["steps"] >= self._options.config.validate_every:
            self._validate()

    def finish(self) -> None:
        """Validate what the last update made."""
        self.bar.update(self.num_timesteps - self.bar.n)
        if self.rows[-1]["steps"] < self.num_timesteps:
            self._validate()

    def _set_actor_learns(self) -> None:
        learns = self.num_timesteps >= self._options.config.critic_steps
        policy = self.model.policy
        assert isinstance(policy, BetaPolicy)
        for parameter in policy.actor().parameters():
            parameter.requires_grad_(learns)

    def _validate(self) -> None:
        policy = self.model.policy
        assert isinstance(policy, BetaPolicy)
        result = self._drive.drive(policy)
        shares = [e["route_m"] / e["route_length_m"] for e in self._ended]
        row = {
            "steps": float(self.num_timesteps),
            "minutes": self._minutes + (time.monotonic() - self._since) / 60.0,
            "train_episodes": float(len(self._ended)),
            "train_return": _mean([e["return"] for e in self._ended]),
            "train_route_share": _mean(shares),
            "val_return": result.mean_return,
            "val_route_share": result.route_share,
            "val_clean": result.clean,
        }
        self._ended = []
        best = max(map(_merit, self.rows), default=(-1.0, 0.0))
        self.rows.append(row)
        out = self._options.out
        if _merit(row) > best:
            save_weights(policy, out / WEIGHTS, self._card(row))
        write_curve(out, self.rows, self._options.title())
        stored = io.BytesIO()
        self.model.save(stored)
        write_bytes(out / MODEL, stored.getvalue())
        self.bar.set_postfix(
            clean=f"{result.clean:.0%}",
            route=f"{result.route_share:.0%}",
            ret=f"{result.mean_return:.0f}",
        )

    def _card(self, row: dict[str, float]) -> dict[str, Any]:
        """What the weights file says about where it came from."""
        options = self._options
        start = options.start
        return {
            **provenance(self._argv, [options.config.seed]),
            "command": shlex.join(["bev-agents", *self._argv]),
            "from": start,
            "from_hash": None if start is None else file_hash(_source(start)),
            "steps": int(row["steps"]),
            "hours": round(row["minutes"] / 60.0, 4),
            "validation_clean": row["val_clean"],
            "validation_return": row["val_return"],
        }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
