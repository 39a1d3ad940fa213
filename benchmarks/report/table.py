"""Tables as data, so that page, Markdown and CSV say the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from bev_driving_env.markdown import markdown

from .page import Markup, breakable, element

MISSING = "\N{EN DASH}"
FLAT_COLUMNS = ("table", "row", "group", "column", "value", "low", "high")
"""Of a table written a figure a line."""


@dataclass(frozen=True)
class Cell:
    """What stands in a table at one place.

    Attributes:
        value: A figure or text; None and NaN are shown as a dash.
        form: How a figure is written.
        interval: Ends of its 95 % interval, or None.
        best: Whether it is the best of those it competes with: shown in bold.
    """

    value: float | str | None
    form: str = "{:.3f}"
    interval: tuple[float, float] | None = None
    best: bool = False

    @property
    def text(self) -> str:
        """The figure without its interval."""
        if self.value is None or (isinstance(self.value, float) and not math.isfinite(self.value)):
            return MISSING
        return self.value if isinstance(self.value, str) else _written(self.value, self.form)

    @property
    def range_text(self) -> str:
        """The interval, or "" if it has none that is finite."""
        if self.interval is None or not all(math.isfinite(end) for end in self.interval):
            return ""
        low, high = (_written(end, self.form) for end in self.interval)
        return f"{low} to {high}"


@dataclass(frozen=True)
class Column:
    """A column's head.

    Attributes:
        name: What it holds.
        group: Heading over this column and its neighbours of the same group.
        elsewhere: Whether its figures are from another world and stand here for comparison.
    """

    name: str
    group: str = ""
    elsewhere: bool = False


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        name: Its name in the CSV file.
        caption: What it shows.
        columns: Heads of the columns; the first column names the rows.
        rows: A cell for each column.
        text_columns: How many columns, from the first, hold text; the others hold figures.

    Raises:
        ValueError: A row has another number of cells than there are columns.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    text_columns: int = 1

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"table {self.name!r} has {len(self.columns)} columns, but a row of {len(row)}"
                )


def _written(value: float, form: str) -> str:
    """A figure; without the sign of a zero."""
    text = form.format(value)
    return text.lstrip("-") if float(text) == 0.0 else text


def with_best(cells: Sequence[Cell], tie: float = 0.0) -> list[Cell]:
    """Mark the largest of several figures, and those that equal it; none if one is alone.

    Args:
        cells: Figures; text and what is missing does not compete.
        tie: Share of the largest that another may lack to equal it.
    """
    known = [cell.value for cell in cells if isinstance(cell.value, float | int)]
    finite = [value for value in known if math.isfinite(value)]
    if len(finite) < 2:
        return list(cells)
    least = max(finite) - tie * abs(max(finite))
    return [
        replace(cell, best=isinstance(cell.value, float | int) and cell.value >= least)
        for cell in cells
    ]


def as_html(table: Table) -> Markup:
    """The caption, and the table in a frame that scrolls sideways where a screen is narrow."""
    heads = [element("tr", _heads(table))]
    if any(column.group for column in table.columns):
        heads.insert(0, element("tr", _group_heads(table)))
    body = [element("tr", _html_row(table, row)) for row in table.rows]
    name = "".join(c if c.isalnum() else "-" for c in table.name)
    caption = element("figcaption", table.caption, id=f"table-{name}")
    # the caption is outside, so that it wraps at the screen's width; a region that scrolls must be
    # reachable by keyboard
    made = element(
        "div",
        element(
            "table",
            element("thead", heads),
            element("tbody", body),
            aria_labelledby=f"table-{name}",
        ),
        class_="scroll",
        tabindex=0,
        role="region",
        aria_label=f"Table: {table.name}",
    )
    return element("figure", caption, made, class_="table")


def as_markdown(table: Table) -> str:
    """The caption and the table; names of groups stand before those of their columns."""
    header = [f"{column.group} {column.name}".strip() for column in table.columns]
    rows = [[_markdown_cell(cell) for cell in row] for row in table.rows]
    return f"{table.caption}\n\n{markdown(header, rows, text_columns=table.text_columns)}"


def flat_rows(table: Table) -> list[dict[str, Any]]:
    """A row for each figure that is known, with ``FLAT_COLUMNS``."""
    made = []
    for row in table.rows:
        name = ", ".join(cell.text for cell in row[: table.text_columns])
        for column, cell in list(zip(table.columns, row, strict=True))[table.text_columns :]:
            if cell.text == MISSING:
                continue
            low, high = cell.interval if cell.range_text and cell.interval else (None, None)
            made.append(
                dict(
                    zip(
                        FLAT_COLUMNS,
                        (table.name, name, column.group, column.name, cell.value, low, high),
                        strict=True,
                    )
                )
            )
    return made


def _group_heads(table: Table) -> list[Markup]:
    made = []
    for (group, elsewhere), members in groupby(
        table.columns, key=lambda column: (column.group, column.elsewhere)
    ):
        span = len(list(members))
        if group:
            kind = "group elsewhere" if elsewhere else "group"
            made.append(element("th", group, colspan=span, scope="colgroup", class_=kind))
        else:
            made.append(element("td", colspan=span))
    return made


def _heads(table: Table) -> list[Markup]:
    return [
        element("th", breakable(column.name), scope="col", class_=_class(table, k))
        for k, column in enumerate(table.columns)
    ]


def _html_row(table: Table, row: Sequence[Cell]) -> list[Markup]:
    made = [element("th", breakable(row[0].text), scope="row", class_="text")]
    for k, cell in list(enumerate(row))[1:]:
        shown = element("strong", cell.text) if cell.best else cell.text
        ends = element("small", cell.range_text) if cell.range_text else None
        made.append(element("td", shown, ends, class_=_class(table, k)))
    return made


def _class(table: Table, k: int) -> str:
    kind = "text" if k < table.text_columns else "figure"
    return f"{kind} elsewhere" if table.columns[k].elsewhere else kind


def _markdown_cell(cell: Cell) -> str:
    # a pipe would end the cell
    text = cell.text.replace("|", "\\|")
    shown = f"**{text}**" if cell.best else text
    return f"{shown} ({cell.range_text})" if cell.range_text else shown
