"""Weights that make rare actions count more: the inverse of their kernel density.

The paper (section "Kernel Density Estimation for Segmentation Training") weighs every training
sample by the inverse of the density of its action, normalised to unit mean. Its equation of the
density divides by N h, which belongs to one dimension; here it is N h^2, as actions have two.
The constant cancels in the weights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import is_number, require_positive

Floats = NDArray[np.float64]

BANDWIDTH = 0.05
"""Standard deviation of the kernel, in units of the action. The paper gives none. Commands that
differ by so little are the same manoeuvre; Scott's rule gives 0.03 on our drives, but shrinks as
samples are added, so that the weight of a turn would depend on the length of the log."""

METHODS = ("auto", "exact", "binned")
EXACT_UP_TO = 20_000
"""Samples up to which "auto" compares every pair."""

GRID = 512
CELLS_PER_BANDWIDTH = 10
"""The grid of the binned estimate gets finer than ``GRID`` where the kernel asks for it."""

FINEST = 0.01
"""Smallest bandwidth of the binned estimate, in units of the action: a grid of 2,004 cells."""

_PAIRS = 1 << 17  # a chunk of this many pairs stays in the processor's cache
_ROUNDING = 1e-6  # float32 commands may leave [-1, 1] by so much


def kde_weights(
    actions: ArrayLike,
    bandwidth: float = BANDWIDTH,
    *,
    method: str = "auto",
    clip: float | None = None,
    temper: float = 1.0,
) -> Floats:
    """Weights of samples by the inverse density of their actions (the paper's ``w_i``).

    Without ``clip`` and ``temper`` these are the paper's weights. They are heavy-tailed: on 70,538
    steps of the expert the largest is 560 means, and :func:`effective_sample_size` is 1 % of the
    steps; it is 22 % with ``temper=0.5``, 18 % with ``clip=10``.

    Args:
        actions: (n, 2) acceleration and steering in [-1, 1]: the clean ones, not the perturbed.
        bandwidth: Standard deviation of the Gaussian kernel, in units of the action.
        method: ``"exact"``, ``"binned"``, or ``"auto"``: exact up to ``EXACT_UP_TO`` samples.
        clip: Largest weight, in means; what is cut off is shared by all others. None: no limit.
        temper: Exponent of the inverse density in [0, 1]: 1 is the paper's, 0 makes all equal.

    Returns:
        (n,) positive weights with unit mean.

    Raises:
        ValueError: Actions of another shape or range, or a setting out of range.

    >>> kde_weights([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.5, 1.0]]).round(3).tolist()
    [0.667, 0.667, 0.667, 2.0]
    """
    samples = _checked_actions("actions", actions)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    exact = method == "exact" or (method == "auto" and len(samples) <= EXACT_UP_TO)
    density = exact_density if exact else binned_density
    return inverse_density_weights(density(samples, bandwidth), clip=clip, temper=temper)


def exact_density(actions: ArrayLike, bandwidth: float, at: ArrayLike | None = None) -> Floats:
    """Gaussian kernel density of actions, from every pair (the paper's ``g``).

    The time grows with n x m (1 to 3 s for 20,000 squared), the memory does not.

    Args:
        actions: (n, 2) in [-1, 1].
        bandwidth: Standard deviation of the kernel, in units of the action.
        at: (m, 2) in [-1, 1]: where to take the density; None: at the actions themselves.

    Returns:
        (m,) density per unit of action squared; it integrates to 1 over the plane.

    Raises:
        ValueError: Points of another shape or range, or a bandwidth that is not positive.
    """
    samples, points = _checked_points(actions, at)
    require_positive("bandwidth", bandwidth)
    x, y = samples.T / bandwidth
    density = np.empty(len(points))
    rows = max(1, _PAIRS // len(samples))
    square, other = np.empty((2, rows, len(samples)))
    for first in range(0, len(points), rows):
        some = points[first : first + rows] / bandwidth
        s, o = square[: len(some)], other[: len(some)]
        np.subtract(some[:, :1], x, out=s)
        np.subtract(some[:, 1:], y, out=o)
        s *= s
        o *= o
        s += o
        s *= -0.5
        density[first : first + rows] = np.exp(s, out=s).sum(axis=1)
    return density / (len(samples) * 2.0 * math.pi * bandwidth**2)


def binned_density(actions: ArrayLike, bandwidth: float, at: ArrayLike | None = None) -> Floats:
    """Gaussian kernel density of actions, by way of a grid; the time hardly grows with n.

    Samples are spread over 4 x 4 cells by cubic interpolation's weights, the grid is multiplied
    by the Gaussian of the distance of its rows and of its columns, and read with the same
    weights. Linear binning and a filter that ends at a few bandwidths would be as good where
    samples are dense. Where a lonely one lies some bandwidths from a hundred thousand others,
    though, it is the kernel's tail that counts: there linear weights are off by percents. At
    the samples the density is at least what one sample contributes to itself, and the relative
    error stays below 0.1 % even then.

    Args:
        actions: (n, 2) in [-1, 1].
        bandwidth: Standard deviation of the kernel, in units of the action, at least ``FINEST``.
        at: (m, 2) in [-1, 1]: where to take the density; None: at the actions themselves. Where
            it is far below one sample's contribution to itself only the absolute error is small.

    Returns:
        (m,) density per unit of action squared; it integrates to 1 over the plane.

    Raises:
        ValueError: Points of another shape or range, or a bandwidth that is too small.
    """
    samples, points = _checked_points(actions, at)
    require_positive("bandwidth", bandwidth)
    if bandwidth < FINEST:
        raise ValueError(
            f"bandwidth must be at least {FINEST} for the binned density, got {bandwidth!r}; "
            'a smaller one needs method="exact"'
        )
    size = max(GRID, math.ceil(2.0 * CELLS_PER_BANDWIDTH / bandwidth) + 4)
    cell = 2.0 / (size - 4)  # the outer cells are there for interpolation at the ends
    counts = np.zeros(size * size)
    rows, columns = _stencil(samples[:, 0], size), _stencil(samples[:, 1], size)
    for i, row_weights in rows:
        for j, column_weights in columns:
            counts += np.bincount(i * size + j, row_weights * column_weights, size * size)
    steps = np.arange(size) * (cell / bandwidth)
    kernel = np.exp(-0.5 * np.subtract.outer(steps, steps) ** 2)
    smooth = (kernel @ counts.reshape(size, size) @ kernel).ravel()
    if at is not None:
        rows, columns = _stencil(points[:, 0], size), _stencil(points[:, 1], size)
    density = np.zeros(len(points))
    for i, row_weights in rows:
        for j, column_weights in columns:
            density += smooth[i * size + j] * (row_weights * column_weights)
    return np.maximum(density, 0.0) / (len(samples) * 2.0 * math.pi * bandwidth**2)


def inverse_density_weights(
    density: ArrayLike, *, clip: float | None = None, temper: float = 1.0
) -> Floats:
    """Weights in proportion to ``density ** -temper``, with unit mean.

    Args:
        density: (n,) positive, in any unit.
        clip: Largest weight, in means, at least 1; what is cut off is shared by all others, so
            that the limit holds and the mean is 1. None: no limit.
        temper: Exponent in [0, 1].

    Returns:
        (n,) positive weights with unit mean.

    Raises:
        ValueError: Densities that are not positive and finite, or a setting out of range.

    >>> inverse_density_weights([0.1, 1.0, 1.0], clip=2.0).round(3).tolist()
    [2.0, 0.5, 0.5]
    """
    values = np.asarray(density, dtype=np.float64)
    if values.ndim != 1 or not len(values):
        raise ValueError(f"density must have shape (n,), n at least 1, got {values.shape}")
    if not (np.isfinite(values).all() and values.min() > 0.0):
        raise ValueError(f"density must be positive and finite, got {values.min()} as the least")
    _check_tempering(clip, temper)
    weights = (values / values.max()) ** -temper
    weights /= weights.mean()
    if clip is not None and weights.max() > clip:
        weights = np.minimum(weights, _cap(weights, clip))
        weights /= weights.mean()
    return weights


def effective_sample_size(weights: ArrayLike) -> float:
    """How many equally weighted samples say as much: ``sum(w)^2 / sum(w^2)`` (Kish).

    Args:
        weights: (n,) not negative, at least one of them positive.

    Raises:
        ValueError: Other weights.

    >>> effective_sample_size([1.0, 1.0, 0.0, 0.0])
    2.0
    """
    values = np.asarray(weights, dtype=np.float64)
    if values.ndim != 1 or not (np.isfinite(values).all() and (values >= 0.0).all()):
        raise ValueError(f"weights must be (n,), finite and not negative, got {values}")
    if not values.any():
        raise ValueError("weights must hold a positive one")
    values = values / values.max()  # squares neither overflow nor vanish
    return float(values.sum() ** 2 / (values**2).sum())


def _stencil(values: Floats, size: int) -> list[tuple[NDArray[np.intp], Floats]]:
    """The four nodes around each value in [-1, 1] and the weights of cubic interpolation."""
    position = (values + 1.0) * (0.5 * (size - 4)) + 1.0  # in cells; -1 lies on node 1
    first = np.minimum(position.astype(np.intp), size - 3)
    t = position - first
    below, above, beyond = t + 1.0, t - 1.0, t - 2.0
    weights = (
        t * above * beyond / -6.0,
        below * above * beyond / 2.0,
        below * t * beyond / -2.0,
        below * t * above / 6.0,
    )
    return [(first + offset, weight) for offset, weight in zip((-1, 0, 1, 2), weights, strict=True)]


def _cap(weights: Floats, clip: float) -> float:
    """The number c with ``c = clip * mean(minimum(weights, c))``."""
    rising = np.sort(weights)
    kept = np.arange(len(rising), 0, -1)  # none cut, the largest cut, the two largest ...
    rest = len(rising) - clip * (len(rising) - kept)
    caps = clip * np.cumsum(rising)[kept - 1] / np.where(rest > 0.0, rest, np.nan)
    fits = rising[kept - 1] <= caps * (1.0 + 1e-12)
    return float(caps[np.argmax(fits)])


def _check_tempering(clip: float | None, temper: float) -> None:
    if not (is_number(temper) and 0.0 <= temper <= 1.0):
        raise ValueError(
            f"temper must be from 0 (all equal) to 1 (inverse density), got {temper!r}"
        )
    if clip is not None and not (is_number(clip) and clip >= 1.0):
        raise ValueError(f"clip must be at least 1 (times the mean) or None, got {clip!r}")


def _checked_points(actions: ArrayLike, at: ArrayLike | None) -> tuple[Floats, Floats]:
    samples = _checked_actions("actions", actions)
    return samples, samples if at is None else _checked_actions("at", at)


def _checked_actions(name: str, actions: ArrayLike) -> Floats:
    values = np.asarray(actions, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 2 or not len(values):
        raise ValueError(f"{name} must have shape (n, 2), n at least 1, got {values.shape}")
    if not (np.abs(values) <= 1.0 + _ROUNDING).all():  # NaN is not
        raise ValueError(
            f"{name} must be in [-1, 1], got values from {values.min()} to {values.max()}"
        )
    return np.clip(values, -1.0, 1.0)
