from __future__ import annotations

from typing import Any

import pytest

from benchmarks.report.open_loop import open_loop_tables


def row(source: str, channel: str, iou: float | None, **changes: object) -> dict[str, Any]:
    made = {
        "log": "data/town02",
        "town": "Town02",
        "split": "all",
        "appearance": "test",
        "source": source,
        "change": "none",
        "place": "all",
        "band": "all",
        "channel": channel,
        "frames": 300,
        "iou": iou,
    }
    return {**made, **changes}


def evaluation(*rows: dict[str, Any]) -> dict[str, Any]:
    return {"iou": list(rows)}


def test_channels_are_rows_and_predictors_columns_with_the_papers_beside():
    (table,) = open_loop_tables(
        [
            evaluation(
                *(row("cvt_kde", name, 0.9) for name in ("road", "route", "lane")),
                *(row("unet", name, 0.6) for name in ("road", "route", "lane")),
            )
        ]
    )
    own = [column.name for column in table.columns if not column.elsewhere]
    assert own == ["Channel", "cvt_kde (CVT 6ch. KDE)", "unet (UNet)"]
    assert sum(column.elsewhere for column in table.columns) == 5
    assert "(test)" in table.columns[-1].group
    assert "300 frames" in table.caption
    roads, means = table.rows[0], table.rows[6]
    assert [cell.text for cell in roads[:3]] == ["Roads", "0.900", "0.600"]
    assert [cell.best for cell in roads[1:3]] == [True, False]
    assert [cell.text for cell in means[:3]] == ["Mean (ch. 0-2)", "0.900", "0.600"]


def test_the_papers_means_are_those_that_it_prints():
    (table,) = open_loop_tables([evaluation(row("cvt", "road", 0.5))])
    means = {
        column.name: cell.text
        for column, cell in zip(table.columns, table.rows[6], strict=True)
        if column.elsewhere
    }
    assert means == {
        "CVT 6ch.": "0.5519",
        "CVT 6ch. No Noise": "0.4459",
        "CVT 6ch. KDE": "0.5667",
        "CVT 3ch.": "0.6703",
        "UNet": "0.5617",
    }


def test_only_unchanged_frames_of_all_places_and_distances_count():
    (table,) = open_loop_tables(
        [
            evaluation(
                row("cvt", "road", 0.5),
                row("cvt", "road", 0.1, change="black cameras"),
                row("cvt", "road", 0.2, place="turn", frames=20),
                row("cvt", "road", 0.3, band="near"),
            )
        ]
    )
    assert table.rows[0][1].text == "0.500"
    assert "300 frames" in table.caption


def test_channels_that_are_not_predicted_have_dashes():
    (table,) = open_loop_tables([evaluation(row("unet", "road", None))])
    assert [cells[1].text for cells in table.rows] == ["\u2013"] * 8


def test_evaluations_of_one_log_share_a_table_and_other_logs_and_looks_have_their_own():
    tables = open_loop_tables(
        [
            evaluation(row("cvt", "road", 0.5), row("cvt", "road", 0.7, town="Town01", log="a")),
            evaluation(row("ipm", "road", 0.6), row("ipm", "road", 0.4, appearance="hard")),
        ]
    )
    assert len(tables) == 3
    both = next(t for t in tables if sum(not c.elsewhere for c in t.columns) == 3)
    assert [cell.text for cell in both.rows[0][1:3]] == ["0.500", "0.600"]


def test_another_file_is_told_by_a_missing_key():
    with pytest.raises(KeyError):
        open_loop_tables([{"attributions": []}])
