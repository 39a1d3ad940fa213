"""Parts of the U-Nets: residual blocks without normalisation, pixel shuffles, the U-Net itself.

Time on a processor goes into convolutions at high resolution and into every pass over memory
there, so images enter by pixel unshuffling and the BEV leaves by pixel shuffling, nothing is
normalised, and skip connections are added rather than concatenated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from bev_driving_env.checks import is_int
from bev_driving_env.frames import CHANNELS, BEVGeometry

BASE_RATES = {
    "road": 0.27,
    "route": 0.07,
    "lane": 0.03,
    "vehicles": 0.01,
    "pedestrians": 0.007,
    "lights": 0.003,
}
"""Share of set cells of each channel in drives through Town01 with dense traffic."""
SHUFFLE = 2
"""Pixels of the BEV along each side of a cell of the finest level."""
PLACES = 4
"""Numbers that tell a cell where it is."""


@dataclass(frozen=True)
class UNetConfig:
    """What all U-Nets have in common.

    The finest level has half the BEV's resolution, every other one half of that before it.

    Attributes:
        channels: Names of the BEV channels predicted, in the order of the output.
        bev_size: Side of the square BEV in pixels.
        widths: Features of each level, finest first.
        encoder_blocks: Residual blocks of each level on the way down.
        decoder_blocks: Likewise on the way up; one fewer, since the last level has no way up.
        places: Whether each cell is told where it lies as seen from the car.

    Raises:
        ValueError: A value is out of range; the message shows it.
    """

    channels: tuple[str, ...] = CHANNELS
    bev_size: int = 192
    widths: tuple[int, ...] = (24, 48, 96, 128, 128)
    encoder_blocks: tuple[int, ...] = (0, 1, 1, 2, 2)
    decoder_blocks: tuple[int, ...] = (0, 1, 1, 0)
    places: bool = True

    def __post_init__(self) -> None:
        for name in ("channels", "widths", "encoder_blocks", "decoder_blocks"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        unknown = [name for name in self.channels if name not in CHANNELS]
        if unknown or not self.channels or len(set(self.channels)) < len(self.channels):
            raise ValueError(
                f"channels must be different ones of {', '.join(CHANNELS)}, at least one, "
                f"got {self.channels!r}"
            )
        if not self.widths or not all(is_int(width) and width >= 1 for width in self.widths):
            raise ValueError(f"widths must be positive ints, got {self.widths!r}")
        levels = len(self.widths)
        for name, length in (("encoder_blocks", levels), ("decoder_blocks", levels - 1)):
            blocks = getattr(self, name)
            if len(blocks) != length or not all(is_int(n) and n >= 0 for n in blocks):
                raise ValueError(
                    f"{name} must be {length} ints of at least 0 for {levels} widths, "
                    f"got {blocks!r}"
                )
        multiple = SHUFFLE * 2 ** (levels - 1)
        if not is_int(self.bev_size) or self.bev_size < multiple or self.bev_size % multiple:
            raise ValueError(
                f"bev_size must be a multiple of {multiple} for {levels} widths, "
                f"got {self.bev_size!r}"
            )

    def as_json(self) -> dict[str, Any]:
        """The fields as JSON values; :meth:`from_json` turns them back."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> UNetConfig:
        """The configuration that :meth:`as_json` wrote; TypeError for fields of another kind."""
        return cls(**fields)


class ResidualBlock(nn.Module):
    """``relu(x + conv(relu(conv(x))))``; it starts as the identity, so depth needs no norm.

    Args:
        width: Number of features.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _convolution(width, width)
        self.second = _convolution(width, width)
        nn.init.zeros_(self.second.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Features (B, width, H, W), none negative, to as many."""
        return self.second(self.first(x).relu_()).add_(x).relu_()


class Upsampling(nn.Module):
    """Doubles the resolution: a linear map makes four cells of each.

    Args:
        before: Number of features that come in.
        after: Number of features that go out.
    """

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        # PyTorch's own 1x1 convolution of floats is twice as slow as the product that it is
        self.spread = nn.Linear(before, SHUFFLE**2 * after)
        _initialise(self.spread)

    def forward(self, x: Tensor) -> Tensor:
        """Features (B, before, H, W) to (B, after, 2 H, 2 W)."""
        return shuffled(self.spread(x.permute(0, 2, 3, 1)))


