"""``PolicyView``: the BEV that the policy sees, put together channel by channel from sources."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import CHANNELS, BEVGeometry
from .checked import one_line, predict, predict_batch
from .corrupted import CorruptedBEV
from .expressions import is_mixture, mixture
from .ground_truth import GroundTruth
from .protocol import BatchedBEVSource, BEVSourceError, PrivilegedSource, SensorFrame
from .registry import make_bev_source, source_name
from .smoothed import SmoothedBEV

Spec = Any
"""A name, a path, a source object, or a mapping from channels (and ``default``) to these."""


@dataclass(frozen=True, eq=False)
class PolicySnapshot:
    """State of the view.

    Attributes:
        sources: What the sources are, by channel: only a view of the same ones takes the states.
        states: (worlds, feeds) what each source remembers; None where it remembers nothing.
        bev: (N, 6, size, size) what the policies saw last.
    """

    sources: tuple[str, ...]
    states: tuple[tuple[Any, ...], ...]
    bev: NDArray[np.uint8]


class _Feed:
    """One source and the channels that are taken from it, in every world.

    Args:
        spec: What makes the source.
        channels: BEV channels it is to fill.
        required: Those of them that were asked of it by name.
        worlds: Number of worlds.
        geometry: BEV of the environment.

    Attributes:
        name: Name of the source, for messages.
        rows: Rows of the source's output that are used.
        targets: BEV channels they become.
    """

    def __init__(
        self,
        spec: Spec,
        channels: Sequence[str],
        required: set[str],
        worlds: int,
        geometry: BEVGeometry,
    ) -> None:
        self.name = source_name(spec)
        first = _made_for(spec, geometry)
        if first is spec and isinstance(first, CorruptedBEV | SmoothedBEV):
            # so that environments which are given one object do not share what it remembers
            first = copy.deepcopy(first)
        offered = tuple(first.channels)
        for channel in channels:
            if channel in required and channel not in offered:
                raise ValueError(
                    f"bev_source {self.name!r} does not predict channel {channel!r}; "
                    f"it predicts {', '.join(offered)}"
                )
        used = [channel for channel in channels if channel in offered]
        self.rows = [offered.index(channel) for channel in used]
        self.targets = [CHANNELS.index(channel) for channel in used]
        self.privileged = isinstance(first, PrivilegedSource)
        self.batched = not self.privileged and isinstance(first, BatchedBEVSource)
        self.needs_frame = not self.privileged or bool(getattr(first, "needs_frame", False))
        self.needs_truth = self.privileged and bool(getattr(first, "needs_truth", True))
        self.sources = [first]
        if not self.batched:
            # what a source remembers belongs to one world
            self.sources += [self._another(spec, first, geometry) for _ in range(worlds - 1)]

    def _another(self, spec: Spec, first: Any, geometry: BEVGeometry) -> Any:
        if isinstance(spec, str | Path):
            return _made_for(spec, geometry)
        try:
            return copy.deepcopy(first)
        except Exception as error:  # foreign objects may refuse in any way
            raise ValueError(
                f"bev_source {self.name!r} cannot be copied for several worlds "
                f"({one_line(error)}); register a factory with register_bev_source, or define "
                f"predict_batch"
            ) from error

    def of(self, n: int) -> Any:
        """The source of world ``n``."""
        return self.sources[0 if self.batched else n]

    def call(self, n: int, method: str, *arguments: Any) -> Any:
        """Call a method of world ``n``'s source if it has it, else return None."""
        function = getattr(self.of(n), method, None)
        if function is None:
            return None
        try:
            return function(*arguments)
        except BEVSourceError:
            raise
        except Exception as error:  # foreign code may raise anything
            raise BEVSourceError(self.name, f"raised {one_line(error)} in {method}()") from error


