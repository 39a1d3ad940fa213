"""``CorruptedBEV``: any BEV source with errors added on purpose, in doses."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..checks import is_int, is_number
from ..frames import BEVGeometry
from . import corruptions
from .checked import checked_planes, predict
from .protocol import BEVSourceError, PrivilegedSource, SensorFrame
from .registry import make_bev_source, source_name

_MODELS: dict[str, tuple[corruptions.Model, int | None]] = {
    "straightening": (corruptions.straightening, None),
    "rotation": (corruptions.rotation, None),
    "shift": (corruptions.shift, None),
    "dilation": (corruptions.dilation, None),
    "erosion": (corruptions.erosion, None),
    "channel_dropout": (corruptions.channel_dropout, 1),
    "range_misses": (corruptions.range_misses, 10),
    "blob_dropout": (corruptions.blob_dropout, 10),
    "pixel_dropout": (corruptions.pixel_dropout, 1),
    "ghosts": (corruptions.ghosts, 20),
    "flicker": (corruptions.flicker, 1),
}
"""In the order of application; after so many frames random numbers change, None: per episode."""
CORRUPTIONS: tuple[str, ...] = ("latency", *_MODELS)
"""Names of the error models, in the order of application; each is a keyword of ``CorruptedBEV``."""
_GEOMETRY = BEVGeometry()


@dataclass(frozen=True, eq=False)
class CorruptedState:
    """What a ``CorruptedBEV`` remembers at one moment.

    Attributes:
        episode_seed: Seed of the episode.
        frames: BEVs made since its start.
        history: The latest BEVs of the inner source, as far back as latency needs them.
        inner: The inner source's own snapshot; None if it makes none.
    """

    episode_seed: int
    frames: int
    history: tuple[NDArray[np.uint8], ...]
    inner: Any


class CorruptedBEV(PrivilegedSource):
    """A BEV source whose output is made worse in a controlled way, to see what that costs.

    Each error model has a dose from 0, which changes nothing, to 1:

    | Keyword           | At dose 1                                          | Drawn anew    |
    | ----------------- | -------------------------------------------------- | ------------- |
    | `latency`         | the BEV of 10 frames ago                           |               |
    | `straightening`   | the route is straight from the ego on              |               |
    | `rotation`        | 30 degrees about the ego, to a random side         | each episode  |
    | `shift`           | 4 m in a random direction                          | each episode  |
    | `dilation`        | edges 1.6 m farther out                            |               |
    | `erosion`         | edges 1.6 m farther in                             |               |
    | `channel_dropout` | channels black: a dose is the chance of each       | each frame    |
    | `range_misses`    | 3.2 m patches lost: chance distance / 30 m x dose  | 10 frames     |
    | `blob_dropout`    | everything lost: a dose is the share, in blobs     | 10 frames     |
    | `pixel_dropout`   | everything lost: a dose is the chance of a pixel   | each frame    |
    | `ghosts`          | 12 rectangles in each channel that are not there   | 20 frames     |
    | `flicker`         | everything lost: a dose is the chance of a patch   | each frame    |

    Several are applied in the order of the table: what is seen late, then where it is, then its
    outline, then what is missed; ghosts are added to what is left, and flicker takes ghosts too.
    The route is straightened before it is moved away from the ego, where its tracing starts.

    Random numbers depend on the two seeds, the number of the frame in its episode and the error
    model, on nothing else; a larger dose destroys what a smaller one does, and more. Lost pixels
    are 0 and ghosts 255; patches and ghosts stay in place relative to the car.

    Args:
        source: What ``bev_source`` takes: a name, ``"module:factory"``, a path, or a source.
        pixel_dropout: Dose, as are the following keywords.
        blob_dropout: See the table.
        channel_dropout: See the table.
        dilation: See the table.
        erosion: See the table.
        shift: See the table.
        rotation: See the table.
        range_misses: See the table.
        ghosts: See the table.
        latency: See the table; in steps of 0.1.
        flicker: See the table.
        straightening: See the table; changes the channel ``route`` only.
        channels: Names of the channels to corrupt; None for all.
        seed: Combined with the episode's seed.
        geometry: That of the environment, if not the default.

    Attributes:
        geometry: See above.
        channels: Names of the channels of the source.
        needs_frame: Whether the source wants a sensor frame.
        needs_truth: Whether the source wants the true BEV.

    Raises:
        ValueError: A dose is not from 0 to 1, the source lacks a channel, the seed is not an int of
            at least 0, or there is no such source.
    """

    def __init__(
        self,
        source: Any,
        *,
        pixel_dropout: float = 0.0,
        blob_dropout: float = 0.0,
        channel_dropout: float = 0.0,
        dilation: float = 0.0,
        erosion: float = 0.0,
        shift: float = 0.0,
        rotation: float = 0.0,
        range_misses: float = 0.0,
        ghosts: float = 0.0,
        latency: float = 0.0,
        flicker: float = 0.0,
        straightening: float = 0.0,
        channels: Iterable[str] | None = None,
        seed: int = 0,
        geometry: BEVGeometry = _GEOMETRY,
    ) -> None:
        doses = {
            "latency": latency,
            "straightening": straightening,
            "rotation": rotation,
            "shift": shift,
            "dilation": dilation,
            "erosion": erosion,
            "channel_dropout": channel_dropout,
            "range_misses": range_misses,
            "blob_dropout": blob_dropout,
            "pixel_dropout": pixel_dropout,
            "ghosts": ghosts,
            "flicker": flicker,
        }
        for name, dose in doses.items():
            if not (is_number(dose) and 0.0 <= dose <= 1.0):
                raise ValueError(f"{name} must be a dose from 0 to 1, got {dose!r}")
        self._doses = {name: float(dose) for name, dose in doses.items() if dose > 0.0}
        self._inner = cast(Any, make_bev_source(source))
        self._name = source_name(source)
        self._privileged = isinstance(self._inner, PrivilegedSource)
        self.channels: tuple[str, ...] = tuple(self._inner.channels)
        self.needs_frame: bool = self._inner.needs_frame if self._privileged else True
        self.needs_truth: bool = self._inner.needs_truth if self._privileged else False
        self._selected = _selected(self.channels, channels)
        route = [k for k in self._selected if self.channels[k] == "route"]
        self._targets = {n: route if n == "straightening" else self._selected for n in self._doses}
        if straightening > 0.0 and not route:
            raise ValueError(
                "straightening changes the channel 'route', which is not among those to corrupt: "
                f"{', '.join(self.channels[k] for k in self._selected)}"
            )
        self._seed = _checked_seed("seed", seed)
        self.geometry = geometry
        self._episode_seed = 0
        self._forget()

    def _forget(self) -> None:
        self._frames = 0
        self._history: deque[NDArray[np.uint8]] = deque(maxlen=corruptions.LATENCY_FRAMES + 1)

    def __repr__(self) -> str:
        words = [repr(self._name)]
        words += [f"{name}={dose:g}" for name, dose in self._doses.items()]
        if len(self._selected) < len(self.channels):
            words.append(f"channels={tuple(self.channels[k] for k in self._selected)}")
        return f"CorruptedBEV({', '.join(words)}, seed={self._seed})"

    def seed(self, number: int) -> None:
        """Take the episode's seed; called before :meth:`reset`."""
        self._episode_seed = _checked_seed("the episode's seed", number)
        if hasattr(self._inner, "seed"):
            self._inner.seed(number)

    def reset(self) -> None:
        """Forget everything: an episode starts."""
        self._forget()
        self._inner.reset()

    def __call__(self, frame: SensorFrame) -> NDArray[np.uint8]:
        """Make the next BEV from a sensor frame alone.

        Returns:
            (len(channels), size, size) uint8, a new array.

        Raises:
            BEVSourceError: The source starts from the true BEV, or fails.
        """
        if self.needs_truth:
            raise BEVSourceError(
                repr(self),
                "starts from the true BEV, which only an environment has: "
                'gymnasium.make("BEVTown01-v0", bev_source=...)',
            )
        return self.perceive(frame, None)

    def perceive(
        self, frame: SensorFrame | None, truth: NDArray[np.uint8] | None
    ) -> NDArray[np.uint8]:
        """Make the next BEV.

        Args:
            frame: What the car senses, if ``needs_frame``.
            truth: (6, size, size) uint8 true BEV, if ``needs_truth``.

        Returns:
            (len(channels), size, size) uint8, a new array.

        Raises:
            BEVSourceError: The source fails, or its BEV does not have the size of ``geometry``.
        """
        planes = self._uncorrupted(frame, truth)
        if "latency" in self._doses:
            self._history.append(planes.copy())
        for name in self._doses:
            target = self._targets[name]
            planes[target] = self._corrupted(name, planes[target])
        self._frames += 1
        return planes

    def _uncorrupted(
        self, frame: SensorFrame | None, truth: NDArray[np.uint8] | None
    ) -> NDArray[np.uint8]:
        """The inner source's BEV, a new array."""
        size = self.geometry.size
        if self._privileged:
            planes = self._inner.perceive(frame, truth)
            if planes.shape[-1] != size:
                raise BEVSourceError(
                    self._name,
                    f"returned a BEV of {planes.shape[-1]} px, CorruptedBEV was made for {size}: "
                    "give it the environment's, CorruptedBEV(..., geometry=BEVGeometry(...))",
                )
            return checked_planes(self._name, self.channels, planes, size)
        if frame is None:
            raise BEVSourceError(self._name, "needs a sensor frame, got None")
        return predict(self._name, self._inner, frame, size)

    def _corrupted(self, name: str, planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        dose = self._doses[name]
        if name == "latency":
            return corruptions.latency(self._history, dose)[self._targets[name]]
        model, frames = _MODELS[name]
        block = 0 if frames is None else self._frames // frames
        seeds = [self._seed, self._episode_seed, block, zlib.crc32(name.encode())]
        return model(planes, dose, np.random.default_rng(seeds), self.geometry)

    def snapshot(self) -> CorruptedState:
        """What is remembered now; later frames do not change it."""
        inner = self._inner.snapshot() if hasattr(self._inner, "snapshot") else None
        return CorruptedState(self._episode_seed, self._frames, tuple(self._history), inner)

    def restore(self, state: CorruptedState) -> None:
        """Go back to a snapshot: the same inputs then give the same BEVs again, bit for bit."""
        self._forget()
        self._episode_seed, self._frames = state.episode_seed, state.frames
        self._history.extend(state.history)
        if hasattr(self._inner, "restore"):
            self._inner.restore(state.inner)


def _selected(channels: tuple[str, ...], wanted: Iterable[str] | None) -> list[int]:
    """Indices of the channels to corrupt."""
    names = channels if wanted is None else (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for name in names:
        if name not in channels:
            raise ValueError(
                f"cannot corrupt channel {name!r}; channels of the source: {', '.join(channels)}"
            )
    return [k for k, name in enumerate(channels) if name in names]


def _checked_seed(name: str, number: Any) -> int:
    if not (is_int(number) and number >= 0):
        raise ValueError(f"{name} must be an int of at least 0, got {number!r}")
    return int(number)
