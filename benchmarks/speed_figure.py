"""One measured figure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    Attributes:
        name: What was measured.
        value: The figure, the median of the rounds.
        unit: Its unit.
        target: What it should reach, as text, or "".
        met: Whether it does.
    """

    name: str
    value: float
    unit: str
    target: str = ""
    met: bool = True