class PolicyView:
    """What the policies of N worlds see.

    Args:
        spec: See ``Spec``.
        worlds: Number of worlds.
        geometry: BEV of the environment.

    Attributes:
        is_truth: Whether every channel is the ground truth.
        needs_frame: Whether any source wants sensor frames.
        needs_truth: Whether any source wants the true BEV.

    Raises:
        ValueError: A source is unknown, was made for another BEV geometry, or does not predict a
            channel that was asked of it.
    """

    def __init__(self, spec: Spec, worlds: int, geometry: BEVGeometry) -> None:
        size = geometry.size
        if is_mixture(spec):
            spec = mixture(spec)
        by_channel = channel_specs(spec)
        asked = set(spec) if isinstance(spec, Mapping) else set()
        self._feeds: list[_Feed] = []
        done: set[str] = set()
        for channel in CHANNELS:
            if channel in done:
                continue
            # one source for all channels with the same spec
            mine = [c for c in CHANNELS if _same(by_channel[c], by_channel[channel])]
            done.update(mine)
            required = asked & set(mine)
            self._feeds.append(_Feed(by_channel[channel], mine, required, worlds, geometry))
        self._size = size
        self._identity = tuple(_identity(by_channel[channel]) for channel in CHANNELS)
        self.is_truth = all(type(feed.of(0)) is GroundTruth for feed in self._feeds)
        # of the truth, which costs less to make again than to keep, nothing is kept
        kept = 0 if self.is_truth else worlds
        self._bev = np.zeros((kept, len(CHANNELS), size, size), np.uint8)
        self.needs_frame = any(feed.needs_frame for feed in self._feeds)
        self.needs_truth = any(feed.needs_truth for feed in self._feeds)

    def reset(self, n: int, episode_seed: int) -> None:
        """Tell the sources of world ``n`` that an episode starts."""
        for feed in self._feeds:
            feed.call(n, "seed", _seed_for_sources(episode_seed))
            feed.call(n, "reset")

    def observe(
        self,
        worlds: Sequence[int],
        frame_of: Callable[[int], SensorFrame],
        truth: NDArray[np.uint8] | None,
    ) -> NDArray[np.uint8]:
        """Ask the sources, once a moment, what some worlds look like.

        Args:
            worlds: Which of them.
            frame_of: Makes the sensor frame of a world; called if a source wants it.
            truth: (N, 6, size, size) true BEVs, if a source wants them.

        Returns:
            (N, 6, size, size) uint8: new for those worlds, as last time for the others; a copy.

        Raises:
            BEVSourceError: A source failed or returned something that is no BEV.
        """
        frames = {n: frame_of(n) for n in worlds} if self.needs_frame else {}
        for k, feed in enumerate(self._feeds):
            # the last source may have the frames, the others get copies: none can spoil another's
            last = k == len(self._feeds) - 1
            mine = frames if last else {n: frame.copy() for n, frame in frames.items()}
            self._ask(feed, worlds, mine, truth)
        return self._bev.copy()

    def _ask(
        self,
        feed: _Feed,
        worlds: Sequence[int],
        frames: Mapping[int, SensorFrame],
        truth: NDArray[np.uint8] | None,
    ) -> None:
        """Let one source fill its channels."""
        if feed.batched and worlds:
            given = [frames[n] for n in worlds]
            planes = predict_batch(feed.name, feed.of(0), given, self._size)
            for n, prediction in zip(worlds, planes, strict=True):
                self._bev[n, feed.targets] = prediction[feed.rows]
            return
        for n in worlds:
            if feed.privileged:
                true_bev = None if truth is None else truth[n]
                prediction = feed.call(n, "perceive", frames.get(n), true_bev)
            else:
                prediction = predict(feed.name, feed.of(n), frames[n], self._size)
            self._bev[n, feed.targets] = prediction[feed.rows]

    def last(self) -> NDArray[np.uint8]:
        """What the policies saw last (N, 6, size, size); a copy."""
        return self._bev.copy()

    def snapshot(self) -> PolicySnapshot:
        """Copy what the sources remember."""
        states = tuple(
            tuple(feed.call(n, "snapshot") for feed in self._feeds) for n in range(len(self._bev))
        )
        return PolicySnapshot(self._identity, states, self._bev.copy())

    def restore(self, snapshot: PolicySnapshot | None) -> bool:
        """Go back to a snapshot; returns False if it is of other sources, which then know nothing.

        A source that defines no ``snapshot()`` keeps what it remembers.
        """
        if snapshot is None or snapshot.sources != self._identity:
            return False
        if snapshot.bev.shape != self._bev.shape:
            return False
        for n, states in enumerate(snapshot.states):
            for feed, state in zip(self._feeds, states, strict=True):
                if state is not None:
                    feed.call(n, "restore", state)
        self._bev[:] = snapshot.bev
        return True


def channel_specs(spec: Spec) -> dict[str, Spec]:
    """The source of each channel.

    Raises:
        ValueError: A channel does not exist, or has no source.

    >>> channel_specs({"route": "ipm", "default": "ground_truth"})["route"]
    'ipm'
    """
    if not isinstance(spec, Mapping):
        return dict.fromkeys(CHANNELS, spec)
    for channel in spec:
        if channel not in (*CHANNELS, "default"):
            raise ValueError(
                f"unknown channel {channel!r} in bev_source; "
                f"channels: {', '.join(CHANNELS)}, or 'default'"
            )
    missing = [name for name in CHANNELS if name not in spec]
    if missing and "default" not in spec:
        raise ValueError(
            f"bev_source names no source for channel {missing[0]!r}; add it or a 'default'"
        )
    return {name: spec.get(name, spec.get("default")) for name in CHANNELS}


def _same(one: Spec, other: Spec) -> bool:
    """Whether two specs mean the same source object."""
    named = isinstance(one, str | Path) and isinstance(other, str | Path)
    return one is other or (named and str(one) == str(other))


def _identity(spec: Spec) -> str:
    """What a spec is: its name, or what an object says of itself: its doses, or its address."""
    return source_name(spec) if isinstance(spec, str | Path) else repr(spec)


def _made_for(spec: Spec, geometry: BEVGeometry) -> Any:
    """Make a source, and see to it that it predicts the environment's BEV if it depends on it."""
    source = make_bev_source(spec)
    theirs = getattr(source, "geometry", geometry)
    if not isinstance(theirs, BEVGeometry) or theirs == geometry:
        return source
    if spec == "ipm":
        return type(source)(geometry)  # type: ignore[call-arg]
    raise ValueError(
        f"bev_source {source_name(spec)!r} was made for {theirs}, the environment has {geometry}: "
        f"give it geometry={geometry}"
    )


def _seed_for_sources(episode_seed: int) -> int:
    """A number for each episode that does not give away the errors drawn from its seed."""
    digest = hashlib.blake2b(b"bev source %d" % episode_seed, digest_size=7).digest()
    return int.from_bytes(digest, "little")
