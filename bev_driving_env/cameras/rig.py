"""``CameraRig``: where the cameras sit on the car, and what their pixels see.

Ego frame: x forward, y left, z up from the ground. Camera frame: x right, y down, z forward.
A camera's yaw turns to the left, its pitch downwards, its roll lowers the right side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import is_int, is_number

CAMERA_SIZE = (112, 240)
"""Default height and width of the images."""
PAPER_CAMERA_SIZE = (224, 480)
"""The paper's, after its resize."""
ROOF_M = 2.0
FOV_DEG = 100.0
PITCH_DEG = 8.0
"""Cameras look down this much, so that the ground begins 3 m away."""

# camera axes (right, down, forward) in the ego frame, for a level camera that looks ahead
_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def rotation(yaw_rad: float, pitch_rad: float, roll_rad: float) -> NDArray[np.float64]:
    """Rotation (3, 3) of a body in the ego frame, as ``ego_from_body``: roll, pitch, then yaw.

    Yaw turns to the left, pitch lowers the nose, roll lowers the right side.

    >>> (rotation(np.pi / 2, 0.0, 0.0) @ [1.0, 0.0, 0.0]).round(6).tolist()  # ahead becomes left
    [0.0, 1.0, 0.0]
    """
    (cy, sy), (cp, sp), (cr, sr) = (
        (math.cos(angle), math.sin(angle)) for angle in (yaw_rad, pitch_rad, roll_rad)
    )
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return yaw @ pitch @ roll


def camera_axes(angles_deg: ArrayLike) -> NDArray[np.float64]:
    """Right, down and forward (3, 3) in the ego frame of a camera with yaw, pitch and roll (3,)."""
    return np.asarray(_LEVEL @ rotation(*np.radians(np.asarray(angles_deg, np.float64))).T)


