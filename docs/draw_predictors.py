"""Draw how the shipped predictors were trained and what they see, into docs/training.

The curves are drawn from the CSV files there, which are the ``metrics.csv`` that ``bev-perception
train`` left.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
from draw_pictures import at, save_photo
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bev_driving_env.frames import CHANNELS
from bev_driving_env.render import bev_image, fit_tile, write
from bev_driving_env.sources.protocol import SensorFrame
from bev_driving_env.sources.registry import make_bev_source

PLACES: tuple[tuple[dict[str, int], float], ...] = (
    ({"episode": 1}, 22.0),
    ({"episode": 0}, 34.0),
    ({"route": 1}, 15.0),
    ({"route": 4}, 120.0),
    ({"episode": 4}, 60.0),
)
"""Where in Town02 predictors are asked: reset options, route metres."""
SHOWN = ("blind", "unet", "cvt_kde", "ipm_unet_kde")
TILE_PX = 192
BEFORE = {
    "ipm_half": ("ipm_start", 32_000),
    "ipm_unet": ("ipm_half", 28_800),
    "ipm_unet_kde": ("ipm_unet", 40_000),
    "cvt_short": ("cvt_start", 12_800),
    "cvt_no_noise": ("cvt_start", 12_800),
    "cvt_3ch": ("cvt_start", 12_800),
    "cvt": ("cvt_short", 7_200),
    "cvt_kde": ("cvt", 32_000),
}
"""What each training of ``recipes/predictors.sh`` goes on from, and after how many frames of it."""
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


def frames_before(name: str) -> int:
    """Frames that those had seen which a training goes on from."""
    before, frames = BEFORE.get(name, (name, 0))
    return frames + frames_before(before) if before != name else 0


def draw_predictions() -> NDArray[np.uint8]:
    """Front camera, truth and what some predictors see, at places of Town02 in ``test`` looks."""
    sources = {name: make_bev_source(name) for name in SHOWN}
    rows = []
    for options, route_m in PLACES:
        lively: dict[str, Any] = {"traffic": "light", "traffic_lights": True}
        env = at("Town02", options, route_m, appearance="test", **lively)
        frame = env.sensor_frame()
        camera = fit_tile(frame.images[0], (TILE_PX, 2 * TILE_PX), "front camera")
        tiles = {"truth": bev_image(env.ground_truth_bev())}
        tiles |= {name: bev_image(perceived(source, frame)) for name, source in sources.items()}
        for name, tile in tiles.items():
            write(tile, name, (6, 14), 0.4)
            tile[:, :2] = tile[-2:] = 255
        rows.append(np.hstack([camera, *tiles.values()]))
    return np.vstack(rows)


def perceived(source: Any, frame: SensorFrame) -> NDArray[np.uint8]:
    """All six channels (6, S, S) of a source; those that it does not predict are empty."""
    planes = source(frame.copy())
    bev = np.zeros((len(CHANNELS), *planes.shape[1:]), np.uint8)
    bev[[CHANNELS.index(name) for name in source.channels]] = planes
    return bev


def draw_curves() -> None:
    """Draw one panel a figure, one line a predictor."""
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True).T.ravel()
    for number, path in enumerate(sorted(FOLDER.glob("*.csv"))):
        columns, before = read(path), frames_before(path.stem)
        # a predictor without a channel must not shift the colours of the others
        look = {"color": colormaps["tab20"](number), "marker": ".", "label": path.stem}
        for panel, name in zip(panels, PANELS, strict=True):
            if name in columns:
                frames = [(before + count) / 1000.0 for count in columns["samples"]]
                panel.plot(frames, columns[name], **look)
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


def main() -> None:
    """Draw both."""
    draw_curves()
    save_photo(FOLDER / "predictions.jpg", draw_predictions())


if __name__ == "__main__":
    main()
