"""Intersection over union (IoU) of BEVs, channel by channel.

Of a channel, intersection are the pixels that both prediction and target hold, union those that
either holds. **Dataset-level** IoU adds both up over all frames before dividing (what the CVT
reference does); **per-frame** IoU divides frame by frame. The rule for empty channels: where the
union is empty there is nothing to measure and the IoU is NaN; in means over frames such frames
are left out. ``iou_counts.py`` gives both. A pixel is occupied where its probability is at least
the threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bev_driving_env.checks import is_number

Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]


def channel_iou(
    prediction: ArrayLike, target: ArrayLike, threshold: float | Sequence[float] = 0.5
) -> Floats:
    """Dataset-level IoU of each channel.

    Args:
        prediction: (N, C, H, W) or (C, H, W): bool, uint8 in 0..255, or float in [0, 1].
        target: The same shape, of any of these kinds; uint8 masks are 0 and 255.
        threshold: Least probability of an occupied pixel in (0, 1], one for all or one for each
            channel; bool predictions need none. The target's is 0.5.

    Returns:
        (C,) IoU in [0, 1]; NaN where neither holds anything in any frame.

    Raises:
        ValueError: Shapes that differ, another dtype, values or thresholds out of range.

    >>> prediction = np.array([[[0.9, 0.6, 0.1]], [[0.0, 0.0, 0.0]]])  # two channels of 1 x 3
    >>> channel_iou(prediction, np.array([[[1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]]])).tolist()
    [0.5, nan]
    """
    predicted, actual = as_batches(prediction, target)
    channels = predicted.shape[1]
    limits = checked_thresholds(threshold, (channels,))
    ours = occupied_pixels("prediction", predicted, limits)
    theirs = occupied_pixels("target", actual, np.full(channels, 0.5))
    counts = [
        (np.count_nonzero(p & t), np.count_nonzero(p | t))
        for p, t in zip(ours.swapaxes(0, 1), theirs.swapaxes(0, 1), strict=True)
    ]
    hits, union = np.array(counts).T
    return ratio(hits, union)


def ratio(part: NDArray[Any], whole: NDArray[Any]) -> Floats:
    """Part over whole; NaN where the whole is 0."""
    empty = np.full(np.shape(whole), np.nan)
    return np.divide(part, whole, out=empty, where=np.asarray(whole) > 0)


def as_batches(prediction: ArrayLike, target: ArrayLike) -> tuple[NDArray[Any], ...]:
    """Both as (N, C, H, W)."""
    predicted, actual = np.asarray(prediction), np.asarray(target)
    if predicted.shape != actual.shape or predicted.ndim not in (3, 4):
        raise ValueError(
            "prediction and target must have one shape (N, C, H, W) or (C, H, W), "
            f"got {predicted.shape} and {actual.shape}"
        )
    shape = predicted.shape if predicted.ndim == 4 else (1, *predicted.shape)
    return predicted.reshape(shape), actual.reshape(shape)


def checked_thresholds(thresholds: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Thresholds in (0, 1], broadcast to a shape that starts with the channels."""
    values = np.asarray(thresholds, dtype=np.float64)
    if not all(is_number(value) and 0.0 < value <= 1.0 for value in values.flat):
        raise ValueError(f"thresholds must be in (0, 1], got {thresholds!r}")
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise ValueError(
            f"there must be one threshold for each of {shape[0]} channels, got {thresholds!r}"
        ) from None


def least_level(thresholds: Floats) -> NDArray[np.int64]:
    """The least v of 0..255 with v / 255 >= threshold, whose own rounding is forgiven."""
    return np.ceil(thresholds * 255.0 - 1e-4).astype(np.int64)


def occupied_pixels(name: str, planes: NDArray[Any], thresholds: Floats) -> Masks:
    """Where (N, C, H, W) planes reach their channel's threshold (C,)."""
    _check_values(name, planes)
    if planes.dtype == np.bool_:
        return planes.astype(np.bool_, copy=False)
    if planes.dtype == np.uint8:
        if name == "target" and planes.size and planes.max() == 1:
            raise ValueError("target holds 0 and 1; uint8 masks are 0 and 255, others are bool")
        return planes >= least_level(thresholds).astype(np.uint8)[:, None, None]
    return planes >= thresholds.astype(planes.dtype)[:, None, None]


def in_255ths(planes: NDArray[Any]) -> NDArray[np.uint8]:
    """Probabilities in 255ths."""
    _check_values("prediction", planes)
    if planes.dtype == np.bool_:
        return planes.astype(np.uint8) * np.uint8(255)
    if planes.dtype == np.uint8:
        return planes.astype(np.uint8, copy=False)
    return np.rint(planes.astype(np.float32) * np.float32(255.0)).astype(np.uint8)


def _check_values(name: str, planes: NDArray[Any]) -> None:
    if planes.dtype.kind == "f":
        least, most = (planes.min(), planes.max()) if planes.size else (0.0, 0.0)
        if not (least >= 0.0 and most <= 1.0):  # NaN is not
            raise ValueError(
                f"{name} must hold probabilities in [0, 1], got {least:g} to {most:g}; "
                "logits need a sigmoid first"
            )
    elif planes.dtype not in (np.bool_, np.uint8):
        raise ValueError(f"{name} must be bool, uint8 in 0..255 or float, got {planes.dtype}")
