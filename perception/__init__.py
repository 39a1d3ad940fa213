"""Camera-to-BEV predictors.

Importing this package loads neither torch nor NumPy: ``bev_driving_env`` looks up names here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_driving_env.sources.protocol import BEVSource

SOURCES: dict[str, str] = {}
"""Predictors that come with the package: name, and ``"module:factory"`` of the source."""

SUFFIXES = (".pt2",)
"""Endings of the checkpoint files that :func:`load_source` reads."""


def load_source(path: str | Path) -> BEVSource:
    """Make a BEV source of a checkpoint.

    Args:
        path: A ``.pt2`` file as ``perception.exported.save_source`` writes it.

    Returns:
        The source.

    Raises:
        FileNotFoundError: No such file.
        ImportError: torch is not installed.
        ValueError: A file of another kind, or a damaged one.

    >>> load_source("weights.onnx")
    Traceback (most recent call last):
        ...
    ValueError: checkpoint 'weights.onnx' ends in '.onnx'; supported: .pt2
    """
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise ValueError(
            f"checkpoint {str(path)!r} ends in {suffix!r}; supported: {', '.join(SUFFIXES)}"
        )
    from .exported import ExportedSource

    return ExportedSource(path)
