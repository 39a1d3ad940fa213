"""Trajectories over the town map: the paper's figure."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from bev_driving_env.render import Colour, TownMap, write
from bev_driving_env.sources.expressions import is_corruption
from bev_driving_env.towns.registry import compiled_town

from .drive import EpisodeResult

# Okabe and Ito's palette, distinct for colour-blind readers too, and three more
PALETTE: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (94, 60, 153),
    (240, 228, 66),
    (130, 60, 30),
    (150, 220, 200),
)
BLACK: Colour = (20, 24, 32)
WHITE: Colour = (255, 255, 255)
MARGIN_M = 14.0
LINE_PX, WIDEST_PX = 3, 9
MOST_LABELS = 12
"""With more routes than this, numbers would cover the map."""


def draw_trajectories(
    town: str, results: Sequence[EpisodeResult], width_px: int = 1000
) -> NDArray[np.uint8]:
    """The map of :func:`trajectory_map`, above a legend of drivers and marks."""
    image = trajectory_map(town, results, width_px)
    return np.vstack([image, _legend(image.shape[1], driver_colours(results))])


def driver_colours(results: Sequence[EpisodeResult]) -> dict[tuple[str, str], Colour]:
    """A colour for each BEV source and agent, in order of appearance."""
    drivers = dict.fromkeys((row.job.bev, row.job.agent) for row in results)
    return {driver: PALETTE[k % len(PALETTE)] for k, driver in enumerate(drivers)}


def told_apart(results: Sequence[EpisodeResult]) -> Sequence[EpisodeResult]:
    """The drives that one map can show: all, unless there are more drivers than colours.

    Then those behind error models are left out, if that leaves any.
    """
    if len(driver_colours(results)) <= len(PALETTE):
        return results
    return [result for result in results if not is_corruption(result.job.bev)] or results


def trajectory_map(
    town: str, results: Sequence[EpisodeResult], width_px: int = 1000
) -> NDArray[np.uint8]:
    """Draw every driven trajectory of one town.

    Black dots are starts, white dots are completed ends, arrows show place and heading of
    infractions, whether they ended the episode or not; numbers name the episodes. Drivers that
    came less far are drawn later, with narrower lines, so that all can be seen.

    Args:
        town: Name of the town.
        results: Results; those of other towns are ignored.
        width_px: Rough width of the image.

    Returns:
        RGB image (H, W, 3).
    """
    compiled = compiled_town(town)
    x0, _, x1, _ = compiled.bounds
    town_map = TownMap(compiled, width_px / (x1 - x0 + 2.0 * MARGIN_M), MARGIN_M)
    rows = [result for result in results if result.job.town == town]
    colours = driver_colours(results)
    for driver, width in _line_widths(rows).items():
        for row in rows:
            if (row.job.bev, row.job.agent) == driver:
                town_map.line(np.array(row.trajectory), colours[driver], width)
    labelled = len({row.job.index for row in rows}) <= MOST_LABELS
    for row in rows:
        colour = colours[(row.job.bev, row.job.agent)]
        for event in row.events:
            town_map.arrow((event["x"], event["y"], event["heading"]), colour)
        if row.success:
            town_map.dot(row.trajectory[-1], WHITE, 5.0)
    for row in rows:
        town_map.dot(row.trajectory[0], BLACK, 5.0)
    if labelled:
        for index in sorted({row.job.index for row in rows}):
            row = next(row for row in rows if row.job.index == index)
            town_map.label(row.trajectory[0], str(index))
    return town_map.image


def _line_widths(rows: Sequence[EpisodeResult]) -> dict[tuple[str, str], int]:
    """Widths of the drivers' lines in pixels, in the order of drawing."""
    metres: dict[tuple[str, str], float] = {}
    for row in rows:
        driver = row.job.bev, row.job.agent
        metres[driver] = metres.get(driver, 0.0) + row.driven_m
    order = sorted(metres, key=lambda driver: -metres[driver])
    above = range(len(order) - 1, -1, -1)
    return {
        driver: min(LINE_PX + 2 * count, WIDEST_PX)
        for driver, count in zip(order, above, strict=True)
    }


def _legend(width: int, colours: dict[tuple[str, str], Colour]) -> NDArray[np.uint8]:
    """A strip that names the colours and the marks."""
    strip: NDArray[np.uint8] = np.full((26 * len(colours) + 34, width, 3), 255, np.uint8)
    for k, ((bev, agent), colour) in enumerate(colours.items()):
        y = 18 + 26 * k
        cv2.line(strip, (12, y), (52, y), colour, 4, cv2.LINE_AA)
        write(strip, f"{bev}, driven by {agent}", (62, y + 5), 0.5)
    y = 18 + 26 * len(colours)
    for x, fill in ((32, BLACK), (132, WHITE)):
        cv2.circle(strip, (x, y), 6, fill, -1, cv2.LINE_AA)
        cv2.circle(strip, (x, y), 6, BLACK, 1, cv2.LINE_AA)
    write(strip, "start", (46, y + 5), 0.45)
    write(strip, "completed      arrow: infraction", (146, y + 5), 0.45)
    return strip


def png_bytes(image: NDArray[np.uint8], note: dict[str, Any]) -> bytes:
    """Encode an RGB image as PNG with the provenance in its text chunk ``provenance``."""
    info = PngInfo()
    info.add_text("provenance", json.dumps(note))
    buffer = io.BytesIO()
    # 128 colours are plenty for a map and make it a third of the size
    Image.fromarray(image).quantize(128, dither=Image.Dither.NONE).save(
        buffer, "PNG", pnginfo=info, optimize=True
    )
    return buffer.getvalue()
