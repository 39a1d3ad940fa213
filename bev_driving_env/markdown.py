"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 2) -> str:
    """A Markdown table with aligned columns.

    Args:
        header: Cells of the header.
        rows: Cells of each row, as many as in the header.
        text_columns: How many columns, from the first, are aligned to the left; figures in the
            others are aligned to the right.
    """
    widths = [max(len(line[k]) for line in (header, *rows)) for k in range(len(header))]
    lines = []
    for line in (header, None, *rows):
        if line is None:
            marks = [
                "-" * width if k < text_columns else "-" * (width - 1) + ":"
                for k, width in enumerate(widths)
            ]
            lines.append("| " + " | ".join(marks) + " |")
        else:
            cells = [
                cell.ljust(width) if k < text_columns else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
