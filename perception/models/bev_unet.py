"""``BEVUNet``: a U-Net over the BEV grid, given the geometry.

It sees the images as they fall on flat ground, at full resolution, and the route map in the same
frame (``ipm_unet``), or the route map alone (``blind``, the floor for every learned predictor).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .layers import SHUFFLE, UNet, UNetConfig, unshuffled


@dataclass(frozen=True)
class BEVUNetConfig(UNetConfig):
    """What a ``BEVUNet`` sees, and its sizes.

    Attributes:
        ground: Whether it sees the ground; without it, the route map alone.
    """

    ground: bool = True


class BEVUNet(nn.Module):
    """Route map, and the images projected to the ground, to logits.

    Args:
        config: What it sees, and its sizes.

    Attributes:
        config: See above.
        needs: Names of its inputs.
        channels: Names of the channels of its output.
    """

    def __init__(self, config: BEVUNetConfig | None = None) -> None:
        super().__init__()
        self.config = config or BEVUNetConfig()
        self.channels = self.config.channels
        self.needs = frozenset({"route_map", "ground"} if self.config.ground else {"route_map"})
        # red, green, blue, whether any camera looks there, and the route map
        self.unet = UNet(SHUFFLE**2 * (5 if self.config.ground else 1), self.config)

    def forward(self, inputs: Mapping[str, Tensor]) -> Tensor:
        """Logits of a batch.

        Args:
            inputs: ``"route_map"`` (B, S, S) uint8, and ``"ground"`` (B, S, S, 3) uint8 RGB, black
                where no camera looks.

        Returns:
            (B, C, S, S) float.
        """
        layers = [inputs["route_map"][..., None]]
        if self.config.ground:
            ground = inputs["ground"]
            seen = (ground.amax(dim=-1, keepdim=True) > 0).to(torch.uint8) * 255
            layers = [ground, seen, *layers]
        # shuffled as bytes: a quarter of the traffic
        planes = unshuffled(torch.cat(layers, dim=-1)).to(self.unet.stem.weight.dtype)
        return self.unet(planes.mul_(1.0 / 255.0))
