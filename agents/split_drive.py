"""Driving the routes of a split all at once, to see how far a policy in training has come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from bev_driving_env.vector_env import BEVTownVectorEnv

from .policy import BetaPolicy

SEED = 0
"""Of the worlds, so that every look at a policy is at the same drives."""


@dataclass(frozen=True)
class SplitResult:
    """How a policy drove a split.

    Attributes:
        routes: Number of routes.
        clean: Share of them driven to the end without an infraction.
        route_share: Mean share of the route that was driven.
        mean_return: Mean sum of rewards.
    """

    routes: int
    clean: float
    route_share: float
    mean_return: float


class SplitDrive:
    """The first routes of a split, one in each world of a vector environment.

    Episodes end at the first infraction. The worlds are kept, so that a later drive starts at
    once.

    Args:
        town: Name of the town.
        split: ``"val"`` or ``"test"``.
        routes: How many of its routes.
        **keywords: Those of ``BEVTownVectorEnv``.
    """

    def __init__(self, town: str, split: str, routes: int, **keywords: Any) -> None:
        self._split = split
        self._envs = BEVTownVectorEnv(routes, town, autoreset_mode="SameStep", **keywords)

    def drive(self, policy: BetaPolicy) -> SplitResult:
        """Drive them with the policy's deterministic actions."""
        envs, count = self._envs, self._envs.num_envs
        mask = np.zeros(count, np.bool_)
        for i in range(count):
            mask[:] = False
            mask[i] = True
            options = {"split": self._split, "index": i, "reset_mask": mask}
            seen, _ = envs.reset(seed=SEED, options=options)
        summaries: dict[int, dict[str, Any]] = {}
        policy.set_training_mode(False)
        while len(summaries) < count:
            with torch.inference_mode():
                actions, _ = policy.predict(seen, deterministic=True)
            seen, _, terminated, truncated, infos = envs.step(actions)
            for i in np.flatnonzero(terminated | truncated).tolist():
                summary = infos["final_info"]["episode_summary"]
                # a world that is done drives on somewhere else until all are
                summaries.setdefault(i, {key: summary[key][i] for key in summary})
        driven = list(summaries.values())
        return SplitResult(
            routes=count,
            clean=float(np.mean([s["success"] and not s["infractions"] for s in driven])),
            route_share=float(np.mean([s["route_m"] / s["route_length_m"] for s in driven])),
            mean_return=float(np.mean([s["return"] for s in driven])),
        )
