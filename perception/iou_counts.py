"""Pixels counted once, for every question about IoU: by frame, region and threshold.

The terms and the rule for empty channels are those of ``metrics.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.kernels.jit import kernel

from .metrics import (
    Floats,
    Masks,
    as_batches,
    checked_thresholds,
    in_255ths,
    least_level,
    occupied_pixels,
    ratio,
)

THRESHOLDS = tuple(step / 20 for step in range(1, 20))
"""0.05 to 0.95: where the counts are taken unless told otherwise."""


@dataclass(frozen=True, eq=False)
class IoUCounts:
    """Pixels counted frame by frame, region by region, at many thresholds.

    From them come dataset-level and per-frame IoU of any subset of frames and regions, and the
    best thresholds, without another look at the images. :func:`iou_counts` makes them of a batch,
    :meth:`merged` joins batches; 19 thresholds take 160 bytes a frame, channel and region.

    Attributes:
        thresholds: (C, T).
        hits: (F, R, C, T) int32, pixels that are predicted and occupied.
        predicted: (F, R, C, T) int32, pixels that are predicted.
        actual: (F, R, C) int32, pixels that are occupied.
    """

    thresholds: Floats
    hits: NDArray[np.int32]
    predicted: NDArray[np.int32]
    actual: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.hits)

    @classmethod
    def merged(cls, parts: Sequence[IoUCounts]) -> IoUCounts:
        """Counts of all frames of several, in order.

        Raises:
            ValueError: None given, or with other thresholds, channels or regions.
        """
        if not parts:
            raise ValueError("there are no counts to merge")
        for part in parts:
            if not (
                np.array_equal(part.thresholds, parts[0].thresholds)
                and part.hits.shape[1:] == parts[0].hits.shape[1:]
            ):
                raise ValueError("counts with other thresholds, channels or regions do not merge")
        return cls(
            parts[0].thresholds,
            np.concatenate([part.hits for part in parts]),
            np.concatenate([part.predicted for part in parts]),
            np.concatenate([part.actual for part in parts]),
        )

    def subset(
        self, frames: ArrayLike | None = None, regions: Sequence[int] | None = None
    ) -> IoUCounts:
        """Counts of some frames, (F,) bool or indices, and some regions, indices; None: all.

        Raises:
            ValueError: A mask of another length.
        """
        chosen: NDArray[np.intp] = np.arange(len(self))
        if frames is not None:
            mask = np.asarray(frames)
            if mask.dtype == np.bool_ and mask.shape != (len(self),):
                raise ValueError(f"frames must be a mask of shape ({len(self)},), got {mask.shape}")
            chosen = chosen[mask] if len(mask) else chosen[:0]
        bands = np.arange(self.hits.shape[1]) if regions is None else np.asarray(regions)
        pick = np.ix_(chosen, bands)
        return IoUCounts(self.thresholds, self.hits[pick], self.predicted[pick], self.actual[pick])

    def at(self, thresholds: Sequence[float] | Floats) -> IoUCounts:
        """Counts at one of the counted thresholds for each channel (C,); T becomes 1.

        Raises:
            ValueError: Another number of them, or one at which nothing was counted.
        """
        wanted = np.asarray(thresholds, dtype=np.float64)
        channels = len(self.thresholds)
        if wanted.shape != (channels,):
            raise ValueError(f"thresholds must be one for each of {channels} channels")
        match = np.isclose(self.thresholds, wanted[:, None], rtol=0.0, atol=1e-9)  # (C, T)
        if not match.any(axis=1).all():
            raise ValueError(f"nothing was counted at thresholds {wanted.tolist()}; count at them")
        each, column = np.arange(channels), match.argmax(axis=1)
        return IoUCounts(
            self.thresholds[each, column][:, None],
            self.hits[:, :, each, column][..., None],
            self.predicted[:, :, each, column][..., None],
            self.actual,
        )

    def dataset_iou(self) -> Floats:
        """IoU over all frames and regions together (C, T); NaN where the union is empty."""
        return self._iou((0, 1))

    def region_iou(self) -> Floats:
        """IoU over all frames, by region (R, C, T); NaN where the union is empty."""
        return self._iou((0,))

    def frame_iou(self) -> Floats:
        """IoU of each frame over all regions (F, C, T); NaN where the union is empty."""
        return self._iou((1,))

    def mean_frame_iou(self) -> Floats:
        """Mean of :meth:`frame_iou` over the frames whose union is not empty (C, T)."""
        iou = self.frame_iou()
        return ratio(np.nansum(iou, axis=0), np.isfinite(iou).sum(axis=0))

    def _iou(self, axes: tuple[int, ...]) -> Floats:
        hits = self.hits.sum(axis=axes, dtype=np.int64)
        union = self.predicted.sum(axis=axes, dtype=np.int64) - hits
        return ratio(hits, union + self.actual.sum(axis=axes, dtype=np.int64)[..., None])


def iou_counts(
    prediction: ArrayLike,
    target: ArrayLike,
    thresholds: Sequence[float] | Floats = THRESHOLDS,
    regions: ArrayLike | None = None,
) -> IoUCounts:
    """Count the pixels of a batch at all thresholds in one pass.

    Args:
        prediction: (N, C, H, W) or (C, H, W): bool, uint8 in 0..255, or float in [0, 1], which
            is rounded to 255ths as on its way through the environment.
        target: The same shape, of any of these kinds; uint8 masks are 0 and 255.
        thresholds: (T,) or (C, T), in (0, 1].
        regions: (H, W) integers: the region of each pixel, 0 to R - 1, or -1 for pixels that do
            not count. None: all are region 0.

    Returns:
        The counts, with F = N frames.

    Raises:
        ValueError: As for ``channel_iou``, or regions of another shape or kind.
    """
    predicted, actual = as_batches(prediction, target)
    frames, channels, height, width = predicted.shape
    wanted = np.asarray(thresholds, dtype=np.float64)
    limits = checked_thresholds(wanted, (channels, wanted.shape[-1] if wanted.ndim else 1))
    labels = np.zeros((height, width), np.int64) if regions is None else np.asarray(regions)
    if labels.shape != (height, width) or labels.dtype.kind not in "iu":
        raise ValueError(
            f"regions must be integers of shape ({height}, {width}), "
            f"got {labels.dtype} of shape {labels.shape}"
        )
    if not labels.size or labels.min() < -1 or labels.max() > 1000:
        raise ValueError("regions must be from 0 to 1000, or -1 where pixels do not count")
    count = max(int(labels.max()) + 1, 1)
    shape = (frames, count, channels, limits.shape[1])
    hits, found = np.empty(shape, np.int32), np.empty(shape, np.int32)
    held = np.empty(shape[:3], np.int32)
    flat = (frames, channels, height * width)
    values = in_255ths(predicted)
    occupied = occupied_pixels("target", actual, np.full(channels, 0.5))
    _count(
        np.ascontiguousarray(values).reshape(flat),
        np.ascontiguousarray(occupied).reshape(flat),
        np.where(labels < 0, count, labels).astype(np.int64).ravel(),
        least_level(limits),
        hits,
        found,
        held,
    )
    return IoUCounts(limits, hits, found, held)


def best_thresholds(counts: IoUCounts) -> Floats:
    """The threshold of each channel (C,) with the highest dataset-level IoU.

    Of equally good ones the one nearest 0.5; 0.5 for a channel whose IoU is NaN.
    """
    iou = counts.dataset_iou()
    score = np.where(np.isnan(iou), -1.0, iou)
    good = score >= score.max(axis=1, keepdims=True)
    far = np.where(good, np.abs(counts.thresholds - 0.5), np.inf)
    best = counts.thresholds[np.arange(len(far)), far.argmin(axis=1)]
    return np.where(np.isnan(iou).all(axis=1), 0.5, best)


def range_bands(geometry: BEVGeometry, edges_m: Sequence[float]) -> NDArray[np.int64]:
    """Regions by distance from the ego's origin, for :func:`iou_counts`.

    Args:
        geometry: Of the BEV.
        edges_m: Rising distances between the bands in metres: n of them make n + 1 bands.

    Returns:
        (size, size): 0 nearer than the first edge, 1 from there on, and so on.

    >>> range_bands(BEVGeometry(), [10.0, 20.0])[[152, 102, 0], 96].tolist()
    [0, 1, 2]
    """
    edges = np.asarray(edges_m, dtype=np.float64)
    if edges.ndim != 1 or not (np.diff(edges, prepend=0.0) > 0.0).all():
        raise ValueError(f"edges_m must be positive and rising, got {edges_m!r}")
    rows, columns = np.indices((geometry.size, geometry.size))
    points = geometry.ego_from_pixel(np.stack([columns, rows], axis=-1))
    return np.digitize(np.hypot(points[..., 0], points[..., 1]), edges).astype(np.int64)


@kernel
def _count(
    prediction: NDArray[np.uint8],  # (N, C, P)
    target: Masks,  # (N, C, P)
    labels: NDArray[np.int64],  # (P,) region; the number of regions where pixels do not count
    levels: NDArray[np.int64],  # (C, T) least uint8 of an occupied pixel
    hits: NDArray[np.int32],
    found: NDArray[np.int32],
    held: NDArray[np.int32],
) -> None:
    """Histograms of the predicted values by region and target, read off at each threshold."""
    frames, channels, pixels = prediction.shape
    regions = hits.shape[1]
    # runs of equal pixels would wait for the same counter: even and odd ones have their own
    histogram = np.empty((2, regions + 1, 2, 256), np.int32)
    above = np.empty((2, 257), np.int32)
    above[:, 256] = 0
    for n in range(frames):
        for c in range(channels):
            histogram[:] = 0
            for p in range(pixels):
                occupied = 1 if target[n, c, p] else 0
                histogram[p & 1, labels[p], occupied, prediction[n, c, p]] += 1
            for r in range(regions):
                for t in range(2):
                    for v in range(255, -1, -1):
                        both = histogram[0, r, t, v] + histogram[1, r, t, v]
                        above[t, v] = above[t, v + 1] + both
                held[n, r, c] = above[1, 0]
                for k in range(levels.shape[1]):
                    level = levels[c, k]
                    hits[n, r, c, k] = above[1, level]
                    found[n, r, c, k] = above[0, level] + above[1, level]
