"""Policy checkpoints: safetensors in half precision, of which loading executes nothing.

A file holds the actor; its header holds what the network sees and a card (what it was trained on,
what it reached). The critic stays behind: behaviour cloning has none. To go on with reinforcement
learning from a file::

    cloned = load_weights(path)
    model = PPO(BetaPolicy, env, policy_kwargs=cloned.config.policy_kwargs)
    model.policy.actor().load_state_dict(cloned.actor().state_dict())
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from bev_driving_env.weights_file import (
    WeightsError,
    read_tensors,
    read_weights_header,
    write_weights,
)

from .network import NetworkConfig

if TYPE_CHECKING:
    from .policy import BetaPolicy

__all__ = ["WeightsError", "load_weights", "save_weights", "weights_card"]

KIND = "bevtown_policy"
VERSION = 1


def save_weights(policy: BetaPolicy, path: str | Path, card: Mapping[str, Any]) -> None:
    """Write the actor of a policy; an interruption leaves no half file.

    Args:
        policy: The policy.
        path: Where to, by custom ``NAME.safetensors``.
        card: Anything about it that JSON can hold.

    Raises:
        ValueError: A weight is not finite.
        TypeError: The card holds something that JSON cannot.
    """
    header = {
        "config": policy.config.as_json(),
        "deterministic_action": policy.action_dist.point,
        "card": dict(card),
    }
    write_weights(Path(path), KIND, VERSION, header, policy.actor().state_dict())


def load_weights(path: str | Path) -> BetaPolicy:
    """Make the policy that a file describes, in single precision, with a new critic.

    Args:
        path: A file that :func:`save_weights` wrote.

    Returns:
        The policy, in evaluation mode.

    Raises:
        FileNotFoundError: There is no such file.
        WeightsError: The file is damaged, not a policy's, or of a newer version.
    """
    from .policy import BetaPolicy

    header = read_weights_header(Path(path), KIND, VERSION)
    try:
        config = NetworkConfig.from_json(header["config"])
        policy = BetaPolicy(
            _observation_space(config.bev_size),
            gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
            lambda _: 3e-4,
            **config.policy_kwargs,
            deterministic_action=header["deterministic_action"],
        )
        policy.actor().load_state_dict(read_tensors(Path(path)))
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise WeightsError(
            f"{path} does not hold the policy that it describes: {reason}"
        ) from error
    policy.set_training_mode(False)
    return policy


def weights_card(path: str | Path) -> dict[str, Any]:
    """The card of a file, without making a policy; errors as in :func:`load_weights`."""
    return dict(read_weights_header(Path(path), KIND, VERSION).get("card", {}))


def _observation_space(size: int) -> gym.spaces.Dict:
    """Space of BEVTown's observations with a BEV of that side and any speed."""
    from bev_driving_env.frames import BEVGeometry
    from bev_driving_env.spaces import observation_space

    return observation_space(BEVGeometry(size=size, ego_row=size // 2), np.inf)
