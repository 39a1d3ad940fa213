"""BEV sources by name, by ``"module:factory"``, or by the path of a checkpoint."""

from __future__ import annotations

import difflib
import importlib
import os.path
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .checked import checked_channels, one_line
from .expressions import corruption, is_corruption
from .protocol import BEVSource, PrivilegedSource

FORMS = (
    "'module:factory', or the path of a checkpoint; SOURCE~MODEL=DOSE for one behind error models"
)

_BUILT_IN = {
    "ground_truth": "bev_driving_env.sources.ground_truth:GroundTruth",
    "ipm": "bev_driving_env.sources.ipm:IPM",
}
_factories: dict[str, Callable[[], Any]] = {}


def register_bev_source(name: str, factory: Callable[[], Any], *, overwrite: bool = False) -> None:
    """Register a BEV source, so that ``bev_source=name`` makes one.

    Args:
        name: Letters, digits, ``_`` and ``-``, not yet taken.
        factory: Called without arguments once per environment; returns a ``BEVSource``. A class
            will do.
        overwrite: Replace a source registered under that name. The built-in ones stay what they
            are: a result that names one must mean the same everywhere.

    Raises:
        TypeError: ``factory`` cannot be called, or is a source itself.
        ValueError: The name is taken or has other characters.

    >>> import bev_driving_env.sources.registry as registry
    >>> registry.register_bev_source("ground_truth", lambda: None)
    Traceback (most recent call last):
        ...
    ValueError: bev_source name 'ground_truth' is built in and cannot be registered
    """
    if not isinstance(name, str) or not re.fullmatch(r"[\w-]+", name):
        raise ValueError(f"bev_source name must consist of letters, digits, _ and -, got {name!r}")
    if not callable(factory):
        raise TypeError(
            f"factory of bev_source {name!r} must be a function that returns a BEVSource, "
            f"got {factory!r}"
        )
    if not isinstance(factory, type) and hasattr(factory, "channels"):
        raise TypeError(
            f"factory of bev_source {name!r} must be a function that returns a BEVSource, "
            f"got a source itself; pass its class, or lambda: {type(factory).__name__}(...)"
        )
    if name in _built_in():
        raise ValueError(f"bev_source name {name!r} is built in and cannot be registered")
    if name in _factories and not overwrite:
        raise ValueError(
            f"bev_source {name!r} is already registered; "
            f"available sources: {', '.join(bev_source_names())}"
        )
    _factories[name] = factory


def bev_source_names() -> tuple[str, ...]:
    """Names of all sources: the built-in ones, then the registered ones."""
    return (*_built_in(), *_factories)


def make_bev_source(spec: Any) -> BEVSource | PrivilegedSource:
    """Make a BEV source from what a user may write.

    Args:
        spec: A registered name; the path of a checkpoint; ``"module:factory"``, where
            ``factory()`` returns a source (a class will do); or a source, which is checked and
            returned as it is. A name goes before a file of that name.

    Returns:
        The source. One of another spec is new, and belongs to the caller alone.

    Raises:
        ValueError: Nothing of that name, it cannot be made, or it is not a source; the message
            says what is missing.
    """
    if not isinstance(spec, str | Path):
        return _checked_source(f"bev_source {type(spec).__name__}", spec)
    return _checked_source(f"bev_source {str(spec)!r}", _made(spec))


def source_name(spec: Any) -> str:
    """How a spec is shown: a name or path as it is written, an object by its class.

    >>> source_name("ground_truth")
    'ground_truth'
    """
    return str(spec) if isinstance(spec, str | Path) else type(spec).__name__


def source_file(spec: Any) -> Path | None:
    """The file whose content decides what a spec means, for hashes in results.

    Args:
        spec: As for :func:`make_bev_source`.

    Returns:
        The checkpoint, a shipped predictor's too, or the file of the module that
        ``"module:factory"`` names. None for other names, objects, and modules that have no file.

    Raises:
        ValueError: The module cannot be imported.
    """
    if not isinstance(spec, str | Path) or spec in _factories:
        return None
    if spec in _built_in():
        return _shipped_file(str(spec))
    if os.path.isfile(spec):
        return Path(spec)
    module_name, colon, factory_name = str(spec).partition(":")
    if not (colon and module_name and factory_name):
        return None
    file = getattr(_imported(str(spec), module_name), "__file__", None)
    return None if file is None else Path(file)


