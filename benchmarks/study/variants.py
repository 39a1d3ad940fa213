"""The perception variants of the metric study: many ways to see well or badly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.sources.corruptions import LATENCY_FRAMES
from bev_driving_env.sources.expressions import (
    TRUTH,
    corruption,
    is_corruption,
    is_mixture,
    mixture,
)
from bev_driving_env.sources.policy_view import PolicyView
from perception import SHIPPED

STATIC = ("road", "route", "lane")
"""Channels that show something in a suite without traffic."""

ERRONEOUS_TRUTH = "truth with errors"
PREDICTOR = "predictor"
ERRONEOUS_PREDICTOR = "predictor with errors"
MIXTURE = "mixture"
CHECKPOINT = "checkpoint"
KINDS = (ERRONEOUS_TRUTH, PREDICTOR, ERRONEOUS_PREDICTOR, MIXTURE, CHECKPOINT)

Doses = Mapping[str, Sequence[float]]
EVERYWHERE: Doses = {
    "latency": (0.1, 0.2, 0.3, 0.5),
    "rotation": (0.3, 0.6, 1.0),
    "shift": (0.2, 0.6, 1.0),
    "dilation": (0.5, 1.0),
    "erosion": (0.4, 0.7, 1.0),
    "channel_dropout": (0.2, 0.4, 0.5, 0.6),
    "range_misses": (0.5, 1.0),
    "blob_dropout": (0.4, 0.5, 0.6, 0.8),
    "pixel_dropout": (0.5, 0.8, 0.95),
    "ghosts": (0.5, 1.0),
    "flicker": (0.5, 0.8, 0.95),
}
"""Doses of error models on road, route and lane at once.

In trial drives of ``bc`` on two routes most models did no harm at middling doses; the doses are
denser where drives went from clean to failed.
"""
ONE_CHANNEL: Mapping[str, Doses] = {
    "route": {
        "straightening": (0.25, 0.5, 1.0),
        "latency": (0.2, 0.4),
        "rotation": (0.5, 1.0),
        "shift": (0.3, 0.7),
        "erosion": (0.5, 1.0),
        "channel_dropout": (0.3, 0.7),
        "range_misses": (1.0,),
        "blob_dropout": (0.6, 0.9),
        "ghosts": (1.0,),
    },
    "road": {"shift": (1.0,), "blob_dropout": (0.6, 1.0)},
    "lane": {"shift": (1.0,), "blob_dropout": (1.0,)},
}
"""Doses of error models on one channel while the others are true."""
COMBINED: Sequence[Mapping[str, float]] = (
    {"erosion": 0.2, "blob_dropout": 0.2, "flicker": 0.2},
    {"erosion": 0.4, "blob_dropout": 0.4, "flicker": 0.4},
    {"rotation": 0.3, "shift": 0.3, "range_misses": 0.5},
    {"rotation": 0.6, "shift": 0.6, "range_misses": 0.8},
    {"dilation": 0.5, "blob_dropout": 0.3, "ghosts": 0.5},
    {"latency": 0.1, "shift": 0.3},
    {"latency": 0.1, "blob_dropout": 0.4},
    {"latency": 0.2, "rotation": 0.3},
)
"""Doses of several error models on road, route and lane at once."""
MIXED = ("cvt_kde", "ipm_unet_kde", "unet", "blind", "ipm")
"""Predictors of which channels are mixed with the truth's, both ways."""
WORSENED = ("cvt_kde", "ipm_unet_kde")
"""Predictors to which errors are added."""
ADDED: Mapping[str, float] = {
    "latency": 0.1,
    "rotation": 0.5,
    "shift": 0.3,
    "range_misses": 0.6,
    "blob_dropout": 0.3,
    "ghosts": 0.5,
}


@dataclass(frozen=True)
class Variant:
    """One way to see.

    Attributes:
        spec: BEV source, as on the command line.
        kind: One of ``KINDS``.

    Raises:
        ValueError: There is no such kind.
    """

    spec: str
    kind: str

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {self.kind!r}")


def default_variants() -> list[Variant]:
    """Variants that need nothing but what comes with the package; each is there once.

    >>> variants = default_variants()
    >>> len(variants) >= 100, variants[0].spec
    (True, 'ground_truth')
    """
    return [
        *(Variant(name, PREDICTOR) for name in (TRUTH, "ipm", *SHIPPED)),
        *(Variant(spec, ERRONEOUS_TRUTH) for spec in _erroneous_truths()),
        *(Variant(spec, MIXTURE) for spec in _mixtures()),
        *(Variant(spec, ERRONEOUS_PREDICTOR) for spec in _erroneous_predictors()),
    ]


def _erroneous_truths() -> Iterator[str]:
    for channels, models in {",".join(STATIC): EVERYWHERE, **ONE_CHANNEL}.items():
        for model, doses in models.items():
            for dose in doses:
                yield f"{TRUTH}~{model}={dose:g}@{channels}"
    for combined in COMBINED:
        yield f"{TRUTH}~{_written(combined)}@{','.join(STATIC)}"


def _written(doses: Mapping[str, float]) -> str:
    return ",".join(f"{model}={dose:g}" for model, dose in doses.items())


def _mixtures() -> Iterator[str]:
    for name in MIXED:
        for channel in STATIC:
            yield f"{name}|{channel}={TRUTH}"
            yield f"{TRUTH}|{channel}={name}"


def _erroneous_predictors() -> Iterator[str]:
    for name in WORSENED:
        for model, dose in ADDED.items():
            yield f"{name}~{model}={dose:g}@{','.join(STATIC)}"


def chosen_variants(patterns: Sequence[str] = (), checkpoints: Sequence[str] = ()) -> list[Variant]:
    """Default variants that match a pattern, and checkpoints.

    Args:
        patterns: Of which one must match, as in a shell: ``ground_truth~*``; none: all.
        checkpoints: BEV sources to add.

    Raises:
        ValueError: A pattern matches none.
    """
    known = default_variants()
    for pattern in patterns:
        if not any(fnmatchcase(variant.spec, pattern) for variant in known):
            raise ValueError(
                f"--variants {pattern!r} matches none of the {len(known)} variants; they are "
                "such as 'cvt_kde', 'ground_truth~shift=*' or '*|route=ground_truth'"
            )
    chosen = [
        variant
        for variant in known
        if not patterns or any(fnmatchcase(variant.spec, pattern) for pattern in patterns)
    ]
    there = {variant.spec for variant in chosen}
    added = [spec for spec in dict.fromkeys(checkpoints) if spec not in there]
    return [*chosen, *(Variant(spec, CHECKPOINT) for spec in added)]


def remembered_frames(spec: str) -> int:
    """How many past frames a variant's BEV depends on.

    >>> remembered_frames("cvt_kde|route=ground_truth~latency=0.3"), remembered_frames("cvt_kde")
    (3, 0)
    """
    parts = mixture(spec).values() if is_mixture(spec) else [spec]
    doses = [corruption(part).doses for part in parts if is_corruption(part)]
    return round(LATENCY_FRAMES * max((each.get("latency", 0.0) for each in doses), default=0.0))


def check_variant(variant: Variant) -> None:
    """See to it that a variant can be made, before any driving.

    Raises:
        ValueError: It cannot.
    """
    PolicyView(variant.spec, 1, BEVGeometry())
