"""The output folder of a training: it belongs to one recipe, and holds no one else's files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..files import write_json

RECIPE = "training.json"
EVENTS = "events.out.tfevents.*"


def holds_training(folder: Path) -> bool:
    """Whether a training has claimed a folder."""
    return (folder / RECIPE).exists()


def claim_folder(folder: Path, recipe: Mapping[str, Any], files: Sequence[str]) -> None:
    """Note what is learned from, or find that it is what this folder was made of.

    Args:
        folder: For the output; made if there is none.
        recipe: JSON values that must be the same for a training to go on with another.
        files: Names that training writes.

    Raises:
        ValueError: The folder holds what learned from something else, or files of another origin.
    """
    path = folder / RECIPE
    if not path.exists():
        for name in files:
            if (folder / name).exists():
                raise ValueError(f"{folder} holds {name} but no {RECIPE}: choose another --out")
        write_json(path, dict(recipe))
        return
    try:
        kept = dict(json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is not the file of a training: {error}") from error
    for name, value in recipe.items():
        if kept.get(name) != value:
            raise ValueError(
                f"{folder} holds a training with {name} {kept.get(name)!r}, this one has "
                f"{value!r}: choose another --out, or add --overwrite"
            )


def discard_training(folder: Path, files: Sequence[str]) -> None:
    """Remove a training's own files from its folder, and nothing else; none if it has no claim."""
    if holds_training(folder):
        # the claim last: an interruption must not leave files without an owner
        for path in (*folder.glob(EVENTS), *map(folder.joinpath, files), folder / RECIPE):
            path.unlink(missing_ok=True)
