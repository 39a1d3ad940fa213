"""Convolutions without normalisation, and the small trunk that CPUs can afford."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions without normalisation beside a skip.

    The second convolution starts small, which keeps the variance down as normalisation would;
    that costs nothing, where batch normalisation on a CPU costs as much as a convolution.

    Args:
        width: Channels in and out.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = conv3x3(width, width)
        self.second = conv3x3(width, width)
        with torch.no_grad():
            self.second.weight.mul_(0.25)

    def forward(self, x: Tensor) -> Tensor:
        """(B, width, H, W) to the same shape."""
        # in place where no gradient needs the old values: memory is what CPUs wait for
        return self.second(self.first(x).relu_()).add_(x).relu_()


class SmallTrunk(nn.Module):
    """Plain convolutions, halving the image at each stage: dense ones suit CPUs best.

    Downsampling is by 4x4 kernels, whose output pixels sit in the middle of the 2x2 pixels that
    they stand for; so the pixel (i, j) of a feature looks at exactly ``stride * (i + 0.5) - 0.5``.

    Args:
        strides: Which features to return, of 2, 4, 8, ...
        stages: Channels at strides 2, 4, 8, ...
        blocks: Residual blocks of each stage.

    Attributes:
        widths: Channels of each feature.
    """

    def __init__(
        self,
        strides: Sequence[int] = (8, 16),
        stages: Sequence[int] = (24, 48, 96, 128),
        blocks: Sequence[int] = (0, 1, 1, 1),
    ) -> None:
        super().__init__()
        self._taps = [stride.bit_length() - 2 for stride in strides]
        self.widths = tuple(stages[tap] for tap in self._taps)
        before = (3, *stages)
        self.stages = nn.ModuleList(
            nn.Sequential(
                downsampling(before[number], width),
                *(ResidualBlock(width) for _ in range(blocks[number])),
            )
            for number, width in enumerate(stages[: max(self._taps) + 1])
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """Features of normalised images (B, 3, H, W), one (B, width, H / s, W / s) per stride."""
        features = []
        x = images
        for stage in self.stages:
            x = stage(x)
            features.append(x)
        return [features[tap] for tap in self._taps]


def conv3x3(width_in: int, width_out: int) -> nn.Conv2d:
    """A 3x3 convolution that keeps the variance through a ReLU (He et al., 2015)."""
    conv = nn.Conv2d(width_in, width_out, 3, padding=1)
    nn.init.kaiming_normal_(conv.weight, nonlinearity="relu")
    nn.init.zeros_(conv.bias)  # type: ignore[arg-type]
    return conv


def downsampling(width_in: int, width_out: int) -> nn.Sequential:
    """A 4x4 convolution with stride 2, and a ReLU."""
    conv = nn.Conv2d(width_in, width_out, 4, 2, 1)
    nn.init.kaiming_normal_(conv.weight, nonlinearity="relu")
    nn.init.zeros_(conv.bias)  # type: ignore[arg-type]
    return nn.Sequential(conv, nn.ReLU(inplace=True))
