"""A report as sections of tables, figures and text, written as a page, as Markdown and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

from . import page
from .page import Content, Markup, element
from .table import FLAT_COLUMNS, Table, as_html, as_markdown, flat_rows


@dataclass(frozen=True)
class Figure:
    """A picture or chart.

    Attributes:
        picture: As HTML.
        caption: What it shows.
        file: Where the same picture lies beside the report, for Markdown; "" if nowhere.
    """

    picture: Markup
    caption: str
    file: str = ""


Block = Table | Figure | Markup | str
"""Strings are paragraphs; markup is for the page alone."""


@dataclass(frozen=True)
class Section:
    """A part with a heading.

    Attributes:
        name: Its anchor.
        heading: Its heading.
        blocks: What it holds.
    """

    name: str
    heading: str
    blocks: tuple[Block, ...]


def page_of(title: str, summary: str, sections: Sequence[Section]) -> str:
    """The whole page as HTML."""
    made = [(part.name, part.heading, [_html(block) for block in part.blocks]) for part in sections]
    return page.page(title, element("p", summary), made)


def markdown_of(title: str, summary: str, sections: Sequence[Section]) -> str:
    """The same as Markdown, without what only a page can show."""
    parts = [f"# {title}", summary]
    for part in sections:
        blocks = [text for block in part.blocks if (text := _markdown(block))]
        if blocks:
            parts += [f"## {part.heading}", *blocks]
    return "\n\n".join(parts) + "\n"


def csv_of(sections: Sequence[Section]) -> str:
    """Every figure of every table, one a line."""
    text = io.StringIO()
    writer = csv.DictWriter(text, FLAT_COLUMNS, lineterminator="\n")
    writer.writeheader()
    for part in sections:
        for block in part.blocks:
            if isinstance(block, Table):
                writer.writerows(flat_rows(block))
    return text.getvalue()


def _html(block: Block) -> Content:
    if isinstance(block, Table):
        return as_html(block)
    if isinstance(block, Figure):
        return page.figure(block.picture, block.caption)
    return block if isinstance(block, Markup) else element("p", block)


def _markdown(block: Block) -> str:
    if isinstance(block, Table):
        return as_markdown(block)
    if isinstance(block, Figure):
        return f"![{block.caption}]({block.file})" if block.file else ""
    return "" if isinstance(block, Markup) else block
