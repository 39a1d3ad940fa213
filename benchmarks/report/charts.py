"""Charts as SVG: sharp at any size, a few kilobytes each, and described in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from bev_driving_env.render import Colour

from ..maps import PALETTE
from .axes import HEIGHT, RIGHT, TOP, WIDTH, Axes, line, text, ticks
from .drivers import Driver, labels
from .page import Markup, element

SHAPES = ("circle", "square", "diamond", "triangle")
BAR_STEP = 48
BAR_HEIGHT = 20
MARK_SIZE = 6


@dataclass(frozen=True)
class Point:
    """A mark in a scatter plot.

    Attributes:
        x: Horizontal value.
        y: Vertical value.
        group: What it belongs to, named in the legend.
        title: What it is, shown when it is pointed at.
        colour: Number of its colour, of :func:`colour_of`.
        shape: One of ``SHAPES``.
    """

    x: float
    y: float
    group: str
    title: str
    colour: int
    shape: str = "circle"


def scatter(points: Sequence[Point], x_label: str, y_label: str) -> Markup:
    """A scatter plot; the vertical axis starts at 0."""
    xs = [point.x for point in points]
    axes = Axes(
        ticks(min(xs, default=0.0), max(xs, default=1.0)),
        ticks(0.0, max([point.y for point in points], default=1.0) or 1.0),
    )
    marks = [
        _mark(point.shape, *axes.place(point.x, point.y), colour_of(point.colour), point.title)
        for point in points
    ]
    words = f"{y_label} against {x_label}. " + "; ".join(point.title for point in points)
    return element(
        "div",
        svg([*axes.drawn(x_label, y_label), *marks], words),
        legend({point.group: colour_of(point.colour) for point in points}),
    )


def line_chart(
    lines: Mapping[str, Sequence[tuple[float, float]]], x_label: str, y_label: str
) -> Markup:
    """Lines through points; both axes start at 0.

    Args:
        lines: Points (x, y) of each line by its name, in the order of x.
        x_label: Below.
        y_label: Above.
    """
    points = [point for drawn in lines.values() for point in drawn]
    axes = Axes(
        ticks(0.0, max((x for x, _ in points), default=1.0) or 1.0),
        ticks(0.0, max((y for _, y in points), default=1.0) or 1.0),
    )
    drawn = axes.drawn(x_label, y_label)
    for number, (name, values) in enumerate(lines.items()):
        places = [axes.place(*point) for point in values]
        colour = colour_of(number)
        # colours come again after a while: dashes tell those lines from the first ones
        dashes = "6 4" if number >= len(PALETTE) else None
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        drawn.append(
            element(
                "polyline",
                points=corners,
                fill="none",
                stroke=colour,
                stroke_width=2,
                stroke_dasharray=dashes,
            )
        )
        for (x, y), place in zip(values, places, strict=True):
            drawn.append(_mark("circle", *place, colour, f"{name}, {x:g}: {y:.0f}"))
    colours = {name: colour_of(number) for number, name in enumerate(lines)}
    return element("div", svg(drawn, f"{y_label} against {x_label}"), legend(colours))


def stacked_bars(
    rows: Mapping[str, Mapping[str, float]], parts: Sequence[str], unit: str
) -> Markup:
    """A bar a row, made of its parts; parts below 0 are drawn to the left of the axis.

    Args:
        rows: Values of the parts by row; missing ones are 0.
        parts: Their names, in order: the legend.
        unit: Of the values.
    """
    values = {name: [row.get(part, 0.0) for part in parts] for name, row in rows.items()}
    least = min([sum(min(v, 0.0) for v in row) for row in values.values()], default=0.0)
    most = max([sum(max(v, 0.0) for v in row) for row in values.values()], default=0.0)
    marks = ticks(least, most or 1.0)
    scale = (WIDTH - 2 * RIGHT) / (marks[-1] - marks[0])

    def across(value: float) -> float:
        return RIGHT + (value - marks[0]) * scale

    bottom = TOP + len(values) * BAR_STEP
    drawn = [line(across(mark), TOP, across(mark), bottom) for mark in marks]
    drawn += [text(f"{mark:g}", across(mark), bottom + 15, "middle") for mark in marks]
    for k, (name, row) in enumerate(values.items()):
        y = TOP + k * BAR_STEP
        drawn.append(text(f"{name}: {sum(row):.0f} {unit}", across(marks[0]), y + 14, "start"))
        drawn += _bar(row, parts, across, y + 20, unit)
    drawn.append(line(across(0.0), TOP, across(0.0), bottom, "axis"))
    words = "; ".join(
        f"{name}: " + ", ".join(f"{p} {v:.0f}" for p, v in zip(parts, row, strict=True))
        for name, row in values.items()
    )
    colours = {part: colour_of(k) for k, part in enumerate(parts)}
    return element("div", svg(drawn, f"Bars in {unit}. {words}", bottom + 22), legend(colours))


def _bar(
    values: Sequence[float],
    parts: Sequence[str],
    across: Callable[[float], float],
    y: float,
    unit: str,
) -> list[Markup]:
    """The parts of one bar, from the axis outwards."""
    made = []
    above = below = 0.0
    for k, (part, value) in enumerate(zip(parts, values, strict=True)):
        start = above if value >= 0.0 else below + value
        above, below = above + max(value, 0.0), below + min(value, 0.0)
        made.append(
            element(
                "rect",
                element("title", f"{part}: {value:.0f} {unit}"),
                x=f"{across(start):.1f}",
                y=f"{y:.1f}",
                width=f"{across(start + abs(value)) - across(start):.1f}",
                height=BAR_HEIGHT,
                fill=colour_of(k),
            )
        )
    return made


def _mark(shape: str, x: float, y: float, colour: str, title: str) -> Markup:
    """A mark with its middle at a place."""
    r = MARK_SIZE
    words = element("title", title)
    if shape == "circle":
        return element("circle", words, cx=f"{x:.1f}", cy=f"{y:.1f}", r=r, fill=colour)
    corners = {
        "square": ((-r, -r), (r, -r), (r, r), (-r, r)),
        "diamond": ((0, -r - 2), (r + 2, 0), (0, r + 2), (-r - 2, 0)),
        "triangle": ((0, -r - 1), (r + 1, r), (-r - 1, r)),
    }[shape]
    points = " ".join(f"{x + dx:.1f},{y + dy:.1f}" for dx, dy in corners)
    return element("polygon", words, points=points, fill=colour)


def legend(colours: Mapping[str, str]) -> Markup:
    """Names and their colours."""
    entries = [
        element("li", element("span", style=f"background:{colour}"), name)
        for name, colour in colours.items()
    ]
    return element("ul", entries, class_="legend")


def driver_legend(drivers: Iterable[Driver]) -> Markup:
    """Drivers in the colours that they have in every chart and map."""
    names = labels(drivers)
    return legend({name: colour_of(k) for k, name in enumerate(names.values())})


def colour_of(number: int) -> str:
    """A colour that can be told from its neighbours, by colour-blind readers too."""
    return hex_of(PALETTE[number % len(PALETTE)])


def hex_of(colour: Colour) -> str:
    """A colour as CSS writes it.

    >>> hex_of((213, 94, 0))
    '#d55e00'
    """
    red, green, blue = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


def svg(content: Sequence[Markup], words: str, height: float = HEIGHT) -> Markup:
    """A drawing, described in words for those who cannot see it."""
    box = f"0 0 {WIDTH} {height:g}"
    return element("svg", content, viewBox=box, role="img", aria_label=words)
