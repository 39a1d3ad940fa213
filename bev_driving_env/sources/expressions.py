"""BEV sources as text beyond names, for command lines, results and workers.

* ``"ground_truth~straightening=0.5,latency=0.2"`` is ``CorruptedBEV("ground_truth",
  straightening=0.5, latency=0.2)``; ``@route,lane`` at the end leaves the other channels alone.
* ``"cvt_kde~memory=0.7"`` is ``SmoothedBEV("cvt_kde", 0.7)``, no error but a remedy; errors beside
  it come after it.
* ``"cvt_kde|route=ground_truth"`` is ``{"default": "cvt_kde", "route": "ground_truth"}``; each part
  may be corrupted itself.
"""

from __future__ import annotations

import os.path
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

MIXED, CORRUPTED = "|", "~"
TRUTH = "ground_truth"


class Corruption(NamedTuple):
    """A source behind error models.

    Attributes:
        source: Its name.
        doses: By error model.
        channels: Those that are corrupted; None for all.
    """

    source: str
    doses: dict[str, float]
    channels: tuple[str, ...] | None


def is_mixture(spec: Any) -> bool:
    """Whether a spec is text that names several sources; a file of that name goes before."""
    return isinstance(spec, str) and MIXED in spec and not os.path.isfile(spec)


def is_corruption(spec: Any) -> bool:
    """Whether a spec is text that names a source behind error models; likewise."""
    return isinstance(spec, str) and CORRUPTED in spec and not os.path.isfile(spec)


def mixture(text: str) -> dict[str, str]:
    """Sources by channel, with a ``"default"``.

    Raises:
        ValueError: It is not of that form.

    >>> mixture("cvt_kde|route=ground_truth,lane=ground_truth~shift=0.5")
    {'default': 'cvt_kde', 'route': 'ground_truth', 'lane': 'ground_truth~shift=0.5'}
    """
    default, _, rest = text.partition(MIXED)
    made = {"default": default}
    for channel, source in _pairs(text, _entries(rest)):
        made[channel] = source
    return made


def corruption(text: str) -> Corruption:
    """Source, doses and channels.

    Raises:
        ValueError: It is not of that form.

    >>> corruption("ipm~latency=0.2@route")
    Corruption(source='ipm', doses={'latency': 0.2}, channels=('route',))
    """
    source, _, rest = text.partition(CORRUPTED)
    models, at, names = rest.partition("@")
    try:
        doses = {model: float(dose) for model, dose in _pairs(text, models.split(","))}
    except ValueError as error:
        raise ValueError(
            f"expected SOURCE{CORRUPTED}MODEL=DOSE,...[@CHANNEL,...], got {text!r}"
        ) from error
    return Corruption(source, doses, tuple(names.split(",")) if at else None)


def with_errors(spec: str, doses: Mapping[str, float]) -> str:
    """A source behind error models; itself without any.

    Raises:
        ValueError: It is a mixture or has errors already, which cannot be written as one text.

    >>> with_errors("cvt_kde", {"shift": 0.5})
    'cvt_kde~shift=0.5'
    """
    if not doses:
        return spec
    if is_mixture(spec) or is_corruption(spec):
        raise ValueError(
            f"errors cannot be added to {spec!r}: name one source without {MIXED} and {CORRUPTED}"
        )
    return f"{spec}{CORRUPTED}{','.join(f'{name}={dose:g}' for name, dose in doses.items())}"


def with_truth(spec: str, channels: Iterable[str]) -> str:
    """A source with some channels replaced by the truth.

    >>> with_truth("cvt_kde", ["route", "lane"])
    'cvt_kde|route=ground_truth,lane=ground_truth'
    >>> with_truth("ground_truth", ["route"])
    'ground_truth'
    """
    parts = mixture(spec) if is_mixture(spec) else {"default": spec}
    default = parts.pop("default")
    parts.update(dict.fromkeys(channels, TRUTH))
    if not parts or spec == TRUTH:
        return spec
    return f"{default}{MIXED}{','.join(f'{name}={source}' for name, source in parts.items())}"


def sources_of(spec: str) -> list[str]:
    """Names of all sources that a text is made of.

    >>> sources_of("cvt_kde|route=ipm~latency=0.2")
    ['cvt_kde', 'ipm']
    """
    parts = list(mixture(spec).values()) if is_mixture(spec) else [spec]
    return [corruption(part).source if is_corruption(part) else part for part in parts]


def _entries(text: str) -> list[str]:
    """Entries ``CHANNEL=SOURCE``, whose sources may hold commas of their own.

    A comma ends an entry if a channel's name follows, and not the name of an error model.
    """
    from ..frames import CHANNELS

    entries: list[str] = []
    for piece in text.split(","):
        name = piece.partition("=")[0]
        if entries and CORRUPTED in entries[-1] and name not in CHANNELS:
            entries[-1] += f",{piece}"
        else:
            entries.append(piece)
    return entries


def _pairs(whole: str, entries: list[str]) -> Iterator[tuple[str, str]]:
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not (name and equals and value):
            raise ValueError(f"expected NAME=VALUE in bev_source {whole!r}, got {entry!r}")
        yield name, value
