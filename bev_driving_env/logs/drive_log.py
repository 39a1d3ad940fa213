"""``DriveLog``: recorded drives, rendered again as they were."""

from __future__ import annotations

import functools
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bev import BEVRenderer, bev_window
from ..cameras.look import Look
from ..cameras.renderer import CameraRenderer, CameraSettings
from ..checks import is_int, require_count
from ..frames import CHANNELS, BEVGeometry
from ..kernels.jit import announce_compilation, drop_stale_caches
from ..kernels.layout import SPEED
from ..route_maps import route_maps
from ..sources.protocol import SensorFrame
from ..towns.compiled import CompiledTown
from ..towns.registry import compiled_town
from ..world.state import WorldState
from .episode import STEPS, read_actions, read_episode, read_header
from .errors import LogError
from .header import EpisodeHeader, LogHeader, check_belongs
from .reach import require_bev_within, require_rig_within
from .replay import EpisodeReplay

EPISODES = "episodes"
VALIDATION_ROUTE = 0
SPLITS: MappingProxyType[str, Callable[[int], bool]] = MappingProxyType(
    {
        "all": lambda route: True,
        "train": lambda route: route != VALIDATION_ROUTE,
        "val": lambda route: route == VALIDATION_ROUTE,
    }
)
"""Which routes belong to a split: the paper validates on route 0 and trains on the others."""
LOOKS_KEPT = 64
_SELECTED = np.ones(1, np.bool_)


