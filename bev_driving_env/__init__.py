"""BEVTown: what do bird's-eye-view errors cost in closed-loop driving?

Importing this package registers ``BEVTown01-v0`` and ``BEVTown02-v0`` with Gymnasium; anything
heavier is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._version import __version__
from .towns.grid import GridTown
from .towns.registry import draw_routes, register_builtin_towns, register_town, road_network

if TYPE_CHECKING:
    from .env import BEVTownEnv
    from .highway import BEVObservation
    from .logs.drive_log import DriveLog
    from .sources.corrupted import CorruptedBEV
    from .sources.protocol import BEVSource, BEVSourceError, SensorFrame
    from .sources.registry import make_bev_source, register_bev_source
    from .vector_env import BEVTownVectorEnv
    from .wrappers import BEVOnly

__all__ = [
    "BEVObservation",
    "BEVOnly",
    "BEVSource",
    "BEVSourceError",
    "BEVTownEnv",
    "BEVTownVectorEnv",
    "CorruptedBEV",
    "DriveLog",
    "GridTown",
    "SensorFrame",
    "__version__",
    "draw_routes",
    "make_bev_source",
    "register_bev_source",
    "register_town",
    "road_network",
]

_HOMES = {
    "BEVObservation": "highway",
    "BEVOnly": "wrappers",
    "BEVSource": "sources.protocol",
    "BEVSourceError": "sources.protocol",
    "BEVTownEnv": "env",
    "BEVTownVectorEnv": "vector_env",
    "CorruptedBEV": "sources.corrupted",
    "DriveLog": "logs.drive_log",
    "SensorFrame": "sources.protocol",
    "make_bev_source": "sources.registry",
    "register_bev_source": "sources.registry",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


register_builtin_towns()
