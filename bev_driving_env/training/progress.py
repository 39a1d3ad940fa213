"""``Progress``: bar, table and TensorBoard events of a training."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

SMOOTHING = 0.95


class Progress:
    """Shows how a training goes; silent in all processes but the first.

    Args:
        steps: Steps in all.
        step: Those done already.
        shown: Whether this is the process that shows.
        events: Folder for TensorBoard's events, or None.
    """

    def __init__(self, steps: int, step: int, shown: bool, events: Path | None) -> None:
        self._events: Any = None
        if events is not None and shown:
            # what was written after the checkpoint that training goes on from is to be forgotten
            self._events = events_writer()(str(events), purge_step=step + 1)
        self._bar: tqdm[Any] = tqdm(
            total=steps, initial=step, unit="step", desc="training", disable=not shown
        )
        self.smoothed: float | None = None

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()
        if self._events is not None:
            self._events.close()

    def advance(self, loss: float) -> None:
        """Move the bar by a step with this loss."""
        before = loss if self.smoothed is None else self.smoothed
        self.smoothed = SMOOTHING * before + (1.0 - SMOOTHING) * loss
        self._bar.update()

    def note(self, row: Mapping[str, float], shown: Sequence[str]) -> None:
        """Note a row of numbers, ``step`` among them.

        Args:
            row: The numbers by name.
            shown: Names of those beside the bar.
        """
        self._bar.set_postfix({name: f"{row[name]:.3f}" for name in shown})
        if self._events is not None:
            for name, number in row.items():
                self._events.add_scalar(name, number, int(row["step"]))


def as_csv(rows: Sequence[Mapping[str, float]]) -> str:
    """Rows of numbers with the same names as CSV, six digits each; empty without rows."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    return text.getvalue()


def events_writer() -> Any:
    """The class that writes events; ImportError with the cure if TensorBoard is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ImportError("--tensorboard needs pip install tensorboard") from error
    return SummaryWriter
