"""Camera-to-BEV predictors: networks, losses, weights by density, metrics, training, evaluation.

Importing this package loads neither torch nor NumPy: ``bev_driving_env`` looks up names here.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bev_driving_env.sources.protocol import BEVSource
    from bev_driving_env.training.kde import kde_weights

    from .metrics import channel_iou
    from .models.presets import build_model

__all__ = ["SOURCES", "SUFFIXES", "build_model", "channel_iou", "kde_weights", "load_source"]

SHIPPED: tuple[str, ...] = (
    "cvt_kde",
    "cvt",
    "cvt_no_noise",
    "cvt_3ch",
    "unet",
    "ipm_unet",
    "ipm_unet_kde",
    "blind",
)
"""Predictors whose weights come with the package."""
SOURCES: dict[str, str] = {name: f"perception.shipped:{name}" for name in SHIPPED}
"""BEV sources that come with the package: name, and ``"module:factory"`` of the source."""

SUFFIXES = (".pt2", ".safetensors")
"""Endings of the checkpoint files that :func:`load_source` reads."""

_HOMES = {
    "build_model": "perception.models.presets",
    "channel_iou": "perception.metrics",
    "kde_weights": "bev_driving_env.training.kde",
}


def load_source(path: str | Path) -> BEVSource:
    """Make a BEV source of a checkpoint.

    Args:
        path: A ``.safetensors`` file as ``bev-perception train`` writes it, or a ``.pt2`` file as
            ``perception.exported.save_source`` does.

    Returns:
        The source.

    Raises:
        FileNotFoundError: No such file.
        ImportError: torch is not installed.
        ValueError: A file of another kind, or a damaged one.

    >>> load_source("weights.onnx")
    Traceback (most recent call last):
        ...
    ValueError: checkpoint 'weights.onnx' ends in '.onnx'; supported: .pt2, .safetensors
    """
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise ValueError(
            f"checkpoint {str(path)!r} ends in {suffix!r}; supported: {', '.join(SUFFIXES)}"
        )
    if suffix == ".safetensors":
        from .predictor import ModelSource

        return ModelSource(path)
    from .exported import ExportedSource

    return ExportedSource(path)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
