"""Draw how the shipped predictors were trained, from docs/training/*.csv, into curves.png there.

The files are the ``metrics.csv`` that ``bev-perception train`` left.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

from matplotlib.figure import Figure

FOLDER = Path(__file__).parent / "training"
PANELS = {
    "loss_road": "BCE + Dice, road",
    "loss_route": "BCE + Dice, route",
    "tuned_iou_road": "IoU, road",
    "tuned_iou_route": "IoU, route",
    "tuned_iou_lane": "IoU, lane",
    "tuned_iou_vehicles": "IoU, vehicles",
}


def read(path: Path) -> dict[str, list[float]]:
    """Columns of a file; NaN where a cell is empty."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name] or math.nan) for row in rows] for name in rows[0]}


def main() -> None:
    """Draw one panel a figure, one line a predictor."""
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True).T.ravel()
    for path in sorted(FOLDER.glob("*.csv")):
        columns = read(path)
        for panel, name in zip(panels, PANELS, strict=True):
            if name in columns:
                frames = [count / 1000.0 for count in columns["samples"]]
                panel.plot(frames, columns[name], marker=".", label=path.stem)
    for panel, title in zip(panels, PANELS.values(), strict=True):
        panel.set_title(title, fontsize="medium")
        panel.grid(alpha=0.3)
        if title.startswith("IoU"):
            panel.set_ylim(0.0, 1.0)
    for panel in panels[1::2]:
        panel.set_xlabel("thousand frames")
    panels[0].legend(fontsize="x-small")
    figure.suptitle("Route 0 of Town01's logs, which is not trained on", fontsize="medium")
    figure.savefig(FOLDER / "curves.png", dpi=100, metadata={"Software": None})
    print(FOLDER / "curves.png")


if __name__ == "__main__":
    main()