def _shipped_file(name: str) -> Path | None:
    """The weights of a predictor that comes with the package; None for what has none."""
    from perception.shipped import shipped_path

    path = shipped_path(name)
    return path if path.exists() else None


def _built_in() -> dict[str, str]:
    """Names that come with the package, each with its ``"module:factory"``."""
    import perception

    return {**_BUILT_IN, **perception.SOURCES}


def _made(spec: str | Path) -> Any:
    if isinstance(spec, str):
        if spec in _factories:
            return _called(spec, _factories[spec])
        if spec in _built_in():
            return _called(spec, _loaded(spec, _built_in()[spec]))
    if os.path.isfile(spec):  # unlike Path.is_file, False for what cannot be a path at all
        import perception

        return _called(str(spec), lambda: perception.load_source(Path(spec)))
    if is_corruption(spec):
        return _called(str(spec), lambda: _corrupted(str(spec)))
    if isinstance(spec, str) and re.fullmatch(r"[^:]+:[^:]+", spec):
        return _called(spec, _loaded(spec, spec))
    raise ValueError(_unknown(str(spec)))


def _corrupted(text: str) -> Any:
    from .corrupted import CorruptedBEV  # which makes its own source by this module
    from .smoothed import SmoothedBEV

    parts = corruption(text)
    doses: dict[str, Any] = dict(parts.doses)
    source: Any = parts.source
    if "memory" in doses:
        source = SmoothedBEV(source, doses.pop("memory"))
        if not doses and parts.channels is None:
            return source
    return CorruptedBEV(source, channels=parts.channels, **doses)


def _loaded(spec: str, target: str) -> Any:
    """Import what ``"module:factory"`` names."""
    module_name, _, factory_name = target.partition(":")
    module = _imported(spec, module_name)
    try:
        factory = getattr(module, factory_name)
    except (Exception, SystemExit) as error:  # a foreign module may raise anything
        raise ValueError(f"bev_source {spec!r} cannot be loaded: {one_line(error)}") from error
    if not callable(factory):
        raise ValueError(f"bev_source {spec!r} must name a factory or a class, got {factory!r}")
    return factory


def _imported(spec: str, module_name: str) -> Any:
    try:
        return importlib.import_module(module_name)
    except (
        Exception,
        SystemExit,
    ) as error:  # a foreign module may raise anything while it is imported
        raise ValueError(f"bev_source {spec!r} cannot be loaded: {one_line(error)}") from error


def _called(spec: str, factory: Callable[[], Any]) -> Any:
    try:
        return factory()
    except (Exception, SystemExit) as error:
        raise ValueError(f"bev_source {spec!r} cannot be made: {one_line(error)}") from error


def _unknown(spec: str) -> str:
    import perception

    names = bev_source_names()
    close = difflib.get_close_matches(spec, names, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    if Path(spec).suffix in perception.SUFFIXES:
        hint = "; there is no such file"
    return f"unknown bev_source {spec!r}; available sources: {', '.join(names)}; or {FORMS}{hint}"


def _checked_source(owner: str, source: Any) -> Any:
    """The source, if it has what a ``BEVSource`` or a ``PrivilegedSource`` has."""
    if isinstance(source, type):  # has the attributes and can be called, but makes no BEV
        raise ValueError(
            f"{owner} must be a BEVSource, got the class {source.__name__}; make one of it: "
            f"{source.__name__}(...)"
        )
    missing = [] if hasattr(source, "channels") else ["channels"]
    if not callable(getattr(source, "reset", None)):
        missing.append("reset()")
    if isinstance(source, PrivilegedSource):
        missing += [item for item in ("needs_frame", "needs_truth") if not hasattr(source, item)]
    elif not callable(source):
        missing.append("__call__(frame)")
    if missing:
        raise ValueError(
            f"{owner} must be a BEVSource (channels, reset() and __call__(frame)) or a name "
            f"({', '.join(bev_source_names())}), got {type(source).__name__} without "
            f"{', '.join(missing)}"
        )
    checked_channels(owner, source.channels)
    return source
