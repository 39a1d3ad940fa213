"""What a Cross-View Transformer is made of, and the two that come with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from bev_driving_env.checks import is_int
from bev_driving_env.frames import CHANNELS, BEVGeometry

from .position import FOURIER, GRIDS

COARSE = 8
"""BEV pixels per cell of the state, on a side."""
_CHOICES = {
    "trunk": ("efficientnet_b4", "small"),
    "positions": ("independent", "tied", "fourier"),
    "grids": GRIDS,
    "route_map": ("bev", "camera", "none"),
    "decoder": ("residual", "light"),
}
_LEAST_HEAD_DIM = {"independent": 1, "tied": 4, "fourier": FOURIER + 1}


@dataclass(frozen=True)
class CVTConfig:
    """What a Cross-View Transformer is made of.

    Attributes:
        image_size: Height and width of the images.
        channels: BEV channels that it predicts, names of ``bev_driving_env.frames.CHANNELS``.
        geometry: The BEV; its side must be a multiple of 16.
        trunk: ``"efficientnet_b4"`` up to stride 16, or ``"small"`` plain convolutions.
        trunk_widths: Channels of the small trunk at strides 2, 4, 8, ...
        trunk_blocks: Its residual blocks at each stride.
        scales: Strides of the features that are attended to, in this order.
        positions: Start of the positional embeddings: ``"independent"`` as published; ``"tied"``
            to the geometry; ``"fourier"``, tied, of a Fourier code of the viewing direction.
        grids: ``"endpoints"``, as published, lays pixels and cells out from edge to edge;
            ``"centres"`` puts them where convolutions and pixel shuffles have them.
        route_map: ``"bev"`` fuses the route map in its own frame, into query and decoder;
            ``"camera"`` shows it to the trunk as one more image, with the last camera's
            intrinsics and an invented pose, as the CVT of Santos et al. (2025) has it;
            ``"none"`` does without.
        ground_skip: Whether images projected to the ground join in the BEV frame, as the route
            map does with ``"bev"``. A network with this sees more than a pure CVT.
        decoder: ``"residual"`` as published, or ``"light"``.
        bev_widths: Channels of features at a half and a quarter of the BEV's side: of the inputs
            in the BEV frame, and in the light decoder.
        bev_blocks: Residual blocks that the inputs in the BEV frame pass at a quarter.
        dim: Channels of the BEV state.
        heads: Heads of the attention, of ``dim / heads`` channels each.
        bottlenecks: ResNet bottlenecks after each cross-view attention.

    Raises:
        ValueError: A value is out of range; the message names it.
    """

    image_size: tuple[int, int] = (224, 480)
    channels: tuple[str, ...] = CHANNELS
    geometry: BEVGeometry = field(default_factory=BEVGeometry)
    trunk: str = "efficientnet_b4"
    trunk_widths: tuple[int, ...] = (24, 48, 96, 128)
    trunk_blocks: tuple[int, ...] = (0, 1, 1, 1)
    scales: tuple[int, ...] = (4, 16)
    positions: str = "independent"
    grids: str = "endpoints"
    route_map: str = "camera"
    ground_skip: bool = False
    decoder: str = "residual"
    bev_widths: tuple[int, int] = (32, 64)
    bev_blocks: int = 1
    dim: int = 128
    heads: int = 4
    bottlenecks: int = 2

    def __post_init__(self) -> None:
        tuples = ("image_size", "channels", "trunk_widths", "trunk_blocks", "scales", "bev_widths")
        for name in tuples:
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name, known in _CHOICES.items():
            if getattr(self, name) not in known:
                raise ValueError(f"{name} must be one of {known}, got {getattr(self, name)!r}")
        unknown = [name for name in self.channels if name not in CHANNELS]
        if unknown or not self.channels or len(set(self.channels)) < len(self.channels):
            raise ValueError(
                f"channels must be different names of {CHANNELS}, at least one, "
                f"got {self.channels!r}"
            )
        self._check_numbers()
        self._check_sides()

    def _check_numbers(self) -> None:
        least = {"dim": 4, "heads": 1, "bottlenecks": 0, "bev_blocks": 0}
        for name, low in least.items():
            if not (is_int(getattr(self, name)) and getattr(self, name) >= low):
                raise ValueError(f"{name} must be an int >= {low}, got {getattr(self, name)!r}")
        if self.dim % self.heads or self.dim % 4:
            raise ValueError(
                f"dim must be a multiple of heads ({self.heads}) and of 4, got {self.dim}"
            )
        if self.head_dim < _LEAST_HEAD_DIM[self.positions]:
            raise ValueError(
                f"{self.positions!r} positions need at least {_LEAST_HEAD_DIM[self.positions]} "
                f"channels per head, got dim {self.dim} / heads {self.heads} = {self.head_dim}"
            )
        if len(self.trunk_widths) != len(self.trunk_blocks):
            raise ValueError(
                f"trunk_blocks {self.trunk_blocks} must be as many as trunk_widths "
                f"{self.trunk_widths}"
            )
        if len(self.bev_widths) != 2:
            raise ValueError(f"bev_widths must be two, got {self.bev_widths}")
        for name in ("trunk_widths", "bev_widths"):
            widths = getattr(self, name)
            if not all(is_int(width) and width > 0 for width in widths):
                raise ValueError(f"{name} must be positive ints, got {widths}")
        if not all(is_int(count) and count >= 0 for count in self.trunk_blocks):
            raise ValueError(f"trunk_blocks must be ints from 0 on, got {self.trunk_blocks}")

    def _check_sides(self) -> None:
        stages = len(self.trunk_widths) if self.trunk == "small" else 4
        strides = [2 ** (stage + 1) for stage in range(stages)]
        if not (self.scales and all(scale in strides for scale in self.scales)):
            raise ValueError(f"scales must be strides of the trunk, {strides}, got {self.scales}")
        multiple = max(self.scales)
        sides = self.image_size
        if len(sides) != 2 or not all(is_int(s) and s > 0 and s % multiple == 0 for s in sides):
            raise ValueError(
                f"image_size must be (height, width), multiples of the coarsest scale {multiple}, "
                f"got {sides}"
            )
        if self.geometry.size % (2 * COARSE):
            raise ValueError(f"BEV size must be a multiple of 16, got {self.geometry.size}")

    @property
    def head_dim(self) -> int:
        """Channels of each head."""
        return self.dim // self.heads

    @property
    def cells(self) -> int:
        """Side of the BEV state."""
        return self.geometry.size // COARSE

    @property
    def bev_inputs(self) -> int:
        """Channels of the inputs in the BEV frame."""
        return (self.route_map == "bev") + 3 * self.ground_skip

    def as_json(self) -> dict[str, Any]:
        """The fields as JSON values; :meth:`from_json` turns them back."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> CVTConfig:
        """The configuration that :meth:`as_json` wrote; TypeError for fields of another kind."""
        return cls(**{**fields, "geometry": BEVGeometry(**fields["geometry"])})


PAPER = CVTConfig()
"""As published, on our BEV: EfficientNet-B4, 224 x 480, the route map as a fake camera."""

FAST = CVTConfig(
    image_size=(112, 240),
    trunk="small",
    trunk_widths=(16, 32, 64),
    trunk_blocks=(0, 1, 2),
    scales=(8,),
    positions="fourier",
    grids="centres",
    route_map="bev",
    decoder="light",
    bev_widths=(24, 48),
    bev_blocks=0,
)
"""What the measurements support for a CPU, and still a cross-view transformer."""
