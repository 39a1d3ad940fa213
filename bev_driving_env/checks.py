"""Checks of numbers and configuration objects that come from users."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from numbers import Integral, Real
from typing import Any


def is_number(value: object) -> bool:
    """Whether a value is a finite real number, NumPy's included, and not a bool."""
    return type(value) is not bool and isinstance(value, Real) and math.isfinite(value)


def is_int(value: object) -> bool:
    """Whether a value is an integer, NumPy's included, and not a bool."""
    return type(value) is not bool and isinstance(value, Integral)


def require_positive(name: str, value: Any) -> None:
    """Raise a ``ValueError`` that names the value unless it is a positive finite number."""
    if not (is_number(value) and value > 0.0):
        raise ValueError(f"{name} must be a positive number, got {value!r}")


def require_count(name: str, value: Any) -> None:
    """Raise a ``ValueError`` that names the value unless it is an int of at least 1."""
    if not (is_int(value) and value >= 1):
        raise ValueError(f"{name} must be an int of at least 1, got {value!r}")


def configured(kind: type, value: Any) -> Any:
    """Make a configuration dataclass of a mapping of its fields; leave a ready one alone.

    Raises:
        ValueError: It is neither, or has a field that does not exist.
    """
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"expected {kind.__name__} or a mapping of its fields, got {value!r}")
    names = [item.name for item in fields(kind)]
    for name in value:
        if name not in names:
            raise ValueError(f"{kind.__name__} has no {name!r}; fields: {', '.join(names)}")
    return kind(**value)
