"""``ImageUNet``: images and route map in, BEV out, and no geometry.

The baseline ``unet`` of the paper's earlier study: the network is not told where the cameras sit
and must learn by itself which pixel shows which place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from bev_driving_env.checks import require_count

from .layers import SHUFFLE, UNet, UNetConfig, unshuffled


@dataclass(frozen=True)
class ImageUNetConfig(UNetConfig):
    """What an ``ImageUNet`` sees, and its sizes.

    Attributes:
        cameras: How many cameras there are.
    """

    cameras: int = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count("cameras", self.cameras)


class ImageUNet(nn.Module):
    """Images, laid out as a mosaic, and the route map to logits.

    Args:
        config: Sizes.

    Attributes:
        config: See above.
        needs: Names of its inputs.
        channels: Names of the channels of its output.
    """

    needs = frozenset({"images", "route_map"})

    def __init__(self, config: ImageUNetConfig | None = None) -> None:
        super().__init__()
        self.config = config or ImageUNetConfig()
        self.channels = self.config.channels
        self.unet = UNet(SHUFFLE**2 * 4, self.config)

    def forward(self, inputs: Mapping[str, Tensor]) -> Tensor:
        """Logits of a batch.

        Args:
            inputs: ``"images"`` (B, N, H, W, 3) uint8 RGB, and ``"route_map"`` (B, S, S) uint8.

        Returns:
            (B, C, S, S) float.

        Raises:
            ValueError: There are more or fewer images than the network was made for.
        """
        images, dtype = inputs["images"], self.unet.stem.weight.dtype
        if images.shape[1] != self.config.cameras:
            raise ValueError(
                f"the network was made for {self.config.cameras} cameras, got {images.shape[1]}"
            )
        rgb = mosaic(images.to(dtype), self.config.bev_size)
        plan = inputs["route_map"][..., None].to(dtype)
        return self.unet(unshuffled(torch.cat([rgb, plan], dim=-1)) / 255.0)


def mosaic(images: Tensor, size: int) -> Tensor:
    """Images (B, N, H, W, 3) float side by side, row by row, as a square (B, size, size, 3).

    Each is shrunk by averaging. Places that are left over are black.
    """
    batch, count, height, width, _ = images.shape
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    flat = images.reshape(batch * count, height, width, 3).permute(0, 3, 1, 2)
    small = nn.functional.interpolate(flat, (size // rows, size // columns), mode="area")
    tiles = small.permute(0, 2, 3, 1).reshape(batch, count, size // rows, size // columns, 3)
    square = images.new_zeros(batch, size, size, 3)
    for number in range(count):
        row, column = divmod(number, columns)
        top, left = row * (size // rows), column * (size // columns)
        square[:, top : top + size // rows, left : left + size // columns] = tiles[:, number]
    return square
