"""Network weights on disk: safetensors in half precision, of which loading executes nothing.

A file says in its header what kind of network it holds, in which version of the format, and
whatever else its owner needs to build the network and to know where it came from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as as_safetensors
from torch import Tensor

from .files import write_bytes


class WeightsError(ValueError):
    """A file that does not hold the weights that were asked for."""


def write_weights(
    path: Path, kind: str, version: int, header: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Write weights in half precision; an interruption leaves no half file.

    Args:
        path: Where to, by custom ``NAME.safetensors``.
        kind: Key of the header, such as ``"bevtown_policy"``.
        version: Of the header.
        header: Anything that JSON can hold.
        tensors: The weights by name; those of whole numbers are kept as they are, those that half
            precision cannot hold, such as a large variance, in single precision.

    Raises:
        ValueError: A weight is not finite.
        TypeError: The header holds something that JSON cannot.
    """
    halves: dict[str, Tensor] = {}
    for name, value in tensors.items():
        kept = value.detach().cpu().contiguous()
        if kept.is_floating_point():
            if not torch.isfinite(kept).all():
                raise ValueError(f"{name} holds values that are not finite")
            half = kept.to(torch.float16)
            kept = half if torch.isfinite(half).all() else kept.to(torch.float32)
        halves[name] = kept
    text = json.dumps({"version": version, **header}, allow_nan=False)
    write_bytes(path, as_safetensors(halves, metadata={kind: text}))


def read_weights_header(path: Path, kind: str, version: int) -> dict[str, Any]:
    """What a file says about itself.

    Args:
        path: The file.
        kind: That it must be of.
        version: Newest one that is understood.

    Raises:
        FileNotFoundError: There is no such file.
        WeightsError: It is damaged, of another kind, or of a newer version.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path} is damaged or no safetensors file: {error}") from error
    if kind not in metadata:
        held = ", ".join(sorted(key for key in metadata if key.startswith("bevtown_")))
        what = f"holds a {held}" if held else "was not written by BEVTown"
        raise WeightsError(f"{path} is no {kind}: it is a safetensors file that {what}")
    try:
        header = dict(json.loads(metadata[kind]))
        found = int(header["version"])
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"{path} has a header that cannot be read: {error!r}") from error
    if found > version:
        raise WeightsError(
            f"{path} is of version {found}, this BEVTown reads up to {version}: update BEVTown"
        )
    return header


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a file by name, in single precision.

    Raises:
        WeightsError: The file is damaged.
    """
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path} is damaged or no safetensors file: {error}") from error
    return {
        name: value.float() if value.is_floating_point() else value
        for name, value in tensors.items()
    }
