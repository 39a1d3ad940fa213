"""EfficientNet-B4 up to stride 16.

Parameters are named as those of the package ``efficientnet_pytorch`` 0.7, so
that its published ImageNet weights load by name. Cross-View Transformers cut the network after
block 10 (0.34 of 19.3 million parameters); what a published file holds beyond that is not looked
at. Architecture: Tan and Le, "EfficientNet", ICML 2019.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

STEM = 48
FINAL_BLOCKS = {2: -1, 4: 2, 8: 6, 16: 10}
"""Block after which the feature of each stride is taken: the first of its resolution, as the
Cross-View Transformers do; -1 is the stem."""
BLOCKS_OF_B4 = 32
DROP_CONNECT = 0.2
"""Rate of skipped blocks in training that the last of all blocks would have."""
WIDTHS = {2: 48, 4: 32, 8: 56, 16: 112}
_UNREADABLE = (
    SafetensorError,
    UnpicklingError,
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    LookupError,
)


@dataclass(frozen=True)
class BlockSpec:
    """One inverted bottleneck: kernel side, stride, expansion and widths."""

    kernel: int
    stride: int
    expand: int
    width_in: int
    width_out: int


def b4_blocks() -> tuple[BlockSpec, ...]:
    """Blocks 0 to 10 of EfficientNet-B4."""
    blocks: list[BlockSpec] = []
    width = STEM
    for repeats, kernel, stride, expand, out in (
        (2, 3, 1, 1, 24),
        (4, 3, 2, 6, 32),
        (4, 5, 2, 6, 56),
        (1, 3, 2, 6, 112),
    ):
        for repeat in range(repeats):
            blocks.append(BlockSpec(kernel, 1 if repeat else stride, expand, width, out))
            width = out
    return tuple(blocks)


def _padding(kernel: int, stride: int) -> nn.Module:
    """Padding of a convolution that the published weights expect.

    TensorFlow pads right and bottom first. How much a stride of 2 needs depends on whether the
    side is even; B4's, trained at 380 pixels, is even but for the 5x5 kernel (95 pixels).
    """
    if stride == 2 and kernel == 3:
        return nn.ZeroPad2d((0, 1, 0, 1))
    return nn.ZeroPad2d(kernel // 2)


def _batch_norm(width: int) -> nn.BatchNorm2d:
    """With TensorFlow's constant and momentum, which the published weights were trained with."""
    return nn.BatchNorm2d(width, eps=1e-3, momentum=0.01)


class MBConv(nn.Module):
    """Inverted bottleneck with squeeze and excitation.

    Args:
        spec: Kernel, stride and widths.
        drop_rate: Probability that a sample skips the block in training, where it has a skip.
    """

    def __init__(self, spec: BlockSpec, drop_rate: float) -> None:
        super().__init__()
        wide = spec.width_in * spec.expand
        self.expands = spec.expand > 1
        if self.expands:
            self._expand_conv = nn.Conv2d(spec.width_in, wide, 1, bias=False)
            self._bn0 = _batch_norm(wide)
        self._pad = _padding(spec.kernel, spec.stride)
        self._depthwise_conv = nn.Conv2d(
            wide, wide, spec.kernel, spec.stride, groups=wide, bias=False
        )
        self._bn1 = _batch_norm(wide)
        squeezed = max(1, spec.width_in // 4)
        self._se_reduce = nn.Conv2d(wide, squeezed, 1)
        self._se_expand = nn.Conv2d(squeezed, wide, 1)
        self._project_conv = nn.Conv2d(wide, spec.width_out, 1, bias=False)
        self._bn2 = _batch_norm(spec.width_out)
        self.skips = spec.stride == 1 and spec.width_in == spec.width_out
        self.drop_rate = drop_rate

    def forward(self, x: Tensor) -> Tensor:
        """Features (B, width_in, H, W) to (B, width_out, H / stride, W / stride)."""
        silu = nn.functional.silu
        y = silu(self._bn0(self._expand_conv(x))) if self.expands else x
        y = silu(self._bn1(self._depthwise_conv(self._pad(y))))
        excitation = self._se_expand(silu(self._se_reduce(y.mean((2, 3), keepdim=True))))
        y = self._bn2(self._project_conv(torch.sigmoid(excitation) * y))
        if not self.skips:
            return y
        if self.training and self.drop_rate > 0.0:
            keep = 1.0 - self.drop_rate
            kept = torch.rand(len(y), 1, 1, 1, device=y.device) < keep
            y = y * (kept / keep).to(y.dtype)
        return x + y


class EfficientNetB4(nn.Module):
    """EfficientNet-B4 as far as the coarsest stride asked for.

    Args:
        strides: Which features to return, of 2, 4, 8 and 16.

    Attributes:
        widths: Channels of each.
    """

    def __init__(self, strides: Sequence[int] = (4, 16)) -> None:
        super().__init__()
        self._taps = [FINAL_BLOCKS[stride] for stride in strides]
        self.widths = tuple(WIDTHS[stride] for stride in strides)
        self._pad = _padding(3, 2)
        self._conv_stem = nn.Conv2d(3, STEM, 3, 2, bias=False)
        self._bn0 = _batch_norm(STEM)
        self._blocks = nn.ModuleList(
            MBConv(spec, DROP_CONNECT * number / BLOCKS_OF_B4)
            for number, spec in enumerate(b4_blocks()[: max(self._taps) + 1])
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """Features of normalised images (B, 3, H, W), one (B, width, H / s, W / s) per stride."""
        x = nn.functional.silu(self._bn0(self._conv_stem(self._pad(images))))
        features = {-1: x}
        for number, block in enumerate(self._blocks):
            x = block(x)
            features[number] = x
        return [features[tap] for tap in self._taps]


def load_published(trunk: EfficientNetB4, path: str | Path) -> None:
    """Load published ImageNet weights into a trunk.

    Args:
        trunk: What to fill.
        path: A ``.safetensors`` file, or what ``torch.save`` wrote (``.pth``, ``.pt``), of which
            only tensors are unpickled.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file cannot be read, or holds no weights of EfficientNet-B4 by the names
            of ``efficientnet_pytorch``; the message names the first that is missing.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        if path.suffix == ".safetensors":
            weights: Mapping[str, Tensor] = load_file(path)
        else:
            weights = torch.load(path, map_location="cpu", weights_only=True)
    except _UNREADABLE as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"{path} cannot be read as weights: {reason}") from error
    load_published_state(trunk, weights, str(path))


def load_published_state(
    trunk: EfficientNetB4, weights: Mapping[str, Tensor], source: str = "the state dict"
) -> None:
    """Load a published state dict, as :func:`load_published`; ``source`` is for messages."""
    if not isinstance(weights, Mapping):
        raise ValueError(f"{source} holds a {type(weights).__name__}, not a state dict")
    own = trunk.state_dict()
    chosen: dict[str, Tensor] = {}
    for name, value in own.items():
        if name in weights:
            chosen[name] = weights[name]
            if weights[name].shape != value.shape:
                raise ValueError(
                    f"{name} in {source} is {tuple(weights[name].shape)}, EfficientNet-B4's is "
                    f"{tuple(value.shape)}"
                )
        elif name.endswith("num_batches_tracked"):  # old files do not count batches
            chosen[name] = value
        else:
            raise ValueError(
                f"{source} lacks {name}; it must be EfficientNet-B4 by the names of the package "
                f"efficientnet_pytorch"
            )
    trunk.load_state_dict(chosen)
