"""The last seconds before each infraction, driven again: a drive is a function of its job."""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.render import bev_panel, write

from ..drive import drive_moments, make_env
from ..suites import Job

SECONDS = 5.0
EVERY_STEPS = 2
"""Steps between the pictures of a film."""
SIDE_PX = 112
"""Of a BEV in a film; on a phone half the screen's width is about 165 px."""
FILM_QUALITY = 30
CAMERA_QUALITY = 45
LINE = 150
"""Grey of the line between what the policy saw and the truth."""
TIME_LIMIT = "time_limit"
"""What a drive ended by that ran out of time."""

Images = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class LastSeconds:
    """What led to an infraction.

    Attributes:
        time_s: Simulated time of the infraction.
        names: Infractions that began at that moment; ``TIME_LIMIT`` if there was none.
        cameras: (C, H, W, 3) the images at that moment.
        camera_names: (C) of them.
        frames: (T, S, 2 S, 3) what the policy saw beside the truth; the last is that moment.
    """

    time_s: float
    names: tuple[str, ...]
    cameras: Images
    camera_names: tuple[str, ...]
    frames: Images


def last_seconds(job: Job) -> Iterator[LastSeconds]:
    """Drive an episode again and stop at each moment with infractions, or at the time limit."""
    env = make_env(job)
    step_s = env.world.config.step_s
    moments: deque[tuple[Images, Images]] = deque(maxlen=round(SECONDS / step_s) + 1)
    noted = 0
    for moment in drive_moments(env, job):
        moments.append((moment.observation["bev"], env.ground_truth_bev()))
        new = env.world.events[0][noted:]
        if new:
            noted += len(new)
            yield _last_seconds(env, moments, tuple(event.name for event in new))
    if env.world.truncated()[0]:
        yield _last_seconds(env, moments, (TIME_LIMIT,))


def _last_seconds(
    env: BEVTownEnv, moments: deque[tuple[Images, Images]], names: tuple[str, ...]
) -> LastSeconds:
    kept = list(moments)[::-1][::EVERY_STEPS][::-1]  # the last one is among them
    config = env.world.config
    frames = [_beside(*(bev_panel(config, bev, SIDE_PX) for bev in pair)) for pair in kept]
    return LastSeconds(
        float(env.world.state.steps[0]) * config.step_s,
        names,
        env.sensor_frame().images,
        tuple(camera.name for camera in env.sensors.settings.rig.cameras),
        np.stack(frames),
    )


def _beside(left: Images, right: Images) -> Images:
    """Two pictures beside each other with a line between them."""
    picture: Images = np.hstack([left, right])
    picture[:, left.shape[1]] = LINE
    return picture


def film(frames: Images) -> bytes:
    """Frames (T, H, W, 3) below one another as one WebP image, of which a page shows one."""
    buffer = io.BytesIO()
    Image.fromarray(frames.reshape(-1, *frames.shape[2:])).save(
        buffer, "WEBP", quality=FILM_QUALITY, method=6
    )
    return buffer.getvalue()


def tiles(cameras: Images, names: tuple[str, ...]) -> bytes:
    """Cameras (C, H, W, 3) with their names as one image, two beside each other."""
    named = []
    for image, name in zip(cameras, names, strict=True):
        tile = np.ascontiguousarray(image)
        write(tile, name, (4, tile.shape[0] - 6), 0.4)
        named.append(tile)
    if len(named) % 2:
        named.append(np.zeros_like(named[0]))
    rows = [np.hstack(named[k : k + 2]) for k in range(0, len(named), 2)]
    buffer = io.BytesIO()
    Image.fromarray(np.vstack(rows)).save(buffer, "WEBP", quality=CAMERA_QUALITY, method=6)
    return buffer.getvalue()
