"""Measured IoU goes into the page of predictors and into model cards, and nothing is made up."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import pytest

import perception

ROOT = Path(__file__).parents[2]
CHANGES = ("none", "black", "other_images", "no_map", "other_map")


@pytest.fixture(scope="module")
def scripts():
    """The modules of recipes/ by name."""
    folder = str(ROOT / "recipes")
    sys.path.insert(0, folder)
    try:
        names = ("evaluations", "predictor_tables", "model_cards")
        yield {name: importlib.import_module(name) for name in names}
    finally:
        sys.path.remove(folder)


def evaluation(path, sources, value, *, log="town02_dense", looks="test", changes=("none",)):
    """A file such as ``bev-perception evaluate`` writes, with one IoU for everything."""
    results, iou = [], []
    for source in sources:
        for change in changes:
            place = {"log": f"data/{log}", "split": "all", "source": source}
            place |= {"appearance": looks, "change": change}
            results.append({**place, "turns": {"iou": value, "under_50": 0.25}})
            common = {**place, "band": "all", "iou": value}
            iou += [
                {**common, "place": "all", "channel": "road"},
                {**common, "place": "all", "channel": "road", "band": "0-10 m", "iou": 0.0},
                {**common, "place": "critical", "channel": "route"},
            ]
    path.write_text(json.dumps({"results": results, "iou": iou}), "utf-8")
    return path


def test_a_row_has_each_channel_critical_places_and_turns(scripts, tmp_path):
    file = evaluation(tmp_path / "a.json", ["mine"], 0.5)
    (row,) = scripts["evaluations"].read_rows([file])
    assert (row.source, row.log, row.appearance, row.change) == (
        *("mine", "town02_dense", "test", "none"),
    )
    assert row.figures == ("0.500", *["-"] * 5, "0.500", "0.500", "25.0 %")


def test_what_a_later_file_says_takes_the_place_of_the_earlier(scripts, tmp_path):
    old = evaluation(tmp_path / "old.json", ["mine", "theirs"], 0.5)
    new = evaluation(tmp_path / "new.json", ["mine"], 0.75)
    rows = scripts["evaluations"].read_rows([old, new])
    assert {row.source: row.figures[0] for row in rows} == {"mine": "0.750", "theirs": "0.500"}


def test_tables_are_filled_between_their_marks_and_again(scripts, tmp_path):
    fill = scripts["predictor_tables"]
    page = "Before\n\n<!-- iou: town02_dense test -->\n\nold\n\n<!-- end -->\n\nbetween\n\n"
    page += "<!-- iou: town02_dense test leaks -->\n\n\n<!-- end -->\n\nafter\n"
    files = [
        evaluation(tmp_path / "all.json", fill.ROWS, 0.25),
        evaluation(tmp_path / "leaks.json", fill.LEAKING, 0.75, changes=CHANGES),
        evaluation(tmp_path / "hard.json", fill.ROWS, 0.9, looks="hard"),
    ]
    once = fill.filled(page, scripts["evaluations"].read_rows(files))
    first, second = once.split("between")
    assert first.startswith("Before\n\n<!-- iou: town02_dense test -->\n\n| Predictor")
    assert first.count("0.250") == 3 * len(fill.ROWS)
    assert second.count("0.750") == 3 * len(fill.LEAKING) * len(CHANGES)
    assert "`cvt_kde`, black cameras" in second
    assert "old" not in once
    assert once.endswith("|\n\n<!-- end -->\n\nafter\n")
    assert fill.filled(once, scripts["evaluations"].read_rows(files)) == once


def test_a_predictor_without_figures_is_named(scripts, tmp_path):
    fill = scripts["predictor_tables"]
    page = "<!-- iou: town02_dense test -->\n\n\n<!-- end -->\n"
    rows = scripts["evaluations"].read_rows([evaluation(tmp_path / "a.json", fill.ROWS[1:], 0.5)])
    with pytest.raises(ValueError, match=r"no evaluation on town02_dense, test looks, of cvt_kde"):
        fill.filled(page, rows)
    with pytest.raises(ValueError, match="the page has no <!-- iou"):
        fill.filled("no table", rows)


def test_the_page_of_predictors_has_a_table_of_every_evaluation_of_the_recipe(scripts):
    page = (ROOT / "docs" / "predictors.md").read_text("utf-8")
    tables = scripts["predictor_tables"].TABLE.finditer(page)
    found = {" ".join(filter(None, table.groups()[1:4])) for table in tables}
    assert found == {
        *("town02_dense test", "town02_light test", "town02_dense hard", "town01_dense train"),
        "town02_dense test leaks",
    }


def test_a_card_shows_the_rows_of_its_predictor(scripts, tmp_path):
    files = [
        evaluation(tmp_path / "a.json", ["blind", "cvt"], 0.125),
        evaluation(tmp_path / "leaks.json", ["blind"], 0.875, changes=CHANGES),
    ]
    text = scripts["model_cards"].card_text("blind", scripts["evaluations"].read_rows(files))
    assert text.count("| `town02_dense` |") == 1
    assert "0.125" in text
    assert "0.875" not in text
    assert set(scripts["model_cards"].ABOUT) == set(perception.SHIPPED)
