from __future__ import annotations

import csv
import io
import math

import pytest

from benchmarks.report.document import Section, csv_of, markdown_of, page_of
from benchmarks.report.table import Cell, Column, Table, as_html, as_markdown, flat_rows, with_best


@pytest.fixture
def table() -> Table:
    columns = (Column("System"), Column("Route (m)", "Here"), Column("IoU", "There", True))
    rows = (
        (Cell("a|b <i>"), Cell(105.6, "{:.0f}", (94.2, 130.0)), Cell(None)),
        (Cell("c"), Cell(20.0, "{:.0f}", (math.nan, math.nan), best=True), Cell(math.nan)),
    )
    return Table("routes", "What & where.", columns, rows)


def test_figures_are_written_in_their_form_and_what_is_unknown_as_a_dash():
    shown = [Cell(0.12345), Cell(7.0, "{:.0f}"), Cell("5/5"), Cell(None), Cell(math.nan)]
    assert [cell.text for cell in shown] == ["0.123", "7", "5/5", "\u2013", "\u2013"]


def test_a_zero_has_no_sign():
    assert Cell(-0.3, "{:.0f}").text == "0"
    assert Cell(-0.6, "{:.0f}").text == "-1"


def test_markdown_has_groups_before_columns_intervals_in_brackets_and_the_best_in_bold(table):
    lines = as_markdown(table).splitlines()
    assert lines[0] == "What & where."
    cells = [[cell.strip() for cell in line.split(" | ")] for line in lines[2:]]
    assert cells[0] == ["| System", "Here Route (m)", "There IoU |"]
    assert cells[2] == ["| a\\|b <i>", "106 (94 to 130)", "\u2013 |"]
    assert cells[3] == ["| c", "**20**", "\u2013 |"]


def test_html_escapes_names_and_has_the_same_figures_as_markdown(table):
    made = as_html(table)
    assert "a|<wbr>b &lt;i&gt;" in made
    assert "106<small>94 to 130</small>" in made
    assert "<strong>20</strong>" in made
    assert 'colspan="1" scope="colgroup" class="group elsewhere"' in made
    assert 'tabindex="0"' in made


def test_flat_rows_hold_every_known_figure_at_full_precision(table):
    assert flat_rows(table) == [
        {
            "table": "routes",
            "row": "a|b <i>",
            "group": "Here",
            "column": "Route (m)",
            "value": 105.6,
            "low": 94.2,
            "high": 130.0,
        },
        {
            "table": "routes",
            "row": "c",
            "group": "Here",
            "column": "Route (m)",
            "value": 20.0,
            "low": None,
            "high": None,
        },
    ]


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="2 columns, but a row of 1"):
        Table("t", "c", (Column("a"), Column("b")), ((Cell(1.0),),))


def test_the_largest_is_best_all_of_them_if_equal_and_none_if_alone():
    assert [c.best for c in with_best([Cell(0.1), Cell(0.3), Cell(math.nan), Cell("x")])] == [
        False,
        True,
        False,
        False,
    ]
    assert [c.best for c in with_best([Cell(0.3), Cell(0.3)])] == [True, True]
    assert [c.best for c in with_best([Cell(0.3), Cell(None)])] == [False, False]


def test_page_markdown_and_csv_are_made_from_the_same_tables(table):
    sections = [Section("one", "One", (table, "A paragraph."))]
    rows = list(csv.DictReader(io.StringIO(csv_of(sections))))
    assert [row["value"] for row in rows] == ["105.6", "20.0"]
    for text in (page_of("T", "S", sections), markdown_of("T", "S", sections)):
        assert "106" in text
        assert "A paragraph." in text
