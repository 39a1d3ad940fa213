"""What ``step`` and ``reset`` report beside the observation."""

from __future__ import annotations

import dataclasses
from typing import Any

from .kernels.layout import LATERAL, OUTSIDE_M, ROUTE_DONE, TRAVELLED_M
from .world.core import World
from .world.infractions import names_of

REWARD_TERM_NAMES = ("progress", "lateral", "heading", "comfort", "infractions")


def step_info(world: World, n: int) -> dict[str, Any]:
    """The part of the info dict that is there at every reset and step, all objects new."""
    progress = world.state.progress[n].tolist()
    began = int(world.began[n])
    return {
        "route_m": progress[ROUTE_DONE],
        "route_length_m": float(world.state.route_length[n]),
        "infractions": list(names_of(began)) if began else [],
        "success": bool(world.success[n]),
        "lateral_error_m": progress[LATERAL],
        "episode_id": world.episode_ids[n],
    }


def reward_terms(world: World, n: int) -> dict[str, float]:
    """The terms of the last step's reward, by name."""
    return dict(zip(REWARD_TERM_NAMES, world.reward_terms[n].tolist(), strict=True))


def episode_summary(world: World, n: int) -> dict[str, Any]:
    """What an episode came to, once it has ended.

    Returns:
        ``episode_id``, ``route_m``, ``route_length_m``, ``success``, ``truncated`` (time limit),
        ``steps``, ``time_s``, ``return``, ``travelled_m`` (metres driven), ``outside_m`` (metres
        of them off the road or against the lane) and ``infractions``: a list of dicts with the
        fields of ``InfractionEvent``.
    """
    state = world.state
    return {
        "episode_id": world.episode_ids[n],
        "route_m": float(state.progress[n, ROUTE_DONE]),
        "route_length_m": float(state.route_length[n]),
        "success": bool(world.success[n]),
        "truncated": bool(world.truncated()[n]),
        "steps": int(state.steps[n]),
        "time_s": float(state.steps[n]) * world.config.step_s,
        "return": float(state.returns[n]),
        "travelled_m": float(state.travelled[n, TRAVELLED_M]),
        "outside_m": float(state.travelled[n, OUTSIDE_M]),
        "infractions": [dataclasses.asdict(event) for event in world.events[n]],
    }
