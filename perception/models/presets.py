"""Networks by name: ``build_model("fast")``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from torch import nn

from bev_driving_env.cameras.rig import CAMERA_SIZE
from bev_driving_env.frames import CHANNELS

from .bev_unet import BEVUNet, BEVUNetConfig
from .cvt import CrossViewTransformer
from .cvt_config import FAST, PAPER, CVTConfig
from .image_unet import ImageUNet, ImageUNetConfig

Config = BEVUNetConfig | ImageUNetConfig | CVTConfig
ARCHITECTURES: dict[str, tuple[type[Any], type[nn.Module]]] = {
    "bev_unet": (BEVUNetConfig, BEVUNet),
    "image_unet": (ImageUNetConfig, ImageUNet),
    "cvt": (CVTConfig, CrossViewTransformer),
}


@dataclass(frozen=True)
class ModelSpec:
    """An architecture and its sizes: all that is needed to build a network.

    Attributes:
        architecture: One of ``ARCHITECTURES``.
        config: Of that architecture.

    Raises:
        ValueError: They do not belong together.
    """

    architecture: str
    config: Config

    def __post_init__(self) -> None:
        known = ARCHITECTURES.get(self.architecture)
        if known is None:
            raise ValueError(
                f"architecture must be one of {', '.join(ARCHITECTURES)}, got {self.architecture!r}"
            )
        if type(self.config) is not known[0]:
            raise ValueError(
                f"{self.architecture!r} takes a {known[0].__name__}, "
                f"got {type(self.config).__name__}"
            )

    @property
    def camera_size(self) -> tuple[int, int]:
        """Height and width of the images that it is trained on."""
        return getattr(self.config, "image_size", CAMERA_SIZE)

    def build(self) -> nn.Module:
        """The network, with new weights from PyTorch's random generator."""
        return ARCHITECTURES[self.architecture][1](self.config)

    def changed(self, **fields: Any) -> ModelSpec:
        """The same but for some fields of its configuration.

        Raises:
            ValueError: It has no such field, or a value is out of range.

        >>> PRESETS["fast"].changed(positions="tied").config.positions
        'tied'
        """
        config = self.as_json()["config"]
        unknown = [name for name in fields if name not in config]
        if unknown:
            raise ValueError(
                f"{self.architecture!r} has no field {unknown[0]!r}; it has {', '.join(config)}"
            )
        try:
            return ModelSpec.from_json(
                {"architecture": self.architecture, "config": {**config, **fields}}
            )
        except TypeError as error:  # say, a number where a list belongs
            raise ValueError(f"{fields} cannot be a network's: {error}") from error

    def with_channels(self, channels: tuple[str, ...]) -> ModelSpec:
        """The same for other channels of the BEV."""
        return self.changed(channels=channels)

    def as_json(self) -> dict[str, Any]:
        """The spec as JSON values; :meth:`from_json` turns them back."""
        return {"architecture": self.architecture, "config": self.config.as_json()}

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> ModelSpec:
        """The spec that :meth:`as_json` wrote.

        Raises:
            KeyError: A field is missing.
            TypeError: One is not known.
            ValueError: One has a value out of range.
        """
        architecture = str(fields["architecture"])
        if architecture not in ARCHITECTURES:
            raise ValueError(f"unknown architecture {architecture!r}")
        return cls(architecture, ARCHITECTURES[architecture][0].from_json(fields["config"]))


PRESETS: dict[str, ModelSpec] = {
    "fast": ModelSpec("cvt", FAST),
    "paper": ModelSpec("cvt", PAPER),
    "unet": ModelSpec("image_unet", ImageUNetConfig()),
    "ipm_unet": ModelSpec("bev_unet", BEVUNetConfig()),
    "blind": ModelSpec("bev_unet", BEVUNetConfig(channels=CHANNELS[:3], ground=False)),
}
"""Networks that come with the package:

* ``fast``: a Cross-View Transformer made for a laptop's processor;
* ``paper``: the published Cross-View Transformer on the BEV grid of this environment;
* ``unet``: images and route map in, BEV out, no geometry;
* ``ipm_unet``: images projected to the ground, and the route map, into a U-Net over the BEV;
* ``blind``: the route map alone, the floor for all others.
"""


def build_model(preset: str | ModelSpec) -> nn.Module:
    """Build a network.

    Args:
        preset: One of ``PRESETS``, or a spec.

    Returns:
        A module with the attributes ``needs`` (names of its inputs) and ``channels`` (names of its
        outputs), whose ``forward(inputs)`` takes a dict of batched tensors (see
        ``perception.inputs``) and returns logits (B, C, 192, 192).

    Raises:
        ValueError: There is no such preset.
    """
    return model_spec(preset).build()


def model_spec(preset: str | ModelSpec) -> ModelSpec:
    """The spec of a preset; ValueError if there is no such one."""
    if isinstance(preset, ModelSpec):
        return preset
    if preset not in PRESETS:
        raise ValueError(f"unknown preset {preset!r}; presets are: {', '.join(PRESETS)}")
    return PRESETS[preset]