@dataclass(frozen=True)
class Camera:
    """One pinhole camera on the car.

    Attributes:
        name: What it is called.
        x_m: Forward of the ego's centre.
        y_m: Left of it.
        z_m: Above the ground.
        yaw_deg: Viewing direction, to the left of straight ahead.
        pitch_deg: Downwards.
        roll_deg: Right side down.
        fov_deg: Horizontal field of view.

    Raises:
        ValueError: A value is out of range; the message names it.
    """

    name: str
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = ROOF_M
    yaw_deg: float = 0.0
    pitch_deg: float = PITCH_DEG
    roll_deg: float = 0.0
    fov_deg: float = FOV_DEG

    def __post_init__(self) -> None:
        limits = {
            "x_m": (-20.0, 20.0),
            "y_m": (-20.0, 20.0),
            "z_m": (0.2, 50.0),
            "yaw_deg": (-360.0, 360.0),
            "pitch_deg": (-90.0, 90.0),
            "roll_deg": (-180.0, 180.0),
            "fov_deg": (5.0, 160.0),
        }
        for field, (low, high) in limits.items():
            value = getattr(self, field)
            if not (is_number(value) and low <= value <= high):
                raise ValueError(
                    f"camera {self.name!r}: {field} must be from {low:g} to {high:g}, got {value!r}"
                )

    def intrinsics(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """Camera matrix (3, 3) for images of (height, width); pixel centres are integers."""
        height, width = size
        focal_px = width / 2.0 / math.tan(math.radians(self.fov_deg) / 2.0)
        return np.array(
            [
                [focal_px, 0.0, (width - 1) / 2.0],
                [0.0, focal_px, (height - 1) / 2.0],
                [0.0, 0.0, 1.0],
            ]
        )

    def extrinsics(self) -> NDArray[np.float64]:
        """``camera_from_ego`` (4, 4)."""
        axes = camera_axes((self.yaw_deg, self.pitch_deg, self.roll_deg))
        camera_from_ego = np.eye(4)
        camera_from_ego[:3, :3] = axes
        camera_from_ego[:3, 3] = -axes @ [self.x_m, self.y_m, self.z_m]
        return camera_from_ego


SURROUND = (
    Camera("front", x_m=1.2),
    Camera("left", y_m=0.8, yaw_deg=90.0),
    Camera("right", y_m=-0.8, yaw_deg=-90.0),
    Camera("rear", x_m=-1.2, yaw_deg=180.0),
)
"""Four cameras at the edges of the roof that see all around."""


@dataclass(frozen=True)
class CameraRig:
    """Cameras with images of one size.

    Attributes:
        cameras: The cameras, in the order of the images.
        size: Height and width of every image.

    Raises:
        ValueError: No camera, two of one name, or a size below 16 px.
    """

    cameras: Sequence[Camera] = SURROUND
    size: tuple[int, int] = CAMERA_SIZE

    def __post_init__(self) -> None:
        given = self.cameras.cameras if isinstance(self.cameras, CameraRig) else self.cameras
        cameras = tuple(given) if isinstance(given, Sequence) else ()
        if not cameras or not all(isinstance(camera, Camera) for camera in cameras):
            raise ValueError(f"a rig needs a tuple of Camera objects, got {self.cameras!r}")
        names = [camera.name for camera in cameras]
        if len(set(names)) < len(names):
            raise ValueError(f"cameras of a rig need different names, got {', '.join(names)}")
        size = tuple(self.size) if isinstance(self.size, Sequence | np.ndarray) else ()
        if len(size) != 2 or not all(is_int(side) and 16 <= side <= 4096 for side in size):
            raise ValueError(
                f"camera size must be (height, width) of 16 to 4096 px, got {self.size!r}"
            )
        object.__setattr__(self, "cameras", cameras)
        object.__setattr__(self, "size", (int(size[0]), int(size[1])))

    def intrinsics(self) -> NDArray[np.float32]:
        """Camera matrices (C, 3, 3), newly made."""
        return np.stack([camera.intrinsics(self.size) for camera in self.cameras]).astype(
            np.float32
        )

    def extrinsics(self) -> NDArray[np.float32]:
        """Nominal ``camera_from_ego`` (C, 4, 4), newly made."""
        return np.stack([camera.extrinsics() for camera in self.cameras]).astype(np.float32)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of the images: cameras, height, width, 3."""
        return len(self.cameras), *self.size, 3


def project(
    intrinsics: ArrayLike, extrinsics: ArrayLike, points: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project ego-frame points into an image.

    Args:
        intrinsics: (3, 3).
        extrinsics: ``camera_from_ego`` (4, 4).
        points: (..., 3) metres.

    Returns:
        Pixels (..., 2) as (column, row), and depths (...) in metres; pixels of points that are not
        in front of the camera (depth <= 0) are NaN.
    """
    matrix = np.asarray(extrinsics, np.float64)
    seen = np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    depth = seen[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = seen / np.where(depth > 0.0, depth, np.nan)[..., None]
    return (flat @ np.asarray(intrinsics, np.float64).T)[..., :2], depth


def ground_points(
    intrinsics: ArrayLike, extrinsics: ArrayLike, pixels: ArrayLike
) -> NDArray[np.float64]:
    """Where the rays of pixels meet the ground plane; inverse of ``project`` for z = 0.

    Args:
        intrinsics: (3, 3).
        extrinsics: ``camera_from_ego`` (4, 4).
        pixels: (..., 2) as (column, row).

    Returns:
        Ego-frame points (..., 2); NaN where the ray does not go down.
    """
    matrix = np.asarray(extrinsics, np.float64)
    ego_from_camera = matrix[:3, :3].T
    center = -ego_from_camera @ matrix[:3, 3]
    uv = np.asarray(pixels, np.float64)
    homogeneous = np.concatenate([uv, np.ones_like(uv[..., :1])], axis=-1)
    rays = homogeneous @ np.linalg.inv(np.asarray(intrinsics, np.float64)).T @ ego_from_camera.T
    down = np.where(rays[..., 2] < 0.0, rays[..., 2], np.nan)
    reach = -center[2] / down
    return center[:2] + reach[..., None] * rays[..., :2]
