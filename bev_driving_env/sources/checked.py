"""What a BEV source returned, checked: uint8 planes, or an error that says what came."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import CHANNELS
from .protocol import BatchedBEVSource, BEVSource, BEVSourceError, SensorFrame

ROUNDING = 1e-5
"""Interpolation may leave [0, 1] by so much; it does not survive rounding to 255ths."""


def checked_channels(owner: str, channels: Any) -> tuple[str, ...]:
    """Check the names of the channels that a source predicts.

    Args:
        owner: Whose they are, for the message.
        channels: What should be a sequence of names.

    Returns:
        The names, in the order given.

    Raises:
        ValueError: Not a sequence of names, none at all, one twice, or one that does not exist.

    >>> checked_channels("mine", ["road", "cars"])
    Traceback (most recent call last):
        ...
    ValueError: mine has channel 'cars', which does not exist; channels: \
road, route, lane, vehicles, pedestrians, lights
    """
    known = ", ".join(CHANNELS)
    if isinstance(channels, str) or not isinstance(channels, Sequence):
        raise ValueError(
            f"{owner} must have channels = a tuple of names, got {channels!r}; channels: {known}"
        )
    if not channels:
        raise ValueError(f"{owner} must have at least one channel; channels: {known}")
    for name in channels:
        if name not in CHANNELS:
            raise ValueError(
                f"{owner} has channel {name!r}, which does not exist; channels: {known}"
            )
    if len(set(channels)) < len(channels):
        raise ValueError(f"{owner} must have each channel once, got {', '.join(channels)}")
    return tuple(channels)


def checked_planes(name: str, channels: Sequence[str], planes: Any, size: int) -> NDArray[np.uint8]:
    """Check one prediction and bring it to uint8.

    Args:
        name: Name of the source, for the message.
        channels: Names of the channels it predicts, C of them.
        planes: What it returned: (C, size, size), uint8 in 0..255 or float in [0, 1].
        size: Side of the BEV in pixels.

    Returns:
        (C, size, size) uint8 in 0..255, a new C-contiguous array; floats are rounded.

    Raises:
        BEVSourceError: Not an array, wrong shape or dtype, NaN, infinity, or out of range.
    """
    return _checked(name, channels, planes, (len(channels), size, size))


def checked_batch(
    name: str, channels: Sequence[str], planes: Any, size: int, count: int
) -> NDArray[np.uint8]:
    """Check a prediction for ``count`` frames and bring it to uint8.

    Args:
        name: Name of the source, for the message.
        channels: Names of the channels it predicts, C of them.
        planes: What it returned: (count, C, size, size), uint8 in 0..255 or float in [0, 1].
        size: Side of the BEV in pixels.
        count: How many frames it was given, at least 1.

    Returns:
        (count, C, size, size) uint8 in 0..255, a new C-contiguous array; floats are rounded.

    Raises:
        BEVSourceError: Not an array, wrong shape or dtype, NaN, infinity, or out of range.
    """
    return _checked(name, channels, planes, (count, len(channels), size, size))


def predict(name: str, source: BEVSource, frame: SensorFrame, size: int) -> NDArray[np.uint8]:
    """Ask a source for a BEV and check it.

    Args:
        name: Name of the source, for the message.
        source: The source.
        frame: What it is given; it may keep and change the arrays.
        size: Side of the BEV in pixels.

    Returns:
        (len(source.channels), size, size) uint8, a new array.

    Raises:
        BEVSourceError: The source raised something (which is chained), or the result is no BEV.
    """
    try:
        planes = source(frame)
    except BEVSourceError:
        raise
    except Exception as error:  # foreign code may raise anything
        raise BEVSourceError(name, f"raised {one_line(error)}") from error
    return checked_planes(name, source.channels, planes, size)


def predict_batch(
    name: str, source: BatchedBEVSource, frames: Sequence[SensorFrame], size: int
) -> NDArray[np.uint8]:
    """Ask a source for the BEVs of several frames in one call and check them.

    Args:
        name: Name of the source, for the message.
        source: The source.
        frames: At least one frame; it may keep and change the arrays.
        size: Side of the BEV in pixels.

    Returns:
        (len(frames), len(source.channels), size, size) uint8, a new array.

    Raises:
        BEVSourceError: The source raised something (which is chained), or the result is no BEV.
    """
    try:
        planes = source.predict_batch(frames)
    except BEVSourceError:
        raise
    except Exception as error:  # foreign code may raise anything
        raise BEVSourceError(name, f"raised {one_line(error)}") from error
    return checked_batch(name, source.channels, planes, size, len(frames))


def one_line(error: BaseException) -> str:
    """Type and first line of an error.

    >>> one_line(KeyError("speed"))
    "KeyError: 'speed'"
    """
    first = next((line for line in str(error).splitlines() if line.strip()), "")
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def _checked(
    name: str, channels: Sequence[str], planes: Any, shape: tuple[int, ...]
) -> NDArray[np.uint8]:
    if not isinstance(planes, np.ndarray):
        raise BEVSourceError(name, f"returned {_kind(planes)}, {_expected(shape)}")
    if planes.shape != shape:
        hint = _shape_hint(planes.shape, shape)
        raise BEVSourceError(name, f"returned shape {planes.shape}, {_expected(shape)}{hint}")
    array = np.asarray(planes)  # a masked array's minimum would leave out what it masks
    if array.dtype == np.uint8:
        return np.array(array, dtype=np.uint8, order="C")
    if array.dtype.kind != "f":
        hint = "; a mask: .astype(np.uint8) * 255" if array.dtype == np.bool_ else ""
        raise BEVSourceError(name, f"returned dtype {array.dtype}, {_expected(shape)}{hint}")
    if array.dtype.itemsize < 4:
        array = array.astype(np.float32)  # half precision is slow, and too coarse for 255 times it
    # NaN is in the minimum if it is anywhere, and then no comparison holds
    if not (array.min() >= -ROUNDING and array.max() <= 1.0 + ROUNDING):
        raise BEVSourceError(name, f"returned {_bad_values(channels, array)}, {_expected(shape)}")
    levels = array * 255.0
    np.rint(levels, out=levels)
    return levels.astype(np.uint8, order="C")


def _expected(shape: tuple[int, ...]) -> str:
    axes = "frames, channels, rows, columns" if len(shape) == 4 else "channels, rows, columns"
    return f"expected a NumPy array of shape {shape} ({axes}), uint8 in 0..255 or float in [0, 1]"


def _kind(planes: Any) -> str:
    """What came instead of an array, with a hint."""
    kind = type(planes)
    if kind.__module__.partition(".")[0] == "torch":
        return f"{kind.__module__}.{kind.__qualname__} (take .detach().cpu().numpy())"
    if planes is None:
        return "None (is there a return statement?)"
    return kind.__name__


def _shape_hint(came: tuple[int, ...], expected: tuple[int, ...]) -> str:
    if came == (*expected[:-3], *expected[-2:], expected[-3]):
        return "; channels come first: np.moveaxis(planes, -1, -3)"
    if came == (1, *expected):
        return "; without the batch axis: planes[0]"
    if expected[-3] == 1 and came == (*expected[:-3], *expected[-2:]):
        return "; with a channel axis: np.expand_dims(planes, -3)"
    return ""


def _bad_values(channels: Sequence[str], array: NDArray[np.floating]) -> str:
    """Say what is wrong with the values, and in which channels."""
    flat = np.moveaxis(array, -3, 0).reshape(len(channels), -1)
    nan: NDArray[np.bool_] = np.isnan(flat)
    infinite: NDArray[np.bool_] = np.isinf(flat)
    if nan.any():
        return f"NaN in {nan.sum()} of {nan.size} values ({_named(channels, nan)})"
    if infinite.any():
        where = _named(channels, infinite)
        return f"infinity in {infinite.sum()} of {infinite.size} values ({where})"
    outside = (flat < 0.0) | (flat > 1.0)
    # shortest exact digits: an overshoot by one rounding error must not read "from 0 to 1"
    return f"values from {flat.min()!s} to {flat.max()!s} ({_named(channels, outside)})"


def _named(channels: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    names = [
        name for name, hit in zip(channels, np.any(chosen, axis=1).tolist(), strict=True) if hit
    ]
    return f"channel{'s' if len(names) > 1 else ''} {', '.join(names)}"