class DriveLog:
    """A folder of recorded drives as one sequence of samples, in the order of its episodes.

    BEV, route map, measurements and camera images are rendered when they are asked for, and are
    bit-equal to those of the drive. Samples can be asked for in any order; the episodes used last
    are kept in memory.

    Args:
        folder: Where ``bev-agents collect`` wrote it.
        bev: Geometry of the bird's-eye view and the route map.
        cached_episodes: How many episodes to keep in memory, each about 1 MB for every minute of
            dense traffic. Random order is slow with fewer than the log has.

    Attributes:
        folder: See above.
        geometry: That of the bird's-eye view and the route map.
        header: What all episodes have in common.
        episodes: Description of each episode.
        starts: (E + 1,) index of each episode's first sample, and after the last one.

    Raises:
        LogError: The folder is no drive log, or a file is truncated, foreign, of a newer version
            or of another log.
        ValueError: The view looks farther than logs keep actors.
    """

    def __init__(
        self, folder: str | Path, *, bev: BEVGeometry | None = None, cached_episodes: int = 64
    ) -> None:
        require_count("cached_episodes", cached_episodes)
        self.folder = Path(folder)
        self.header = LogHeader.read(self.folder)
        self.geometry = bev or BEVGeometry()
        require_bev_within(self.geometry)
        self._cached_episodes = cached_episodes
        found = [(*read_header(path), path) for path in episode_files(self.folder)]
        for episode, _, path in found:
            check_belongs(self.header, episode, path, STEPS)
        found.sort(key=lambda entry: (entry[0].collection, entry[0].route))
        self.episodes: tuple[EpisodeHeader, ...] = tuple(header for header, _, _ in found)
        self._paths = tuple(path for _, _, path in found)
        self.starts: NDArray[np.int64] = np.cumsum([0, *(steps for _, steps, _ in found)])
        self._replays: OrderedDict[int, EpisodeReplay] = OrderedDict()
        self._renderers: OrderedDict[CameraSettings, CameraRenderer] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """Leave behind what can be made again: workers of a data loader get a copy each."""
        lazy = [name for name in ("town", "_bev_renderer", "_actions") if name in self.__dict__]
        kept = {name: value for name, value in self.__dict__.items() if name not in lazy}
        return {**kept, "_replays": OrderedDict(), "_renderers": OrderedDict()}

    def __len__(self) -> int:
        return int(self.starts[-1])

    @functools.cached_property
    def town(self) -> CompiledTown:
        """The town, compiled when it is first needed."""
        drop_stale_caches()
        return compiled_town(self.header.town)

    def locate(self, index: int) -> tuple[int, int]:
        """Episode and step of a sample; negative indices count from the end.

        Raises:
            IndexError: There is no such sample.
        """
        if not is_int(index) or not -len(self) <= index < len(self):
            raise IndexError(
                f"sample {index!r} is out of range: {self.folder} has {len(self)} samples"
            )
        number = int(index) % len(self)
        episode = int(np.searchsorted(self.starts, number, side="right")) - 1
        return episode, number - int(self.starts[episode])

    def state(self, index: int) -> WorldState:
        """State of one world at a sample, complete as far as anything that is drawn shows."""
        return self._at(index).copy()

    def _at(self, index: int) -> WorldState:
        """The same in arrays that the next call may overwrite."""
        episode, step = self.locate(index)
        return self.replay(episode).at(step)

    def replay(self, episode: int) -> EpisodeReplay:
        """An episode, from memory if it was used not long ago."""
        replay = self._replays.get(episode)
        if replay is None:
            replay = EpisodeReplay(self.town, read_episode(self._paths[episode]))
            self._replays[episode] = replay
            if len(self._replays) > self._cached_episodes:
                self._replays.popitem(last=False)
        else:
            self._replays.move_to_end(episode)
        return replay

    @functools.cached_property
    def _bev_renderer(self) -> BEVRenderer:
        return BEVRenderer(self.town, self.geometry)

    def bev(self, index: int) -> NDArray[np.uint8]:
        """The ground-truth BEV (6, size, size) uint8 of a sample."""
        size = self.geometry.size
        bev = np.empty((1, len(CHANNELS), size, size), np.uint8)
        self._bev_renderer.render(self._at(index), _SELECTED, bev)
        return bev[0]

    def measurements(self, index: int) -> NDArray[np.float32]:
        """Speed in m/s and the last two commands, (3,) float32."""
        state = self._at(index)
        values = np.empty(3, np.float32)
        values[0] = state.ego[0, SPEED]
        values[1:] = state.command[0]
        return values

    def route_map(self, index: int) -> NDArray[np.uint8]:
        """The sparse plan (size, size) uint8, as a navigation system with GPS shows it."""
        return route_maps(bev_window(self.geometry), self._at(index), _SELECTED)[0]

    @functools.cached_property
    def camera_settings(self) -> CameraSettings:
        """How the cameras saw when it was recorded."""
        return self.header.env_settings.camera_settings()

    def images(
        self, index: int, settings: CameraSettings | None = None, look: Look | None = None
    ) -> NDArray[np.uint8]:
        """Camera images (C, H, W, 3) uint8 RGB of a sample.

        Args:
            index: The sample.
            settings: Rig, size, appearance; those of the recording if None.
            look: Look to render with; that of the sample's episode if None.
        """
        return self._cameras(settings or self.camera_settings).render(self._at(index), 0, look)

    def _cameras(self, settings: CameraSettings) -> CameraRenderer:
        if settings not in self._renderers:
            require_rig_within(settings.rig)
            vehicle = self.header.env_settings.world_config(self.town).vehicle
            size = float(vehicle.length_m), float(vehicle.width_m)
            with announce_compilation():
                renderer = CameraRenderer(self.town, settings, size, LOOKS_KEPT)
            self._renderers[settings] = renderer
        return self._renderers[settings]

    def sensor_frame(
        self, index: int, settings: CameraSettings | None = None, look: Look | None = None
    ) -> SensorFrame:
        """All that a predictor is given at a sample; arguments as for ``images``."""
        settings = settings or self.camera_settings
        return SensorFrame(
            images=self.images(index, settings, look),
            intrinsics=settings.rig.intrinsics(),
            extrinsics=settings.rig.extrinsics(),
            route_map=self.route_map(index),
            measurements=self.measurements(index),
        )

    @functools.cached_property
    def _actions(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        nothing = np.zeros((0, 2), np.float32)
        read = [(nothing, nothing), *(read_actions(path) for path in self._paths)]
        clean, applied = zip(*read, strict=True)
        return np.concatenate(clean), np.concatenate(applied)

    def actions(
        self, indices: NDArray[np.int64] | None = None, *, applied: bool = False
    ) -> NDArray[np.float32]:
        """Acceleration and steering (n, 2) float32 of samples, all if no indices are given.

        Args:
            indices: (n,) which samples.
            applied: What the car was given, perturbations included, instead of what the expert
                asked for.
        """
        table = self._actions[int(applied)]
        return table.copy() if indices is None else table[indices]

    def indices(self, split: str = "all") -> NDArray[np.int64]:
        """Samples (n,) of a split: ``"val"`` (route 0), ``"train"`` (the others) or ``"all"``."""
        return self.windows(split)

    def windows(self, split: str = "all", length: int = 1, stride: int = 1) -> NDArray[np.int64]:
        """First samples (n,) of windows of consecutive steps that lie within one episode.

        Args:
            split: One of ``SPLITS``.
            length: Steps of a window.
            stride: Steps from one window's start to the next one's.

        Raises:
            ValueError: There is no such split, or a number is not positive.
        """
        if split not in SPLITS:
            raise ValueError(f"unknown split {split!r}; splits are: {', '.join(SPLITS)}")
        require_count("length", length)
        require_count("stride", stride)
        belongs = SPLITS[split]
        ranges = [
            np.arange(begin, end - length + 1, stride, dtype=np.int64)
            for episode, begin, end in zip(
                self.episodes, self.starts[:-1], self.starts[1:], strict=True
            )
            if belongs(episode.route)
        ]
        return np.concatenate([np.zeros(0, np.int64), *ranges])


def episode_files(folder: Path) -> list[Path]:
    """Files of steps of all complete episodes of a log, in order of their names."""
    return sorted((folder / EPISODES).glob(f"[!.]*{STEPS}"))


def log_bytes(folder: Path) -> int:
    """Size of a log on disk, everything included.

    Raises:
        LogError: There is no such folder.
    """
    if not folder.is_dir():
        raise LogError(f"{folder} is not a folder")
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
