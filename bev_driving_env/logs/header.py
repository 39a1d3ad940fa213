"""``log.json`` and the description of each episode: what was done, and how to render it again."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import is_int, require_count
from ..files import write_json
from ..settings import EnvSettings
from .errors import LogError

FORMAT = "bevtown-drive-log"
FORMAT_VERSION = 1
HEADER_FILE = "log.json"


@dataclass(frozen=True)
class LogHeader:
    """What all episodes of a log have in common.

    Attributes:
        town: Name of the town.
        settings: Keywords of the environment that matter to what happened and how it looks, as
            ``EnvSettings`` takes them.
        control_hz: Steps per simulated second.
        physics_hz: Integration steps per simulated second.
        seed: Seed of the whole log.
        levels: Perturbation level of each collection.
        provenance: Command, versions, commit, machine, date; for people, not for reading.
    """

    town: str
    settings: Mapping[str, Any]
    control_hz: int
    physics_hz: int
    seed: int
    levels: tuple[float, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def env_settings(self) -> EnvSettings:
        """The settings that the episodes were driven with."""
        return EnvSettings.from_keywords(self.settings)

    def write(self, folder: Path) -> None:
        """Write ``log.json``."""
        write_json(folder / HEADER_FILE, _described(self))

    def collection_seed(self, collection: int) -> int:
        """Seed of one of the collections."""
        return int(np.random.SeedSequence([self.seed, collection]).generate_state(1)[0])

    @classmethod
    def read(cls, folder: Path) -> LogHeader:
        """Read ``log.json``.

        Raises:
            LogError: It is missing, damaged, foreign, or of a newer version.
        """
        path = folder / HEADER_FILE
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise LogError(
                f"{folder} is not a drive log: it has no {HEADER_FILE}; make one with "
                f"bev-agents collect --out {folder}"
            ) from None
        except (OSError, ValueError) as error:
            raise LogError(
                f"{path} cannot be read ({error}); collect again into another folder"
            ) from error
        check_description(path, values)
        try:
            header = cls(
                town=str(values["town"]),
                settings=dict(values["settings"]),
                control_hz=int(values["control_hz"]),
                physics_hz=int(values["physics_hz"]),
                seed=int(values["seed"]),
                levels=tuple(float(level) for level in values["levels"]),
                provenance=dict(values["provenance"]),
            )
            _ = header.env_settings
            require_count("control_hz", header.control_hz)
            require_count("physics_hz", header.physics_hz)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise LogError(
                f"{path} is damaged ({error!r}); collect again into another folder"
            ) from error
        return header


@dataclass(frozen=True)
class EpisodeHeader:
    """One episode of a log.

    Attributes:
        episode_id: Such as ``"Town01/route/3"``.
        episode_seed: Decides looks, noise and GPS.
        collection: Number of the collection it belongs to.
        collection_seed: Its seed.
        route: Number of the route in the town's book.
        level: Perturbation level.
        lanes: Lanes of the route in order.
        start_m: Where on the first lane it starts.
        end_m: Where on the last lane it ends.
        vehicle_sizes: Length and width of each vehicle.
        pedestrian_sizes: Likewise.
        signals: How many signals the town has.
        outcome: How it ended: ``"success"``, ``"time_limit"``, ``"lost"`` or ``"blocked"``.
        infractions: Fields of each ``InfractionEvent``.
    """

    episode_id: str
    episode_seed: int
    collection: int
    collection_seed: int
    route: int
    level: float
    lanes: tuple[int, ...]
    start_m: float
    end_m: float
    vehicle_sizes: tuple[tuple[float, float], ...]
    pedestrian_sizes: tuple[tuple[float, float], ...]
    signals: int
    outcome: str = ""
    infractions: tuple[Mapping[str, Any], ...] = ()

    @property
    def name(self) -> str:
        """What its files are called."""
        return episode_name(self.collection, self.route)

    def as_text(self) -> str:
        """JSON for the metadata of the episode's tables; every float survives exactly."""
        return json.dumps(_described(self), separators=(",", ":"))

    @classmethod
    def from_text(cls, text: str, path: Path) -> EpisodeHeader:
        """Read what ``as_text`` wrote.

        Raises:
            LogError: It is damaged, foreign, or of a newer version.
        """
        try:
            values = json.loads(text)
        except ValueError as error:
            raise LogError(
                f"{path} has damaged metadata ({error}); delete that file and collect again"
            ) from error
        check_description(path, values)
        try:
            kept = {name: values[name] for name in cls.__dataclass_fields__}
            for name in ("lanes", "infractions"):
                kept[name] = tuple(kept[name])
            for name in ("vehicle_sizes", "pedestrian_sizes"):
                kept[name] = tuple((float(a), float(b)) for a, b in kept[name])
            return cls(**kept)
        except (KeyError, TypeError, ValueError) as error:
            raise LogError(
                f"{path} has damaged metadata ({error!r}); delete that file and collect again"
            ) from error


def episode_name(collection: int, route: int) -> str:
    """Name of an episode's files, without their endings."""
    return f"collection_{collection:02d}_route_{route:02d}"


def check_belongs(header: LogHeader, episode: EpisodeHeader, path: Path, ending: str) -> None:
    """Check that an episode is one of a log, under its own name.

    Args:
        header: The log's.
        episode: Of the file.
        path: The file.
        ending: What its name ends with.

    Raises:
        LogError: It is of another log, or was renamed.
    """
    if path.name != episode.name + ending:
        raise LogError(f"{path} was written as {episode.name + ending}; give it back its name")
    traffic = header.settings.get("traffic")
    expected = {
        "town": (header.town, episode.episode_id.partition("/")[0]),
        "level": (header.levels[episode.collection : episode.collection + 1], (episode.level,)),
        "seed": (header.collection_seed(episode.collection), episode.collection_seed),
    }
    if isinstance(traffic, Mapping):
        expected["traffic"] = (
            (traffic.get("vehicles"), traffic.get("pedestrians")),
            (len(episode.vehicle_sizes), len(episode.pedestrian_sizes)),
        )
    for name, (of_log, of_episode) in expected.items():
        if of_log != of_episode:
            raise LogError(
                f"{path} belongs to another log: {name} {of_episode!r} instead of {of_log!r}; "
                "move it away and collect again"
            )


def _described(header: LogHeader | EpisodeHeader) -> dict[str, Any]:
    """A description to write, with a checksum: Parquet has none of its metadata."""
    described = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(header)}
    return {**described, "crc32": _checksum(described)}


def _checksum(described: Mapping[str, Any]) -> int:
    """Checksum of all fields, however they were laid out as text."""
    return zlib.crc32(json.dumps(described, sort_keys=True).encode())


def check_description(path: Path, values: Any) -> None:
    """Check that a description is one of a drive log that this version can read, as it was written.

    Raises:
        LogError: It is not.
    """
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise LogError(f"{path} is not of a BEVTown drive log; choose another folder")
    version = values.get("format_version")
    if version is None or not is_int(version):
        raise LogError(f"{path} has format version {version!r}, which is no number")
    if version > FORMAT_VERSION:
        raise LogError(
            f"{path} has format version {version}, this BEVTown reads up to {FORMAT_VERSION}: "
            "update it with pip install --upgrade bev-driving-env"
        )
    kept = {name: value for name, value in values.items() if name != "crc32"}
    # logs of the first days have none
    if "crc32" in values and values["crc32"] != _checksum(kept):
        cure = "into another folder" if path.name == HEADER_FILE else "after deleting that file"
        raise LogError(
            f"{path} is damaged or was edited (its checksum does not fit): collect again {cure}"
        )
