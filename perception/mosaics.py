"""Pictures of what a source was shown, what it made of that, and where it was wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.drive_log import DriveLog
from bev_driving_env.render import bev_image, fit_tile
from bev_driving_env.sources.ipm_ground import GroundView
from bev_driving_env.sources.protocol import SensorFrame

from .evaluation import THRESHOLD, Evaluation
from .evaluation_tables import short_name
from .predicting import predicted

TILE_PX = 384
DARK = 24
MISSED = (235, 60, 50)
INVENTED = (60, 120, 245)
FAINT = 0.45
"""How strongly errors are drawn in the difference, other than those of the route."""

Image = NDArray[np.uint8]


class Pick(NamedTuple):
    """A frame to draw.

    Attributes:
        name: Such as ``"worst_1"``.
        number: Which frame of the evaluation.
        route_iou: Its IoU of the route.
    """

    name: str
    number: int
    route_iou: float


def picks(evaluation: Evaluation, count: int) -> list[Pick]:
    """Frames at critical places: those with the worst IoU of the route, and those in the middle.

    Args:
        evaluation: Of a source that predicts the route.
        count: How many of each; fewer if there are fewer frames.
    """
    iou = evaluation.route_iou()
    possible = np.flatnonzero(evaluation.places.critical & np.isfinite(iou))
    ranked = possible[np.argsort(iou[possible], kind="stable")]
    first = max((len(ranked) - count) // 2, 0)
    found = (("worst", ranked[:count]), ("median", ranked[first : first + count]))
    return [
        Pick(f"{name}_{k}", int(number), float(iou[number]))
        for name, chosen in found
        for k, number in enumerate(chosen, 1)
    ]


def mosaic_of(evaluation: Evaluation, number: int, source: Any, logs: Sequence[DriveLog]) -> Image:
    """The picture of a frame of an evaluation, rendered and predicted again.

    Args:
        evaluation: The evaluation.
        number: Which frame.
        source: The source itself.
        logs: Those of the evaluation.

    Returns:
        RGB image.
    """
    key, other = evaluation.keys[number], evaluation.others[number]
    log = logs[key.log]
    frame, truth = evaluation.view.frame(logs, key, other), log.bev(key.sample)
    (planes,) = predicted(evaluation.source, source, [frame.copy()], [truth], [key.look_seed])
    bev = np.zeros_like(truth)
    bev[[CHANNELS.index(channel) for channel in evaluation.channels]] = planes
    size = (frame.images.shape[1], frame.images.shape[2])
    ground = GroundView(log.geometry, frame.intrinsics, frame.extrinsics, size)
    name = short_name(evaluation.source)
    if "route" in evaluation.channels:
        name += f", route IoU {evaluation.route_iou()[number]:.3f}"
    return mosaic(frame, ground.project(frame.images), truth, bev, evaluation.channels, name)


def mosaic(
    frame: SensorFrame,
    ground: Image,
    truth: Image,
    bev: Image,
    channels: Sequence[str] = CHANNELS,
    name: str = "predicted BEV",
) -> Image:
    """Front camera, ground view and route map above the true BEV, the predicted one and the errors.

    Args:
        frame: What the source was shown.
        ground: (S, S, 3) its images on flat ground.
        truth: (6, S, S) the true BEV.
        bev: (6, S, S) the predicted one.
        channels: Which of them are predicted: only there is an error an error.
        name: What is written on the predicted one.

    Returns:
        RGB image (2 * TILE_PX, 3 * TILE_PX, 3).
    """
    rows = [CHANNELS.index(channel) for channel in channels]
    tiles = {
        "front camera": frame.images[0],
        "ground view": ground,
        "route map": np.repeat(frame.route_map[..., None], 3, axis=2),
        "true BEV": bev_image(truth),
        name: bev_image(bev),
        "missed: red, invented: blue": difference(truth[rows], bev[rows], channels),
    }
    size = (TILE_PX, TILE_PX)
    drawn = [fit_tile(_enlarged(image), size, name) for name, image in tiles.items()]
    return np.vstack([np.hstack(drawn[:3]), np.hstack(drawn[3:])])


def difference(truth: Image, bev: Image, channels: Sequence[str]) -> Image:
    """Where two BEVs (C, S, S) differ, as an RGB image (S, S, 3); strongest in the route."""
    image = np.full((*truth.shape[1:], 3), DARK, np.float32)
    actual, found = truth >= 128, bev >= np.ceil(THRESHOLD * 255.0)
    for name, ours, theirs in sorted(
        zip(channels, found, actual, strict=True), key=lambda entry: entry[0] == "route"
    ):
        share = 1.0 if name == "route" else FAINT
        for wrong, colour in ((theirs & ~ours, MISSED), (ours & ~theirs, INVENTED)):
            image[wrong] += share * (np.array(colour, np.float32) - image[wrong])
    return image.round().astype(np.uint8)


def png(image: Image) -> bytes:
    """Content of a PNG file of an RGB image."""
    _, content = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return content.tobytes()


def _enlarged(image: Image) -> Image:
    """Whole cells stay sharp when a small image is made larger."""
    factor = max(TILE_PX // max(image.shape[:2]), 1)
    return np.ascontiguousarray(image.repeat(factor, axis=0).repeat(factor, axis=1))
