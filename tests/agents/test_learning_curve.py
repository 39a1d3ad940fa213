"""Learning curves on disk."""

import io

import numpy as np
import pytest
from PIL import Image

from agents.learning_curve import CURVE_CSV, CURVE_PNG, read_curve, write_curve

NAMES = ("train_return", "val_return", "train_route_share", "val_route_share", "val_clean")


def row(steps, value):
    return {"steps": steps, "minutes": steps / 100, **dict.fromkeys(NAMES, value)}


def test_rows_come_back_as_they_were_written(tmp_path):
    rows = [row(0.0, float("nan")), row(128.0, -3.25), row(256.0, 0.5)]
    write_curve(tmp_path, rows, "PPO")
    back = read_curve(tmp_path / CURVE_CSV)
    assert back[1:] == rows[1:]
    assert np.isnan(back[0]["train_return"])


def test_the_picture_shows_the_rows(tmp_path):
    pictures = []
    for last in (0.1, 0.9):
        write_curve(tmp_path, [row(0.0, 0.0), row(128.0, last)], "PPO")
        image = Image.open(io.BytesIO((tmp_path / CURVE_PNG).read_bytes()))
        pictures.append(np.asarray(image.convert("RGB")))
    assert pictures[0].shape[0] > 400
    assert (pictures[0] != pictures[1]).any()


def test_a_curve_that_is_not_there_is_empty_and_another_file_is_an_error(tmp_path):
    assert read_curve(tmp_path / CURVE_CSV) == []
    (tmp_path / CURVE_CSV).write_text("steps,return\n1,good\n", encoding="utf-8")
    with pytest.raises(ValueError, match="is not a learning curve"):
        read_curve(tmp_path / CURVE_CSV)
