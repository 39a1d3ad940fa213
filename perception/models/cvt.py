"""The Cross-View Transformer, as published and as a laptop's CPU wants it.

Zhou and Kraehenbuehl, "Cross-View Transformers for real-time Map-view Semantic Segmentation",
CVPR 2022: a trunk sees every image, a coarse BEV state asks the features of all images through
camera-aware cross-view attention, scale by scale, and a decoder enlarges the state.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ..inputs import RIG
from .bev_decoder import BEVEncoder, LightDecoder, ResidualDecoder
from .cross_view import Bottleneck, CrossView
from .cvt_config import PAPER, CVTConfig
from .efficientnet import EfficientNetB4
from .position import bev_cells
from .small_trunk import SmallTrunk

Inputs = Mapping[str, Tensor]

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
OVERHEAD_M = 20.0


class CrossViewTransformer(nn.Module):
    """Images of any number of cameras, and a route map, to BEV logits.

    Args:
        config: What it is made of.

    Attributes:
        needs: Names of the inputs.
        channels: Names of the output's channels.
    """

    pixel_scale: Tensor
    pixel_shift: Tensor
    overhead: Tensor

    def __init__(self, config: CVTConfig = PAPER) -> None:
        super().__init__()
        self.config = config
        self.channels = config.channels
        optional = {"route_map": config.route_map != "none", "ground": config.ground_skip}
        self.needs = frozenset({"images", "intrinsics", "extrinsics"}) | {
            name for name, wanted in optional.items() if wanted
        }
        mean, std = torch.tensor(IMAGENET_MEAN), torch.tensor(IMAGENET_STD)
        buffers = {
            "pixel_scale": 1.0 / (255.0 * std),
            "pixel_shift": -mean / std,
            "overhead": overhead_pose(),
        }
        for name, value in buffers.items():
            self.register_buffer(name, value, persistent=False)
        self.trunk: EfficientNetB4 | SmallTrunk
        if config.trunk == "small":
            self.trunk = SmallTrunk(config.scales, config.trunk_widths, config.trunk_blocks)
        else:
            self.trunk = EfficientNetB4(config.scales)
        self.prior = nn.Parameter(torch.randn(config.dim, config.cells, config.cells))
        cells = bev_cells(config.geometry, config.cells, config.grids)
        height, width = config.image_size
        self.cross_views = nn.ModuleList(
            CrossView(
                (height // scale, width // scale),
                feature_width,
                config.image_size,
                cells,
                heads=config.heads,
                head_dim=config.head_dim,
                positions=config.positions,
                grids=config.grids,
            )
            for scale, feature_width in zip(config.scales, self.trunk.widths, strict=True)
        )
        self.refinements = nn.ModuleList(
            nn.Sequential(*(Bottleneck(config.dim) for _ in range(config.bottlenecks)))
            for _ in config.scales
        )
        inputs, outputs = config.bev_inputs, len(config.channels)
        widths = config.bev_widths
        self.bev_encoder = (
            BEVEncoder(inputs, config.dim, widths, config.bev_blocks) if inputs else None
        )
        self.decoder: ResidualDecoder | LightDecoder
        if config.decoder == "light":
            self.decoder = LightDecoder(config.dim, outputs, widths)
        else:
            self.decoder = ResidualDecoder(config.dim, outputs, widths if inputs else None)

    def forward(self, inputs: Inputs) -> Tensor:
        """Logits of a batch.

        Args:
            inputs: ``images`` (B, N, H, W, 3) uint8, ``intrinsics`` (B, N, 3, 3), ``extrinsics``
                (B, N, 4, 4) as camera_from_ego, or (1, ...) for a rig that all samples share;
                where configured, ``route_map`` (B, S, S) uint8 and ``ground`` (B, S, S, 3) uint8.

        Returns:
            (B, channels, S, S).

        Raises:
            ValueError: An input is missing or of another size; the message names both.
        """
        self._check(inputs)
        intrinsics, extrinsics = inputs["intrinsics"].float(), inputs["extrinsics"].float()
        images = inputs["images"]  # (B, N, H, W, 3)
        if self.config.route_map == "camera":
            shown = self._shown_to_camera(inputs["route_map"]).unsqueeze(1)
            images = torch.cat([images.float(), shown], 1)
            intrinsics = torch.cat([intrinsics, intrinsics[:, -1:]], 1)
            invented = self.overhead.expand(len(extrinsics), 1, 4, 4)
            extrinsics = torch.cat([extrinsics, invented], 1)
        features = self.trunk(self._normalised(images.flatten(0, 1)))  # (B * N, F, h, w) each
        ego_from_camera = torch.linalg.inv(extrinsics)

        bev_features: tuple[Tensor, ...] = ()
        state = self.prior.expand(len(images), -1, -1, -1)  # (B, C, 24, 24)
        if self.bev_encoder is not None:
            bev_features = self.bev_encoder(self._rasters(inputs))
            state = state + bev_features[-1]
        for cross_view, refine, feature in zip(
            self.cross_views, self.refinements, features, strict=True
        ):
            state = refine(cross_view(state, feature, intrinsics, ego_from_camera))
        return self.decoder(state, bev_features)

    def _normalised(self, images: Tensor) -> Tensor:
        """Images (B, H, W, 3) in 0..255 as the trunks of ImageNet know them.

        They come out as (B, 3, H, W), channels last, as they lay in memory before: nothing is
        moved about.
        """
        floats = torch.addcmul(self.pixel_shift, images.float(), self.pixel_scale)
        return floats.permute(0, 3, 1, 2)

    def _shown_to_camera(self, route_map: Tensor) -> Tensor:
        """The route map (B, S, S) as an image (B, H, W, 3) of three equal channels."""
        image = nn.functional.interpolate(
            route_map.unsqueeze(1).float(), self.config.image_size, mode="bilinear"
        )
        return image.squeeze(1).unsqueeze(-1).expand(-1, -1, -1, 3)

    def _rasters(self, inputs: Inputs) -> Tensor:
        """Inputs in the BEV frame (B, C, S, S)."""
        rasters = []
        if self.config.route_map == "bev":
            rasters.append(inputs["route_map"].unsqueeze(1).float() / 255.0)
        if self.config.ground_skip:
            rasters.append(self._normalised(inputs["ground"]))
        return torch.cat(rasters, 1).contiguous(memory_format=torch.channels_last)

    def _check(self, inputs: Inputs) -> None:
        missing = sorted(self.needs - set(inputs))
        if missing:
            raise ValueError(
                f"this model needs {', '.join(sorted(self.needs))}; {', '.join(missing)} is missing"
            )
        images, side = inputs["images"], self.config.geometry.size
        batch, cameras = images.shape[:2]
        expected: dict[str, tuple[int, ...]] = {
            "images": (batch, cameras, *self.config.image_size, 3),
            "intrinsics": (batch, cameras, 3, 3),
            "extrinsics": (batch, cameras, 4, 4),
            "route_map": (batch, side, side),
            "ground": (batch, side, side, 3),
        }
        for name in sorted(self.needs):
            shape = tuple(inputs[name].shape)
            shared = name in RIG and shape[:1] == (1,)
            if shape[shared:] != expected[name][shared:]:
                raise ValueError(
                    f"{name} is {shape}, this model takes {expected[name]}: images of "
                    f"{self.config.image_size[0]} x {self.config.image_size[1]} pixels and a BEV "
                    f"of {side} x {side}"
                )


def overhead_pose() -> Tensor:
    """``camera_from_ego`` (4, 4) of the camera that the route map pretends to be.

    It looks straight down from 20 m, ahead upwards. No camera took the picture, so with the
    intrinsics of a real one this pose is as invented as the one that Santos et al. used.
    """
    pose = torch.tensor(
        [[0.0, -1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, OVERHEAD_M]]
    )
    return torch.cat([pose, torch.tensor([[0.0, 0.0, 0.0, 1.0]])])
