"""From a ``Look`` to the tables that the kernels shade with: light, weather, lenses."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels import paints as paint
from ..kernels.shading import HAZE_STEPS, Atmosphere
from ..kernels.shapes import Lighting
from ..kernels.view import Vector
from ..towns.ground import CODE_EIGHTHS, CODE_MATERIALS, MATERIALS, SHARES
from .look import Look
from .palettes import GRAIN
from .rig import CameraRig, camera_axes
from .textures import code_table, grain_tile, pack, smooth_tile, texture_pages

NOISE_TILE = 1 << 16
VIGNETTE = 0.18
DIRT_RGB = (104.0, 98.0, 88.0)
WINDOW_LIGHT = (255.0, 214.0, 140.0)
LAMP_ON, LAMP_OFF = (255.0, 236.0, 190.0), (150.0, 152.0, 150.0)
LIGHTS_ON_BELOW = 0.6
"""Street lamps and other cars' headlamps are lit when ambient and sun together are darker."""
BEAM = 9.0
"""Headlights give a face ten metres ahead this many times the light of the night sky."""

F32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Optics:
    """A look, ready for the kernels.

    Attributes:
        lighting: Sun, sky and paints.
        atmosphere: Ground colours and weather.
        gain: (C, H, W) uint8; see ``kernels.shading.Lens``, likewise the next four.
        veil: (C, H, W) uint8.
        beam: (C, H, W) uint8.
        balance: (C, 3).
        veil_rgb: A colour.
        sunny: Whether things cast shadows.
        axes: (C, 3, 3) right, down, forward of each camera as really mounted, in the body frame.
        places: (C, 3) its real position.
    """

    lighting: Lighting
    atmosphere: Atmosphere
    gain: NDArray[np.uint8]
    veil: NDArray[np.uint8]
    beam: NDArray[np.uint8]
    balance: F32
    veil_rgb: Vector
    sunny: bool
    axes: NDArray[np.float64]
    places: NDArray[np.float64]


def build_optics(look: Look, rig: CameraRig, *, misaligned: bool) -> Optics:
    """Compile a look for a rig.

    Args:
        look: The look.
        rig: The nominal rig.
        misaligned: Whether the cameras carry the look's mounting errors.
    """
    axes, places = mounts(look, rig, misaligned=misaligned)
    gain, veil = _lenses(look, rig)
    veil_rgb = np.array(DIRT_RGB) * _brightness(look)
    return Optics(
        lighting=_lighting(look),
        atmosphere=_atmosphere(look),
        gain=gain,
        veil=veil,
        beam=_beams(look, rig),
        balance=look.balance.astype(np.float32),
        veil_rgb=_vector(veil_rgb),
        sunny=look.sun > 0.15,
        axes=axes,
        places=places,
    )


