"""Starting a training from a predictor instead of from random weights."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from .models.presets import ModelSpec
from .weights import load_predictor

CARD = (
    *("command", "git_commit", "seeds", "data", "first_frame", "samples", "weighting"),
    "started_from",
)
"""What the card of the new predictor repeats of the old one's, and so on to the first one's."""


@dataclass(frozen=True)
class Start:
    """Weights to start from, and where they came from.

    Attributes:
        weights: By name; those of layers that start anew are missing.
        digest: SHA-256 of the file.
        card: What is worth repeating of its card.
    """

    weights: Mapping[str, Tensor]
    digest: str
    card: Mapping[str, Any]

    @property
    def frames(self) -> int:
        """Frames that it and those before it have learned from."""
        told = (self.card, *predecessors(self.card))
        return sum(int(each.get("samples", 0)) for each in told)


def start_from(path: str | Path, spec: ModelSpec) -> Start:
    """Weights of a predictor for a network of the same kind.

    Where that network predicts other channels, its output layer starts anew.

    Args:
        path: The predictor's file.
        spec: The network to be trained.

    Raises:
        FileNotFoundError: There is no such file.
        WeightsError: It holds no predictor.
        ValueError: It holds another network.
    """
    predictor = load_predictor(path)
    channels = spec.config.channels
    if predictor.spec.with_channels(channels) != spec:
        raise ValueError(
            f"{path} holds {_told(predictor.spec, spec)}; start from a predictor of the same preset"
        )
    weights = dict(predictor.model.state_dict())
    if predictor.channels != channels:
        weights = {name: weights[name] for name in weights.keys() - output_layers(spec)}
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    card = {name: predictor.card[name] for name in CARD if name in predictor.card}
    return Start(weights, digest, card)


def predecessors(card: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """What a predictor's card tells of those that it goes on from, the last one first.

    >>> [each["samples"] for each in predecessors({"started_from": {"samples": 80}})]
    [80]
    """
    start = card.get("started_from")
    while start is not None:
        yield start
        start = start.get("started_from")


def distinct_frames(card: Mapping[str, Any]) -> int:
    """How many different frames a predictor and those that it goes on from have learned from.

    Trainings on the same data with the same seed go through one and the same sequence of frames;
    before cards told the ``"first_frame"``, all of them from its beginning.

    >>> first = {"data": ["a"], "seeds": [0], "samples": 80}
    >>> distinct_frames({**first, "samples": 100, "started_from": first})
    100
    >>> distinct_frames({**first, "first_frame": 80, "samples": 100, "started_from": first})
    180
    """
    spans: dict[tuple[str, ...], list[tuple[int, int]]] = {}
    for each in (card, *predecessors(card)):
        names = (*map(str, each["data"]), *map(str, each["seeds"]))
        first = int(each.get("first_frame", 0))
        spans.setdefault(names, []).append((first, first + int(each["samples"])))
    count = 0
    for sequence in spans.values():
        seen = 0
        for first, end in sorted(sequence):
            count += max(0, end - max(first, seen))
            seen = max(seen, end)
    return count


def output_layers(spec: ModelSpec) -> set[str]:
    """Names of the weights whose shapes depend on how many channels are predicted."""
    other = ("road", "route") if len(spec.config.channels) == 1 else ("road",)
    shapes = [
        {name: value.shape for name, value in each.build().state_dict().items()}
        for each in (spec, spec.with_channels(other))
    ]
    return {name for name, shape in shapes[0].items() if shapes[1][name] != shape}


def _told(theirs: ModelSpec, ours: ModelSpec) -> str:
    """In what two networks differ."""
    if theirs.architecture != ours.architecture:
        return f"a network of architecture {theirs.architecture!r}, not {ours.architecture!r}"
    told, wanted = theirs.config.as_json(), ours.config.as_json()
    names = [name for name in wanted if name != "channels" and told.get(name) != wanted[name]]
    return "a network with " + ", ".join(
        f"{name} {told.get(name)!r} instead of {wanted[name]!r}" for name in names
    )
