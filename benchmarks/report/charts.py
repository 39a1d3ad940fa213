"""Charts as SVG: sharp at any size, a few kilobytes each, and read out by their titles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..maps import PALETTE
from .page import Markup, element

WIDTH, HEIGHT = 640, 400
LEFT, BOTTOM, TOP, RIGHT = 56, 48, 16, 16
TICKS = 5


@dataclass(frozen=True)
class Point:
    """A mark in a scatter plot.

    Attributes:
        x: Horizontal value.
        y: Vertical value.
        group: What it belongs to: its colour, named in the legend.
        title: What it is, shown when it is pointed at.
    """

    x: float
    y: float
    group: str
    title: str


def scatter(
    points: Sequence[Point], x_label: str, y_label: str, x_range: tuple[float, float] | None = None
) -> Markup:
    """A scatter plot; the vertical axis starts at 0."""
    groups = list(dict.fromkeys(point.group for point in points))
    xs = [point.x for point in points]
    low, high = x_range or (min(xs, default=0.0), max(xs, default=1.0))
    top = max([point.y for point in points], default=1.0) or 1.0

    def place(x: float, y: float) -> tuple[float, float]:
        share = (x - low) / (high - low) if high > low else 0.5
        across = LEFT + share * (WIDTH - LEFT - RIGHT)
        return across, HEIGHT - BOTTOM - y / top * (HEIGHT - TOP - BOTTOM)

    marks = []
    for point in points:
        x, y = place(point.x, point.y)
        mark = element("title", point.title)
        colour = colour_of(groups.index(point.group))
        marks.append(element("circle", mark, cx=f"{x:.1f}", cy=f"{y:.1f}", r=6, fill=colour))
    axes = []
    for k in range(TICKS + 1):
        share = k / TICKS
        x, _ = place(low + share * (high - low), 0.0)
        _, y = place(low, share * top)
        axes += [
            _text(f"{low + share * (high - low):.2f}", x, HEIGHT - BOTTOM + 18, "middle"),
            _text(f"{share * top:.0f}", LEFT - 8, y + 4, "end"),
            element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=f"{y:.1f}", y2=f"{y:.1f}", class_="grid"),
        ]
    axes += [
        _text(x_label, (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, "middle"),
        _text(y_label, LEFT, TOP - 4, "start"),
    ]
    return element("div", _svg(axes + marks, f"{y_label} against {x_label}"), legend(groups))


def stacked_bars(
    rows: Mapping[str, Mapping[str, float]], parts: Sequence[str], unit: str
) -> Markup:
    """A bar a row, made of its parts; parts below 0 are drawn to the left of the axis.

    Args:
        rows: Values of the parts by row.
        parts: Their names, in order: the legend.
        unit: Of the values.
    """
    positive = [sum(max(values[name], 0.0) for name in parts) for values in rows.values()]
    negative = [sum(min(values[name], 0.0) for name in parts) for values in rows.values()]
    most, least = max(positive, default=1.0) or 1.0, min(negative, default=0.0)
    left, height, step = 200.0, 26, 34
    scale = (WIDTH - left - RIGHT) / (most - least)
    drawn = []
    for k, (name, values) in enumerate(rows.items()):
        y = TOP + k * step
        drawn.append(_text(name, left - 8, y + 18, "end"))
        ends = {True: left - least * scale, False: left - least * scale}
        for number, part in enumerate(parts):
            value, forwards = values[part], values[part] >= 0.0
            width = abs(value) * scale
            x = ends[forwards] if forwards else ends[forwards] - width
            ends[forwards] += width if forwards else -width
            title = element("title", f"{name}, {part}: {value:.0f} {unit}")
            drawn.append(
                element(
                    "rect",
                    title,
                    x=f"{x:.1f}",
                    y=y,
                    width=f"{width:.1f}",
                    height=height,
                    fill=colour_of(number),
                )
            )
    total = TOP + len(rows) * step + 8
    return element("div", _svg(drawn, f"Bars, {unit}", total), legend(parts))


def legend(names: Sequence[str]) -> Markup:
    """Colours and their names."""
    entries = [
        element("li", element("span", style=f"background:{colour_of(k)}"), name)
        for k, name in enumerate(names)
    ]
    return element("ul", entries, class_="legend")


def colour_of(number: int) -> str:
    """A colour that can be told from its neighbours, by colour-blind readers too."""
    red, green, blue = PALETTE[number % len(PALETTE)]
    return f"#{red:02x}{green:02x}{blue:02x}"


def _svg(content: Sequence[Markup], title: str, height: float = HEIGHT) -> Markup:
    box = f"0 0 {WIDTH} {height:g}"
    return element("svg", element("title", title), content, viewBox=box, role="img")


def _text(text: str, x: float, y: float, anchor: str) -> Markup:
    return element("text", text, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor)


def line_chart(
    lines: Mapping[str, Sequence[tuple[float, float]]], x_label: str, y_label: str
) -> Markup:
    """Lines through points, from 0 to the largest value on both axes.

    Args:
        lines: Points (x, y) of each line by its name, in the order of x.
        x_label: Below.
        y_label: Above.
    """
    points = [point for line in lines.values() for point in line]
    right = max((x for x, _ in points), default=1.0) or 1.0
    top = max((y for _, y in points), default=1.0) or 1.0

    def place(x: float, y: float) -> tuple[float, float]:
        across = LEFT + x / right * (WIDTH - LEFT - RIGHT)
        return across, HEIGHT - BOTTOM - y / top * (HEIGHT - TOP - BOTTOM)

    drawn = []
    for k in range(TICKS + 1):
        (x, _), (_, y) = place(k / TICKS * right, 0.0), place(0.0, k / TICKS * top)
        drawn += [
            _text(f"{k / TICKS * right:.2g}", x, HEIGHT - BOTTOM + 18, "middle"),
            _text(f"{k / TICKS * top:.0f}", LEFT - 8, y + 4, "end"),
            element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=f"{y:.1f}", y2=f"{y:.1f}", class_="grid"),
        ]
    drawn += [
        _text(x_label, (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, "middle"),
        _text(y_label, LEFT, TOP - 4, "start"),
    ]
    for number, (name, line) in enumerate(lines.items()):
        # colours come again after a while: dashes tell those lines from the first ones
        dashes = "6 4" if number >= len(PALETTE) else None
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*point) for point in line))
        drawn.append(
            element(
                "polyline",
                points=path,
                fill="none",
                stroke=colour_of(number),
                stroke_width=2,
                stroke_dasharray=dashes,
            )
        )
        for x, y in line:
            across, up = place(x, y)
            title = element("title", f"{name}, {x:g}: {y:.0f}")
            mark = {"cx": f"{across:.1f}", "cy": f"{up:.1f}", "fill": colour_of(number)}
            drawn.append(element("circle", title, r=4, **mark))
    return element("div", _svg(drawn, f"{y_label} against {x_label}"), legend(list(lines)))
