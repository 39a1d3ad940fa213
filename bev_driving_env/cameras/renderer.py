"""``CameraRenderer``: the camera images of a world state."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.camera import Workspace, add_noise, list_faces, new_workspace, paint_images
from ..kernels.layout import HEADING, PITCH, ROLL, X, Y
from ..kernels.noise import mix
from ..kernels.scenery import Scenery
from ..kernels.shading import GroundTexture
from ..kernels.view import Ego
from .look import Look, appearance_set, draw_look
from .optics import NOISE_TILE, Optics, build_optics, noise_tile
from .rig import CameraRig

if TYPE_CHECKING:
    from ..towns.compiled import CompiledTown
    from ..world.state import WorldState

LEAST_BLUR_PX = 0.4
"""Below this standard deviation, a neighbour weighs less than a twentieth."""
SENSOR_NOISE, ACTOR_LOOKS = 7, 8
"""Which random numbers of an episode's seed shift the sensor noise and dress the actors."""


@dataclass(frozen=True)
class CameraSettings:
    """How the cameras see.

    Attributes:
        rig: Where they sit; what predictors are told.
        appearance: What looks to draw, see ``draw_look``, or the seed of one look of ``"train"``
            for all episodes.
        motion: Whether the body pitches and rolls and the mounting is a little off.
    """

    rig: CameraRig
    appearance: str | int = "train"
    motion: bool = True

    @property
    def set_name(self) -> str:
        """The set that the looks belong to."""
        return appearance_set(self.appearance) if isinstance(self.appearance, str) else "train"

    def look(self, episode_seed: int) -> Look:
        """The look of an episode."""
        fixed = not isinstance(self.appearance, str)
        return draw_look(
            "train" if fixed else str(self.appearance),
            int(self.appearance) if fixed else episode_seed,
            len(self.rig.cameras),
        )


class CameraRenderer:
    """Renders the cameras of any world of one town; the images depend on the state alone.

    Args:
        town: The town.
        settings: Rig, appearance, motion.
        ego_size_m: Length and width of the ego, which casts a shadow.
        worlds: How many worlds are rendered in turn; their looks are kept.
    """

    def __init__(
        self,
        town: CompiledTown,
        settings: CameraSettings,
        ego_size_m: tuple[float, float],
        worlds: int = 1,
    ) -> None:
        self.settings = settings
        self._scenery: Scenery = town.scenery(dense=settings.set_name == "hard")
        ground = town.ground
        self._ground = GroundTexture(
            ground.grid.x0_m,
            ground.grid.y0_m,
            ground.grid.px_per_m,
            ground.texels,
            ground.offsets,
            ground.shapes,
        )
        self._ego_size_m = ego_size_m
        height, width = settings.rig.size
        self._workspace: Workspace = new_workspace(
            self._scenery, len(settings.rig.cameras), height, width
        )
        self._planes = np.empty((len(settings.rig.cameras), 3, height, width), np.uint8)
        self._intrinsics = settings.rig.intrinsics().astype(np.float64)
        # each world has a look, and so may an episode that one goes back to
        self._dressed = functools.lru_cache(maxsize=worlds + 1)(self._dress)

    def look(self, episode_seed: int) -> Look:
        """The look of the episode with a seed."""
        return self._dressed(episode_seed)[0]

    def _dress(self, episode_seed: int) -> tuple[Look, Optics]:
        return self._with_optics(self.settings.look(episode_seed))

    def _with_optics(self, look: Look) -> tuple[Look, Optics]:
        return look, build_optics(look, self.settings.rig, misaligned=self.settings.motion)

    def render(self, state: WorldState, world: int, look: Look | None = None) -> NDArray[np.uint8]:
        """The images of one world.

        Args:
            state: State of the worlds.
            world: Which of them.
            look: Look to render with; by default that of the world's episode.

        Returns:
            (C, H, W, 3) uint8 RGB, newly made.
        """
        seed = int(state.episode_seed[world])
        look, optics = self._dressed(seed) if look is None else self._with_optics(look)
        moving = float(self.settings.motion)
        ego = state.ego[world]
        (height, width), buffers = self.settings.rig.size, self._workspace
        motion = (
            Ego(ego[X], ego[Y], ego[HEADING], *self._ego_size_m),
            moving * state.attitude[world, PITCH],
            moving * state.attitude[world, ROLL],
            optics.axes,
            optics.places,
            self._intrinsics,
        )
        list_faces(
            self._scenery,
            optics.lighting,
            *motion,
            height,
            width,
            state.vehicles[world],
            state.pedestrians[world],
            state.signals[world],
            optics.sunny,
            int(mix(seed, ACTOR_LOOKS) >> 1),
            buffers.nearby,
            buffers.skyline,
            buffers.hull,
            buffers.records,
            buffers.starts,
        )
        paint_images(
            self._ground,
            optics.atmosphere,
            optics.gain,
            optics.veil,
            optics.beam,
            optics.balance,
            optics.veil_rgb,
            *motion,
            buffers.canvas,
            buffers.records,
            buffers.starts,
            buffers.scratch,
            buffers.dither,
            self._planes,
        )
        return self._develop(look, seed, int(state.steps[world]))

    def _develop(self, look: Look, seed: int, step: int) -> NDArray[np.uint8]:
        """The painted images, blurred by the lens and with noise of the sensor."""
        images = np.empty(self.settings.rig.shape, np.uint8)
        blur = look.blur_px * self.settings.rig.size[1] / 240.0
        for planes, image in zip(self._planes, images, strict=True):
            cv2.merge(list(planes), dst=image)
            if blur >= LEAST_BLUR_PX:
                cv2.GaussianBlur(image, (3, 3) if blur < 0.8 else (0, 0), blur, dst=image)
        start = int(mix(mix(seed, SENSOR_NOISE) >> 1, step) % NOISE_TILE)
        add_noise(images, noise_tile(round(10.0 * look.noise)), start)
        return images
