"""The learning curve of a reinforcement learning run: rows of numbers, as CSV and as a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from bev_driving_env.files import write_bytes, write_text

CURVE_CSV, CURVE_PNG = "curve.csv", "curve.png"
Row = Mapping[str, float]

_PANELS = (
    ("return of an episode", (("train_return", "training, sampled"), ("val_return", "validation"))),
    (
        "share",
        (
            ("train_route_share", "route driven, training"),
            ("val_route_share", "route driven, validation"),
            ("val_clean", "clean episodes, validation"),
        ),
    ),
)


def write_curve(folder: Path, rows: Sequence[Row], title: str) -> None:
    """Write ``curve.csv`` and ``curve.png``.

    Args:
        folder: Where to.
        rows: One a validation, all with the same names; ``steps`` is the horizontal axis.
        title: Of the picture.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    write_text(folder / CURVE_CSV, text.getvalue())
    write_bytes(folder / CURVE_PNG, draw_curve(rows, title))


def read_curve(path: Path) -> list[dict[str, float]]:
    """The rows of a ``curve.csv``; none if there is no such file.

    Raises:
        ValueError: It holds something else.
    """
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        try:
            return [
                {name: float(value) for name, value in row.items()} for row in csv.DictReader(file)
            ]
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} is not a learning curve: {error}") from error


def draw_curve(rows: Sequence[Row], title: str) -> bytes:
    """The picture as PNG: returns above, shares of routes and of clean episodes below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    steps = [row["steps"] for row in rows]
    for panel, (label, lines) in zip(panels, _PANELS, strict=True):
        for name, legend in lines:
            panel.plot(steps, [row[name] for row in rows], marker=".", label=legend)
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small")
    panels[1].set_ylim(-0.03, 1.03)
    panels[1].set_xlabel(f"steps of all worlds ({rows[-1]['minutes']:.0f} minutes in all)")
    figure.suptitle(title, fontsize="medium")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