def mounts(
    look: Look, rig: CameraRig, *, misaligned: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axes (C, 3, 3) and positions (C, 3) of the cameras in the body frame, as really mounted."""
    angles_deg = np.array([(c.yaw_deg, c.pitch_deg, c.roll_deg) for c in rig.cameras])
    places = np.array([(c.x_m, c.y_m, c.z_m) for c in rig.cameras])
    if misaligned:
        angles_deg = angles_deg + look.mount_deg
        places = places + look.mount_m
    return np.array([camera_axes(angles) for angles in angles_deg]), places


def _vector(values: NDArray[np.float64]) -> Vector:
    """Three numbers as a tuple."""
    x, y, z = values.tolist()
    return x, y, z


def _brightness(look: Look) -> float:
    """Light that falls on level ground, about 1 at noon."""
    return float(min(1.0, look.ambient + look.sun * math.sin(look.sun_elevation_rad)))


def _lighting(look: Look) -> Lighting:
    condition = look.condition
    dark = _brightness(look) < LIGHTS_ON_BELOW
    paints = look.paints.copy()
    paints[paint.LAMP] = LAMP_ON if dark else LAMP_OFF
    paints[paint.HEADLIGHT] = LAMP_ON if dark else (206.0, 210.0, 212.0)
    x, y, z = look.sun_direction.tolist()
    return Lighting(
        sun_x=x,
        sun_y=y,
        sun_z=z,
        sun=_vector(look.sun * np.array(condition.sun_tint)),
        ambient=_vector(look.ambient * np.array(condition.ambient_tint)),
        paints=paints.astype(np.float32),
    )


def _atmosphere(look: Look) -> Atmosphere:
    condition = look.condition
    z = float(look.sun_direction[2])
    ambient = look.ambient * np.array(condition.ambient_tint)
    lit = ambient + look.sun * z * np.array(condition.sun_tint)
    inverse_depth = np.linspace(0.0, 1.0, HAZE_STEPS)
    with np.errstate(divide="ignore"):
        depth = np.minimum(1.0 / inverse_depth, 1e4)
    haze_rgb = np.array(condition.haze_rgb)
    sheen = 0.62 * look.wetness * depth / (depth + 9.0)
    return Atmosphere(
        ground=_ground_table(look, lit),
        shadow=_vector(ambient / lit),
        haze=(1.0 - np.exp(-depth / look.sight_m)).astype(np.float32),
        sheen=sheen.astype(np.float32),
        haze_rgb=condition.haze_rgb,
        zenith_rgb=condition.zenith_rgb,
        glow_rgb=_vector(330.0 * look.sun * np.array(condition.sun_tint)),
        cloud_rgb=condition.cloud_rgb,
        clouds=look.clouds,
        pages=texture_pages(),
        codes=code_table(
            0.38 * (haze_rgb + np.array(condition.zenith_rgb)) / 2.0,
            np.array(WINDOW_LIGHT),
            condition.lit_windows,
        ),
        sun=_vector(look.sun_direction),
        beam=BEAM * condition.headlights,
        grain=grain_tile(),
        smooth=smooth_tile(),
    )


def _ground_table(look: Look, lit: NDArray[np.float64]) -> NDArray[np.int32]:
    """Lit colour and graininess (256,) of each code of ``towns.ground``, a byte each."""
    colours = look.ground.copy()
    for name in ("asphalt", "patch", "crack"):
        colours[MATERIALS.index(name)] *= 1.0 - 0.4 * look.wetness
    colours[MATERIALS.index("sidewalk")] *= 1.0 - 0.22 * look.wetness
    grain = 255.0 * np.array([GRAIN[name] for name in MATERIALS])
    materials = np.column_stack([colours * lit, grain])
    share = CODE_EIGHTHS[:, None] / float(SHARES)
    first, second = materials[CODE_MATERIALS.T]
    table = np.zeros((256, 4))
    table[: len(share)] = first * (1.0 - share) + second * share
    return pack(table)


def _rays(rig: CameraRig, k: int) -> NDArray[np.float64]:
    """Unit directions (H, W, 3) in the ego frame that the pixels of a camera look in."""
    camera, (height, width) = rig.cameras[k], rig.size
    inverse = np.linalg.inv(camera.intrinsics(rig.size))
    v, u = np.mgrid[:height, :width].astype(np.float64)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ inverse.T @ camera.extrinsics()[:3, :3]
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


@functools.lru_cache(maxsize=8)
def _vignettes(rig: CameraRig) -> NDArray[np.float64]:
    """How much darker (C, H, W) the corners of the images are, 1 in the middle."""
    masks = []
    for camera in rig.cameras:
        height, width = rig.size
        v, u = np.mgrid[:height, :width].astype(np.float64)
        focal = camera.intrinsics(rig.size)[0, 0]
        off_axis = ((u - (width - 1) / 2.0) ** 2 + (v - (height - 1) / 2.0) ** 2) / focal**2
        masks.append(1.0 - VIGNETTE * off_axis / (1.0 + off_axis))
    return np.stack(masks)


def _lenses(look: Look, rig: CameraRig) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Gain (128 is 1) and veil (C, H, W) of each camera."""
    gain = _vignettes(rig) * look.exposure[:, None, None]
    veil = np.full_like(gain, look.condition.glare * 0.35)
    if look.dirty:
        for k in range(len(gain)):
            dirt = _dirt(look.seed * 8 + k, rig.size)
            gain[k] *= 1.0 - dirt
            veil[k] += dirt * 0.9
    elif look.condition.glare == 0.0:
        veil[:] = 0.0
    return (
        np.clip(gain * 128.0, 0.0, 255.0).astype(np.uint8),
        np.clip(veil * 255.0, 0.0, 255.0).astype(np.uint8),
    )


def _dirt(seed: int, size: tuple[int, int]) -> NDArray[np.float64]:
    """Opacity (H, W) of the dirt on a lens: a few large smears and many drops."""
    rng = np.random.default_rng([seed, 99])
    height, width = 56, 120
    canvas = np.zeros((height, width), np.float32)
    for _ in range(int(rng.integers(10, 30))):
        center = int(rng.integers(width)), int(rng.integers(height))
        cv2.circle(canvas, center, int(rng.integers(1, 4)), float(rng.uniform(0.3, 0.8)), -1)
    for _ in range(int(rng.integers(1, 5))):
        center = int(rng.integers(width)), int(rng.integers(height))
        axes = int(rng.integers(8, 26)), int(rng.integers(4, 12))
        turn = float(rng.uniform(0.0, 180.0))
        cv2.ellipse(canvas, center, axes, turn, 0.0, 360.0, float(rng.uniform(0.2, 0.55)), -1)
    smeared = cv2.GaussianBlur(canvas, (0, 0), 1.6)
    return np.asarray(cv2.resize(smeared, size[::-1], interpolation=cv2.INTER_LINEAR), np.float64)


def _beams(look: Look, rig: CameraRig) -> NDArray[np.uint8]:
    """How much of the headlights' light (C, H, W) falls where each pixel looks."""
    beams = np.zeros((len(rig.cameras), *rig.size), np.uint8)
    if look.condition.headlights == 0.0:
        return beams
    for k in range(len(rig.cameras)):
        rays = _rays(rig, k)
        azimuth = np.arctan2(rays[..., 1], rays[..., 0])
        # dipped: little light above the horizon
        height = np.where(rays[..., 2] > 0.0, np.exp(-rays[..., 2] / 0.06), 1.0)
        beams[k] = np.round(255.0 * np.exp(-((azimuth / 0.62) ** 2)) * height)
    return beams


@functools.lru_cache(maxsize=32)
def noise_tile(sigma_tenths: int) -> NDArray[np.int16]:
    """Sensor noise (65536,) with a standard deviation in tenths of a grey level."""
    tile = np.random.default_rng(13).normal(0.0, sigma_tenths / 10.0, NOISE_TILE)
    return np.asarray(np.round(tile), np.int16)
