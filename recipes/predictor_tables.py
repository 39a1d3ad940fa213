"""Writes what ``recipes/evaluate.sh`` measured into the tables of docs/predictors.md.

    python recipes/predictor_tables.py runs/eval_*/evaluation.json

A table stands between ``<!-- iou: LOG APPEARANCE -->`` (``... leaks`` for that of changed frames)
and ``<!-- end -->``. Predictors that were not evaluated are an error: a page of old and new figures
would not be seen to be one.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from evaluations import FIGURES, Row, read_rows

import perception
from bev_driving_env.files import write_text
from bev_driving_env.markdown import markdown
from perception.evaluation_frames import CHANGES

PAGE = Path(__file__).parents[1] / "docs" / "predictors.md"
TABLE = re.compile(r"(<!-- iou: (\S+) (\S+)(?: (leaks))? -->\n\n).*?(\n<!-- end -->)", re.DOTALL)
ROWS = (*perception.SHIPPED, "ipm")
LEAKING = ("cvt_kde", "ipm_unet_kde", "blind")


def filled(page: str, rows: Sequence[Row]) -> str:
    """The page with its tables made anew.

    Raises:
        ValueError: It has no tables, or a row is missing.
    """
    if not TABLE.search(page):
        raise ValueError("the page has no <!-- iou: LOG APPEARANCE --> ... <!-- end -->")

    def table(match: re.Match[str]) -> str:
        begin, log, appearance, leaks, end = match.groups()
        here = {
            (row.source, row.change): row
            for row in rows
            if (row.log, row.appearance, row.leaks) == (log, appearance, bool(leaks))
        }
        wanted = (
            [(source, change) for source in LEAKING for change in CHANGES]
            if leaks
            else [(source, "none") for source in ROWS]
        )
        missing = [
            f"{source} ({change})" for source, change in wanted if (source, change) not in here
        ]
        if missing:
            raise ValueError(f"no evaluation on {log}, {appearance} looks, of {', '.join(missing)}")
        cells = [[_name(*key), *here[key].figures] for key in wanted]
        return f"{begin}{markdown(['Predictor', *FIGURES], cells, text_columns=1)}\n{end}"

    return TABLE.sub(table, page)


def _name(source: str, change: str) -> str:
    return f"`{source}`, {CHANGES[change]}" if CHANGES[change] else f"`{source}`"


def main() -> None:
    """Fill the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("evaluations", nargs="+", type=Path, metavar="evaluation.json")
    rows = read_rows(parser.parse_args().evaluations)
    write_text(PAGE, filled(PAGE.read_text("utf-8"), rows))


if __name__ == "__main__":
    main()
