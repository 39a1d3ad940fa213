"""From the coarse BEV state to logits, and from BEV inputs to features that join on the way."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn

from .small_trunk import ResidualBlock, conv3x3, downsampling


class BEVEncoder(nn.Module):
    """Features of inputs that lie in the BEV frame: route map, projected images.

    Args:
        inputs: Channels of the input.
        dim: Channels of the coarsest feature.
        widths: Channels of the features at a half and a quarter of the input's side.
        blocks: Residual blocks at a quarter.
    """

    def __init__(self, inputs: int, dim: int, widths: tuple[int, int], blocks: int) -> None:
        super().__init__()
        half, quarter = widths
        self.at_half = nn.Sequential(
            nn.PixelUnshuffle(2), conv3x3(4 * inputs, half), nn.ReLU(inplace=True)
        )
        self.at_quarter = nn.Sequential(
            downsampling(half, quarter), *(ResidualBlock(quarter) for _ in range(blocks))
        )
        self.at_eighth = downsampling(quarter, dim)

    def forward(self, rasters: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Features at 1/2, 1/4 and 1/8 of rasters (B, inputs, S, S)."""
        half = self.at_half(rasters)
        quarter = self.at_quarter(half)
        return half, quarter, self.at_eighth(quarter)


class ResidualDecoder(nn.Module):
    """The published decoder: three bilinear doublings, each with the coarse state added again.

    Args:
        dim: Channels of the state.
        outputs: Channels of the logits.
        bev_widths: Channels of the BEV features that are added at a half and a quarter of the
            output's side; None if there are none.
    """

    WIDTHS = (128, 128, 64)

    def __init__(self, dim: int, outputs: int, bev_widths: tuple[int, int] | None = None) -> None:
        super().__init__()
        before = (dim, *self.WIDTHS)
        skips = (*reversed(bev_widths or (0, 0)), 0)
        self.layers = nn.ModuleList(
            ResidualDecoderBlock(before[number], width, dim, skips[number])
            for number, width in enumerate(self.WIDTHS)
        )
        self.head = nn.Sequential(
            nn.Conv2d(before[-1], before[-1], 3, padding=1, bias=False),
            nn.BatchNorm2d(before[-1]),
            nn.ReLU(),
            nn.Conv2d(before[-1], outputs, 1),
        )

    def forward(self, state: Tensor, bev_features: Sequence[Tensor] = ()) -> Tensor:
        """Logits (B, outputs, 8 S, 8 S) of a state (B, dim, S, S)."""
        y = state
        coarse_first = [*reversed(bev_features[:2]), None] if bev_features else [None] * 3
        for layer, feature in zip(self.layers, coarse_first, strict=True):
            y = layer(y, state, feature)
        return self.head(y)


class ResidualDecoderBlock(nn.Module):
    """One doubling.

    Args:
        width_in: Channels before.
        width_out: Channels after.
        dim: Channels of the coarse state.
        bev_skip: Channels of the BEV feature that joins, 0 for none.
    """

    def __init__(self, width_in: int, width_out: int, dim: int, bev_skip: int) -> None:
        super().__init__()
        narrow = width_out // 2
        self.conv = nn.Sequential(
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=True),
            nn.Conv2d(width_in, narrow, 3, padding=1, bias=False),
            nn.BatchNorm2d(narrow),
            nn.ReLU(),
            nn.Conv2d(narrow, width_out, 1, bias=False),
            nn.BatchNorm2d(width_out),
        )
        self.up = nn.Conv2d(dim, width_out, 1)
        self.bev_skip = nn.Conv2d(bev_skip, width_out, 1) if bev_skip else None

    def forward(self, x: Tensor, state: Tensor, bev_feature: Tensor | None) -> Tensor:
        """(B, width_in, H, W) to (B, width_out, 2 H, 2 W)."""
        y = self.conv(x)
        y = y + nn.functional.interpolate(self.up(state), y.shape[-2:])
        if self.bev_skip is not None and bev_feature is not None:
            y = y + self.bev_skip(bev_feature)
        return nn.functional.relu(y)


class LightDecoder(nn.Module):
    """A decoder for CPUs: pixel shuffles, and two convolutions at half the output's side.

    Most of the published decoder's time goes into bilinear doubling, batch normalisation and
    convolutions at the full side, where little is computed and much is moved.

    Args:
        dim: Channels of the state.
        outputs: Channels of the logits.
        widths: Channels at a half and a quarter of the output's side.
    """

    def __init__(self, dim: int, outputs: int, widths: tuple[int, int]) -> None:
        super().__init__()
        half, quarter = widths
        self.context = nn.Sequential(nn.AvgPool2d(2), ResidualBlock(dim), nn.Upsample(None, 2))
        self.up_quarter = nn.Sequential(nn.Conv2d(dim, 4 * quarter, 1), nn.PixelShuffle(2))
        self.at_quarter = ResidualBlock(quarter)
        self.up_half = nn.Sequential(nn.Conv2d(quarter, 4 * half, 1), nn.PixelShuffle(2))
        self.at_half = nn.Sequential(conv3x3(half, half), nn.ReLU(inplace=True))
        self.head = nn.Sequential(nn.Conv2d(half, 4 * outputs, 3, padding=1), nn.PixelShuffle(2))

    def forward(self, state: Tensor, bev_features: Sequence[Tensor] = ()) -> Tensor:
        """Logits (B, outputs, 8 S, 8 S) of a state (B, dim, S, S)."""
        y = self.up_quarter(state + self.context(state))
        if bev_features:
            y = y + bev_features[1]
        y = self.up_half(self.at_quarter(y.relu_()))
        if bev_features:
            y = y + bev_features[0]
        return self.head(self.at_half(y.relu_()))
