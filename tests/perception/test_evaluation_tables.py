"""Tables of evaluations whose figures are known."""

import csv
import dataclasses
import io

import numpy as np
import pytest

from perception.evaluation import Evaluation
from perception.evaluation_frames import FrameKey, View
from perception.evaluation_tables import (
    as_csv,
    frame_figures,
    row_names,
    rows,
    tables,
    turn_figures,
)
from perception.iou_counts import IoUCounts
from perception.places import Places

ABOUT = {"log": "data/toy", "town": "Toy", "split": "all"}


@pytest.fixture
def found():
    """Two channels in two frames, the second one critical; no route in the first one.

    Of 100 pixels in each of three bands, road is found in 90, 60, 30 and route in 50, 40, 0.
    """
    hits = np.zeros((2, 3, 2, 1), np.int32)
    hits[:, :, 0, 0] = [90, 60, 30]
    hits[1, :, 1, 0] = [50, 40, 0]
    actual = np.full((2, 3, 2), 100, np.int32)
    actual[0, :, 1] = 0
    counts = IoUCounts(np.array([[0.5], [0.5]]), hits, hits, actual)
    places = Places(np.array([False, True]), np.array([False, True]))
    keys = (FrameKey(0, 7, 1), FrameKey(0, 9, 2))
    return Evaluation("toy", ("road", "route"), counts, places, keys, keys, View())


def parsed(text):
    """Cells of each table's rows, by title."""
    parts = text.split("\n\n")
    return {
        title.rstrip(":"): [
            [cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()
        ]
        for title, table in zip(parts[::2], parts[1::2], strict=True)
    }


def test_tables_hold_the_figures_in_the_order_of_channels(found):
    made = parsed(tables([found]))
    first = made["IoU of 2 frames (1 straight, 1 critical, 1 turn)"]
    assert first[0][:3] == ["Predictor", "road", "route"]
    assert first[0][-2:] == ["Mean 0-2", "Mean 3-5"]
    assert first[2] == ["toy", "0.600", "0.300", *"------"]
    assert made["Per frame, mean"][2][1:3] == ["0.600", "0.300"]
    assert [row[1:4] for row in made["By place"][2:]] == [
        ["straight", "0.600", "-"],
        ["critical", "0.600", "0.300"],
        ["turn", "0.600", "0.300"],
    ]
    assert [row[1:4] for row in made["By distance"][2:]] == [
        ["0-10 m", "0.900", "0.500"],
        ["10-20 m", "0.600", "0.400"],
        ["over 20 m", "0.300", "0.000"],
    ]
    turns = made["Route channel in turn frames"][2]
    assert turns == ["toy", "1", "0.300", "0.300", "0.300", "100.0 %", "100.0 %"]


def test_means_are_over_all_three_channels_or_not_told(found):
    counts = found.counts
    three = IoUCounts(
        np.full((3, 1), 0.5),
        counts.hits[:, :, [0, 1, 0]],
        counts.predicted[:, :, [0, 1, 0]],
        counts.actual[:, :, [0, 1, 0]],
    )
    full = dataclasses.replace(found, channels=("road", "route", "lane"), counts=three)
    table = parsed(tables([full]))["IoU of 2 frames (1 straight, 1 critical, 1 turn)"]
    assert table[2][-2:] == ["0.500", "-"]


def test_changed_frames_have_rows_of_their_own(found):
    changed = dataclasses.replace(found, view=View(change="black"))
    assert row_names([found, changed]) == ["toy", "toy, black cameras"]

    made = parsed(tables([found, changed]))
    assert [row[0] for row in made["Route channel in turn frames"][2:]] == [
        "toy",
        "toy, black cameras",
    ]
    assert {row[0] for row in made["By place"][2:]} == {"toy"}


def test_every_figure_is_in_the_csv(found):
    table = list(csv.DictReader(io.StringIO(as_csv(rows(found, ABOUT)))))
    assert len(table) == 2 * (4 + 3)
    figures = {(r["place"], r["band"], r["channel"]): (r["iou"], r["frames"]) for r in table}
    assert figures["all", "10-20 m", "route"] == ("0.4", "2")
    assert figures["critical", "all", "route"] == ("0.3", "1")
    assert figures["straight", "all", "route"] == ("", "1")
    assert {(r["log"], r["town"], r["change"]) for r in table} == {("data/toy", "Toy", "none")}


def test_frames_and_turns_are_ready_for_json(found):
    assert frame_figures(found) == [
        {"sample": 7, "look_seed": 1, "critical": False, "turn": False, "route_iou": None},
        {"sample": 9, "look_seed": 2, "critical": True, "turn": True, "route_iou": 0.3},
    ]
    assert turn_figures(found)["under_50"] == 1.0
    calm = dataclasses.replace(found, places=Places(np.zeros(2, bool), np.zeros(2, bool)))
    assert turn_figures(calm)["iou"] is None
    roads = found.counts
    one = IoUCounts(
        np.full((1, 1), 0.5),
        roads.hits[:, :, :1],
        roads.predicted[:, :, :1],
        roads.actual[:, :, :1],
    )
    blind = dataclasses.replace(found, channels=("road",), counts=one)
    assert turn_figures(blind) is None
    assert "route_iou" not in frame_figures(blind)[0]
    assert parsed(tables([blind]))["Route channel in turn frames"][2] == ["toy", *"------"]


def test_checkpoints_are_called_by_what_tells_them_apart(found):
    def called(*sources):
        return row_names([dataclasses.replace(found, source=source) for source in sources])

    assert called("ipm", "runs/a/predictor.safetensors", "b.pt2") == ["ipm", "a", "b"]
    same = ["one/a/predictor.safetensors", "two/a/predictor.safetensors"]
    assert called(*same) == same
