"""Tables and smoothing of a training's progress."""

import csv
import io

from bev_driving_env.training.progress import Progress, as_csv


def test_rows_are_a_table_that_reads_back():
    rows = [{"step": 1.0, "loss": 0.123456789}, {"step": 2.0, "loss": float("nan")}]
    read = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert [row["step"] for row in read] == ["1", "2"]
    assert [row["loss"] for row in read] == ["0.123457", "nan"]
    assert as_csv([]) == ""


def test_losses_are_smoothed():
    with Progress(steps=3, step=0, shown=False, events=None) as progress:
        assert progress.smoothed is None
        progress.advance(1.0)
        assert progress.smoothed == 1.0
        progress.advance(0.0)
        assert progress.smoothed == 0.95
