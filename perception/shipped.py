"""Predictors that come with the package; each name is a factory of its BEV source."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from . import SOURCES

if TYPE_CHECKING:
    from .predictor import ModelSource

FOLDER = Path(__file__).parent / "weights"


def shipped_path(name: str) -> Path:
    """Where the weights of a predictor lie."""
    return FOLDER / f"{name}.safetensors"


def __getattr__(name: str) -> Callable[[], ModelSource]:
    if name not in SOURCES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def make() -> ModelSource:
        from .predictor import ModelSource

        return ModelSource(shipped_path(name))

    return make
