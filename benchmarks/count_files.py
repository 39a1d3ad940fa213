"""Files of pixel counts, with the places that their frames were taken at."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.files import write_bytes
from perception.iou_counts import IoUCounts
from perception.places import Places

OCCUPIED = 0.5
"""Least probability of a pixel that counts as occupied."""


def save_counts(path: Path, counts: IoUCounts, places: Places, **more: NDArray[Any]) -> None:
    """Write counts at the threshold ``OCCUPIED`` to an ``.npz`` file, which appears when complete.

    Args:
        path: The file.
        counts: Of F frames, at one threshold.
        places: Of the same frames.
        **more: Further arrays by name.
    """
    arrays: dict[str, Any] = {
        "hits": counts.hits,
        "predicted": counts.predicted,
        "actual": counts.actual,
        "critical": places.critical,
        "turn": places.turn,
        **more,
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())


def load_counts(path: Path, *names: str) -> tuple[IoUCounts, Places, list[NDArray[Any]]]:
    """Read what :func:`save_counts` wrote.

    Args:
        path: The file.
        *names: Of further arrays.

    Returns:
        Counts, places, and the further arrays.

    Raises:
        ValueError: The file holds something else.
    """
    try:
        with np.load(path) as kept:
            levels = np.full((kept["hits"].shape[2], 1), OCCUPIED)
            counts = IoUCounts(levels, kept["hits"], kept["predicted"], kept["actual"])
            places = Places(kept["critical"], kept["turn"])
            return counts, places, [kept[name] for name in names]
    except (BadZipFile, EOFError, IndexError, KeyError, OSError, ValueError) as error:
        raise ValueError(f"{path} holds no such counts: {error}") from error