class UNet(nn.Module):
    """Planes on the grid of the finest level in, logits of the BEV out.

    Args:
        inputs: Number of planes that come in.
        config: Sizes.
    """

    def __init__(self, inputs: int, config: UNetConfig) -> None:
        super().__init__()
        widths = config.widths
        self.stem = _convolution(inputs, widths[0])
        self.place: nn.Conv2d | None = None
        if config.places:
            self.place = nn.Conv2d(PLACES, widths[0], 1, bias=False)
            self.cells: Tensor
            # follows from the configuration, so it is no part of the weights
            self.register_buffer("cells", places(config.bev_size), persistent=False)
        self.encoder = nn.ModuleList(map(_blocks, widths, config.encoder_blocks))
        self.downs = nn.ModuleList(_halving(a, b) for a, b in pairwise(widths))
        self.ups = nn.ModuleList(Upsampling(b, a) for a, b in pairwise(widths))
        self.decoder = nn.ModuleList(map(_blocks, widths, config.decoder_blocks))
        self.merge = _convolution(widths[0], widths[0])
        self.head = nn.Conv2d(widths[0], SHUFFLE**2 * len(config.channels), 3, padding=1)
        nn.init.normal_(self.head.weight, std=0.01)
        start = [logit(BASE_RATES[name]) for name in config.channels]
        with torch.no_grad():
            assert self.head.bias is not None
            self.head.bias.copy_(torch.tensor(start * SHUFFLE**2))
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, planes: Tensor) -> Tensor:
        """Logits (B, C, S, S) float of planes (B, inputs, S / 2, S / 2)."""
        x = self.stem(planes)
        if self.place is not None:
            x = x.add_(self.place(self.cells))
        x = x.relu_()
        skips = []
        for blocks, down in zip(self.encoder[:-1], self.downs, strict=True):
            x = blocks(x)
            skips.append(x)
            x = down(x).relu_()
        x = self.encoder[-1](x)
        for up, blocks in zip(reversed(self.ups), reversed(self.decoder), strict=True):
            x = blocks(up(x).add_(skips.pop()).relu_())
        x = self.merge(x).relu_()
        return shuffled_planes(self.head(x)).float()


def logit(probability: float) -> float:
    """The number whose sigmoid is a probability.

    >>> logit(0.5)
    0.0
    """
    return math.log(probability / (1.0 - probability))


def places(bev_size: int) -> Tensor:
    """Where the cells of the finest level are: (1, PLACES, S / 2, S / 2) float.

    Forward, left, distance to either side, and distance from the car, all in half widths of the
    BEV. The car is as far down as in the paper's BEV.
    """
    paper = BEVGeometry()
    row = round(bev_size * paper.ego_row / paper.size)
    geometry = BEVGeometry(size=bev_size, ego_row=row)
    count = bev_size // SHUFFLE
    # a cell is as many pixels wide as are shuffled into it
    centres = SHUFFLE * torch.arange(count) + (SHUFFLE - 1) / 2.0
    forward = ((geometry.ego_row - centres) / (bev_size / 2.0))[:, None].expand(count, count)
    left = ((geometry.ego_column - centres) / (bev_size / 2.0))[None, :].expand(count, count)
    return torch.stack([forward, left, left.abs(), torch.hypot(forward, left)])[None]


def shuffled(x: Tensor) -> Tensor:
    """Features (B, H, W, 4 C) to (B, C, 2 H, 2 W).

    Unlike in ``pixel_shuffle``, the C features of a cell lie side by side before and after, so
    that whole runs of memory are copied.
    """
    batch, height, width, _ = x.shape
    cells = x.reshape(batch, height, width, SHUFFLE, SHUFFLE, -1).transpose(2, 3)
    return cells.reshape(batch, SHUFFLE * height, SHUFFLE * width, -1).permute(0, 3, 1, 2)


def shuffled_planes(x: Tensor) -> Tensor:
    """Features (B, 4 C, H, W) to planes (B, C, 2 H, 2 W), one after the other in memory."""
    batch, _, height, width = x.shape
    cells = x.permute(0, 2, 3, 1).reshape(batch, height, width, SHUFFLE, SHUFFLE, -1)
    cells = cells.permute(0, 5, 1, 3, 2, 4)  # (B, C, H, 2, W, 2)
    return cells.reshape(batch, -1, SHUFFLE * height, SHUFFLE * width)


def unshuffled(image: Tensor) -> Tensor:
    """An image (B, S, S, C) to planes (B, 4 C, S / 2, S / 2) with channels last in memory."""
    batch, height, width, channels = image.shape
    height, width = height // SHUFFLE, width // SHUFFLE
    cells = image.reshape(batch, height, SHUFFLE, width, SHUFFLE, channels).transpose(2, 3)
    return cells.reshape(batch, height, width, -1).permute(0, 3, 1, 2)


def _blocks(width: int, count: int) -> nn.Sequential:
    return nn.Sequential(*(ResidualBlock(width) for _ in range(count)))


def _convolution(before: int, after: int) -> nn.Conv2d:
    convolution = nn.Conv2d(before, after, 3, padding=1)
    _initialise(convolution)
    return convolution


def _halving(before: int, after: int) -> nn.Conv2d:
    convolution = nn.Conv2d(before, after, 2, stride=2)
    _initialise(convolution)
    return convolution


def _initialise(layer: nn.Conv2d | nn.Linear) -> None:
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
