"""Policy checkpoints: safetensors in half precision, of which loading executes nothing.

A file holds the actor; its header holds what the network sees and a card (what it was trained on,
what it reached). The critic stays behind: behaviour cloning has none. To go on with reinforcement
learning from a file::

    model = PPO(BetaPolicy, env)
    model.policy.actor().load_state_dict(load_weights(path).actor().state_dict())
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as as_safetensors
from torch import Tensor

from bev_driving_env.files import write_bytes

from .network import NetworkConfig

if TYPE_CHECKING:
    from .policy import BetaPolicy

KEY = "bevtown_policy"
VERSION = 1


class WeightsError(ValueError):
    """A file that holds no policy weights of this version."""


def save_weights(policy: BetaPolicy, path: str | Path, card: Mapping[str, Any]) -> None:
    """Write the actor of a policy; an interruption leaves no half file.

    Args:
        policy: The policy.
        path: Where to, by custom ``NAME.safetensors``.
        card: Anything about it that JSON can hold.

    Raises:
        ValueError: A weight is not finite in half precision.
        TypeError: The card holds something that JSON cannot.
    """
    halves: dict[str, Tensor] = {}
    for name, value in policy.actor().state_dict().items():
        halves[name] = value.detach().cpu().to(torch.float16).contiguous()
        if not torch.isfinite(halves[name]).all():
            raise ValueError(f"{name} holds values that are not finite in half precision")
    header = {
        "version": VERSION,
        "config": policy.config.as_json(),
        "deterministic_action": policy.action_dist.point,
        "card": dict(card),
    }
    content = as_safetensors(halves, metadata={KEY: json.dumps(header, allow_nan=False)})
    write_bytes(Path(path), content)


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

    header = _header(Path(path))
    try:
        config = NetworkConfig.from_json(header["config"])
        policy = BetaPolicy(
            _observation_space(config.bev_size),
            gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
            lambda _: 3e-4,
            channels=config.channels,
            measurements=config.measurements,
            speed_scale_mps=config.speed_scale_mps,
            concentration_floor=config.concentration_floor,
            deterministic_action=header["deterministic_action"],
        )
        policy.actor().load_state_dict(_tensors(Path(path)))
    except (SafetensorError, KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise WeightsError(
            f"{path} does not hold the policy that it describes: {reason}"
        ) from error
    policy.set_training_mode(False)
    return policy


def weights_card(path: str | Path) -> dict[str, Any]:
    """The card of a file, without making a policy; errors as in :func:`load_weights`."""
    return dict(_header(Path(path)).get("card", {}))


def _tensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a file by name, in single precision."""
    with safe_open(path, framework="pt") as file:
        return {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118


def _header(path: Path) -> dict[str, Any]:
    """What a file says about itself, checked for kind and version."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(KEY)
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path} is damaged or no safetensors file: {error}") from error
    if text is None:
        raise WeightsError(f"{path} is a safetensors file, but not of a BEVTown policy")
    try:
        header = json.loads(text)
        version = int(header["version"])
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"{path} has a header that cannot be read: {error!r}") from error
    if version > VERSION:
        raise WeightsError(
            f"{path} is of version {version}, this BEVTown reads up to {VERSION}: update BEVTown"
        )
    return header


def _observation_space(size: int) -> gym.spaces.Dict:
    """Space of BEVTown's observations with a BEV of that side and any speed."""
    from bev_driving_env.frames import BEVGeometry
    from bev_driving_env.spaces import observation_space

    return observation_space(BEVGeometry(size=size, ego_row=size // 2), np.inf)
