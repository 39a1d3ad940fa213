"""Axes of charts: round ticks, and where values lie on the drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .page import Markup, element

WIDTH, HEIGHT = 420, 300
"""In units of the drawing: narrow, so that text is legible where a phone shrinks it."""
LEFT, RIGHT, TOP, BOTTOM = 44, 12, 24, 42


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round values (1, 2 or 5 times a power of ten apart) that cover a range.

    Args:
        low: Least value to cover.
        high: Largest one.
        most: Intervals at most.

    >>> ticks(0.0, 97.0)
    [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]
    >>> ticks(0.83, 0.91)
    [0.82, 0.84, 0.86, 0.88, 0.9, 0.92]
    """
    if not high > low:
        low, high = low - 0.5, low + 0.5
    power = math.floor(math.log10((high - low) / most))
    for factor in (1, 2, 5, 10, 20):
        step = factor * 10.0**power
        first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
        if last - first <= most:
            break
    digits = max(0, 1 - power)
    return [round(k * step, digits) for k in range(first, last + 1)]


@dataclass(frozen=True)
class Axes:
    """A pair of axes.

    Attributes:
        x: Ticks of the horizontal axis, at least two.
        y: Ticks of the vertical one.
    """

    x: list[float]
    y: list[float]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a value lies on the drawing."""
        across = (x - self.x[0]) / (self.x[-1] - self.x[0])
        up = (y - self.y[0]) / (self.y[-1] - self.y[0])
        return (
            LEFT + across * (WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM),
        )

    def drawn(self, x_label: str, y_label: str) -> list[Markup]:
        """Grid, figures at the ticks, and what the axes mean."""
        made = []
        for value in self.x:
            x, y = self.place(value, self.y[0])
            made += [line(x, TOP, x, y), text(f"{value:g}", x, y + 16, "middle")]
        for value in self.y:
            x, y = self.place(self.x[0], value)
            made += [line(x, y, WIDTH - RIGHT, y), text(f"{value:g}", x - 6, y + 4, "end")]
        made.append(text(x_label, (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, "middle"))
        made.append(text(y_label, 4, TOP - 10, "start"))
        return made


def line(x1: float, y1: float, x2: float, y2: float, kind: str = "grid") -> Markup:
    """A line of a kind that the style sheet knows."""
    ends = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
    return element("line", class_=kind, **{k: f"{v:.1f}" for k, v in ends.items()})


def text(words: str, x: float, y: float, anchor: str) -> Markup:
    """Text with its start, middle or end at a place."""
    return element("text", words, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor)
