"""The paper's policy network: BEV and measurements in, concentrations of Beta distributions out.

Six convolutions see the BEV, a small MLP the measurements; both meet in 256 features, and a head
turns those into alpha and beta for acceleration and steering.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn

FEATURES = 256
HEAD = (256, 256)
ACTIONS = 2
_FILTERS = (8, 16, 32, 64, 128, 256)
_KERNELS = (5, 5, 5, 3, 3, 3)
_STRIDES = (2, 2, 2, 2, 2, 1)
_CHANNELS, _MEASUREMENTS = 6, 3


@dataclass(frozen=True)
class NetworkConfig:
    """What the network sees and how it answers.

    Attributes:
        channels: BEV channels that it sees, in this order; the default is the paper's (road,
            route, lane).
        measurements: Measurements that it sees: 0 speed, 1 and 2 the previous acceleration and
            steering commands.
        bev_size: Side of the square BEV in pixels.
        speed_scale_mps: Speeds are divided by it. The paper feeds them raw; near 1, like the
            other two, they neither swamp those nor need a learning rate of their own.
        concentration_floor: Added to every alpha and beta. The default only keeps them from
            vanishing; 1 makes every distribution have a single peak, which explores more gently
            in reinforcement learning from scratch.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    channels: tuple[int, ...] = (0, 1, 2)
    measurements: tuple[int, ...] = (0, 1, 2)
    bev_size: int = 192
    speed_scale_mps: float = 6.0
    concentration_floor: float = 1e-3

    def __post_init__(self) -> None:
        for name, available in (("channels", _CHANNELS), ("measurements", _MEASUREMENTS)):
            chosen = tuple(getattr(self, name))
            object.__setattr__(self, name, chosen)
            known = all(type(i) is int and 0 <= i < available for i in chosen)
            if not (chosen and known and len(set(chosen)) == len(chosen)):
                raise ValueError(
                    f"{name} must be different numbers from 0 to {available - 1}, "
                    f"at least one, got {chosen!r}"
                )
        for name in ("speed_scale_mps", "concentration_floor"):
            value = getattr(self, name)
            if not (0.0 < value < math.inf):
                raise ValueError(f"{name} must be positive and finite, got {value!r}")
        if type(self.bev_size) is not int or convolved_size(self.bev_size) < 1:
            raise ValueError(
                f"bev_size must be at least {smallest_bev_size()} pixels for six convolutions "
                f"without padding, got {self.bev_size!r}"
            )

    @property
    def policy_kwargs(self) -> dict[str, Any]:
        """Keywords of ``BetaPolicy`` for this network; the BEV's size follows from the space."""
        return {
            "channels": self.channels,
            "measurements": self.measurements,
            "speed_scale_mps": self.speed_scale_mps,
            "concentration_floor": self.concentration_floor,
        }

    def as_json(self) -> dict[str, Any]:
        """The fields as JSON values; :meth:`from_json` turns them back."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> NetworkConfig:
        """The configuration that :meth:`as_json` wrote; TypeError for fields of another kind."""
        return cls(**fields)


def convolved_size(size: int) -> int:
    """Side of the last feature map for a BEV of a given side; 0 where it does not fit.

    >>> convolved_size(192), convolved_size(64)
    (2, 0)
    """
    for kernel, stride in zip(_KERNELS, _STRIDES, strict=True):
        size = (size - kernel) // stride + 1
        if size < 1:
            return 0
    return size


def smallest_bev_size() -> int:
    """The least side of a BEV that the convolutions fit."""
    size = 1
    for kernel, stride in zip(reversed(_KERNELS), reversed(_STRIDES), strict=True):
        size = (size - 1) * stride + kernel
    return size


class BEVEncoder(nn.Module):
    """Turns a BEV and measurements into 256 features.

    Args:
        config: What it sees.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        convolutions: list[nn.Module] = []
        before = len(config.channels)
        for filters, kernel, stride in zip(_FILTERS, _KERNELS, _STRIDES, strict=True):
            convolutions += [nn.Conv2d(before, filters, kernel, stride), nn.ReLU()]
            before = filters
        self.convolutions = nn.Sequential(*convolutions, nn.Flatten())
        self.measured = mlp(len(config.measurements), (256, 256))
        flat = before * convolved_size(config.bev_size) ** 2
        self.fusion = mlp(flat + 256, (512, FEATURES))
        scale = torch.tensor([1.0 / config.speed_scale_mps, 1.0, 1.0])
        self.scale: Tensor
        # follows from the configuration, so it is no part of the weights
        self.register_buffer("scale", scale[list(config.measurements)], persistent=False)
        for module in self.convolutions:
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_uniform_(module.weight, gain=nn.init.calculate_gain("relu"))
                nn.init.constant_(module.bias, 0.1)  # type: ignore[arg-type]

    def forward(self, bev: Tensor, measurements: Tensor) -> Tensor:
        """Features of a batch.

        Args:
            bev: All channels of the BEV (N, C, H, W), 0 to 255, uint8 or float.
            measurements: Speed in m/s and the previous commands (N, 3).

        Returns:
            Features (N, 256).
        """
        # chosen before they become floats: much of the time of small batches goes into that;
        # training is a quarter faster with the channels last in memory
        chosen = bev[:, list(self.config.channels)]
        seen = chosen.to(torch.float32, memory_format=torch.channels_last, copy=True).div_(255.0)
        measured = measurements[:, list(self.config.measurements)].float() * self.scale
        joined = torch.cat([self.convolutions(seen), self.measured(measured)], dim=1)
        return self.fusion(joined)


class BetaHead(nn.Module):
    """Turns features into the concentrations of one Beta distribution per action.

    Args:
        features: Number of features F.
        actions: Number of actions D.
        floor: Added to every concentration.
    """

    def __init__(self, features: int, actions: int, floor: float) -> None:
        super().__init__()
        self.alpha = nn.Linear(features, actions)
        self.beta = nn.Linear(features, actions)
        self.floor = floor

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Concentrations alpha and beta, each (N, D), of features (N, F)."""
        alpha = nn.functional.softplus(self.alpha(features)) + self.floor
        beta = nn.functional.softplus(self.beta(features)) + self.floor
        return alpha, beta


class BetaActor(nn.Module):
    """The policy without its critic: what behaviour cloning trains, and what is shipped.

    Args:
        encoder: From observations to features.
        hidden: From features to the head's.
        head: From those to concentrations.
    """

    def __init__(self, encoder: BEVEncoder, hidden: nn.Module, head: BetaHead) -> None:
        super().__init__()
        self.encoder = encoder
        self.hidden = hidden
        self.head = head

    def forward(self, bev: Tensor, measurements: Tensor) -> tuple[Tensor, Tensor]:
        """Concentrations of a batch.

        Args:
            bev: BEVs (N, C, H, W), 0 to 255, uint8 or float.
            measurements: Measurements (N, 3).

        Returns:
            alpha and beta, each (N, 2).
        """
        return self.head(self.hidden(self.encoder(bev, measurements)))


def mlp(inputs: int, widths: tuple[int, ...]) -> nn.Sequential:
    """Linear layers of the given widths, each followed by a ReLU."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [nn.Linear(inputs, width), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers)
