"""The last seconds before an infraction, driven again: a drive is a function of its job."""

from __future__ import annotations

import io
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bev_driving_env.render import bev_image

from ..drive import EpisodeResult, drive_moments, make_env

SECONDS = 5.0
EVERY_STEPS = 2
"""Steps between the pictures of the animation."""
GAP_PX = 4

Pictures = list[NDArray[np.uint8]]


@dataclass(frozen=True, eq=False)
class LastSeconds:
    """What led to the first infraction of a drive.

    Attributes:
        cameras: (N, H, W, 3) the images at the infraction.
        bevs: (T, 6, S, S) what the policy saw.
        truths: (T, 6, S, S) the truth at the same moments.
        step_s: Seconds between them.
    """

    cameras: NDArray[np.uint8]
    bevs: NDArray[np.uint8]
    truths: NDArray[np.uint8]
    step_s: float


def last_seconds(result: EpisodeResult) -> LastSeconds:
    """Drive an episode again up to its first infraction, or to its end if there is none."""
    env = make_env(result.job)
    step_s = env.world.config.step_s
    moments: deque[tuple[NDArray[np.uint8], NDArray[np.uint8]]] = deque(
        maxlen=round(SECONDS / step_s) + 1
    )
    for moment in drive_moments(env, result.job):
        moments.append((moment.observation["bev"], env.ground_truth_bev()))
        if env.world.events[0]:
            break
    kept = list(moments)[::-1][::EVERY_STEPS][::-1]  # the last one is among them
    bevs, truths = (np.stack(part) for part in zip(*kept, strict=True))
    return LastSeconds(env.sensor_frame().images, bevs, truths, EVERY_STEPS * step_s)


def animation(seconds: LastSeconds) -> bytes:
    """An endless WebP animation: what the policy saw beside the truth."""
    frames = [
        Image.fromarray(side_by_side(bev_image(bev), bev_image(truth)))
        for bev, truth in zip(seconds.bevs, seconds.truths, strict=True)
    ]
    buffer = io.BytesIO()
    pauses = [round(1000 * seconds.step_s)] * (len(frames) - 1) + [1500]
    frames[0].save(
        buffer,
        "WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=pauses,
        loop=0,
        lossless=True,
        quality=60,
        method=4,
    )
    return buffer.getvalue()


def strip(cameras: NDArray[np.uint8], quality: int = 60) -> bytes:
    """The four cameras as one JPEG: left, front, right, rear."""
    order = (1, 0, 2, 3) if len(cameras) == 4 else tuple(range(len(cameras)))
    buffer = io.BytesIO()
    Image.fromarray(np.hstack([cameras[k] for k in order])).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def side_by_side(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Two images of one height with a gap between them."""
    gap = np.full((left.shape[0], GAP_PX, 3), 128, np.uint8)
    return np.hstack([left, gap, right])
