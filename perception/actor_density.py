"""Weights for the loss of the actors' channels: rare numbers of actors count more.

The paper weighs by the density of the ego's actions (``bev_driving_env.training.kde``) and
proposes, for vehicles, pedestrians and lights, the density of dynamic agents in the dataset as
future work. This is it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bev_driving_env.training.kde import inverse_density_weights

ONE_ACTOR = (10.0 / 38.4**2, 2.56 / 38.4**2, 105.0 / 192**2)
"""Share of the default BEV that one vehicle (5 m x 2 m), one pedestrian (1.6 m x 1.6 m) and one
stop line (3.5 m, 6 px thick) cover."""


def actor_weights(
    shares: ArrayLike,
    *,
    clip: float | None = None,
    temper: float = 0.5,
    one_actor: ArrayLike = ONE_ACTOR,
) -> NDArray[np.float64]:
    """Weights of samples for the loss of the actors' channels, by how many actors they show.

    For each channel the samples fall into classes: none, one, 2-3, 4-7, 8-15 ... actors, from
    the share of pixels they cover; anything visible is at least one. A class's frequency f is
    its density, the weight is ``f ** -temper``. Samples that show none never weigh more than the
    lightest that show some: in dense traffic they are rare, too, but there is little to learn.

    Args:
        shares: (n, 3) share of the BEV's pixels that vehicles, pedestrians and lights cover.
        clip: As for :func:`~bev_driving_env.training.kde.inverse_density_weights`.
        temper: As there. A few samples with fifteen pedestrians should not rule: 0.5.
        one_actor: (3,) share that one actor covers.

    Returns:
        (n, 3) positive weights, each column with unit mean: one factor per sample and channel.
        Their mean over the columns is one per sample.

    Raises:
        ValueError: Shares of another shape or range, or a setting out of range.

    >>> shares = [[0.0, 0.0, 0.0]] * 4 + [[0.007, 0.0, 0.0]]
    >>> actor_weights(shares).round(3).tolist()[3:]
    [[0.833, 1.0, 1.0], [1.667, 1.0, 1.0]]
    """
    values, unit = np.asarray(shares, np.float64), np.asarray(one_actor, np.float64)
    if values.ndim != 2 or values.shape[1] != 3 or not len(values):
        raise ValueError(f"shares must have shape (n, 3), n at least 1, got {values.shape}")
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise ValueError(
            f"shares must be in [0, 1], got {values.min()} to {values.max()}; "
            "divide counts of pixels by the pixels of the BEV"
        )
    if unit.shape != (3,) or not ((unit > 0.0) & (unit <= 1.0)).all():
        raise ValueError(f"one_actor must be three shares in (0, 1], got {one_actor!r}")
    actors = np.maximum(np.rint(values / unit), values > 0.0)
    classes = np.frexp(actors)[1]  # 0, 1, 2-3, 4-7 ... actors: 0, 1, 2, 3 ...
    columns = [_class_density(column) for column in classes.T]
    return np.stack(
        [inverse_density_weights(it, clip=clip, temper=temper) for it in columns], axis=1
    )


def _class_density(classes: NDArray[np.int32]) -> NDArray[np.float64]:
    """Frequency of each sample's class (n,); of class 0 at least that of any other."""
    counts = np.bincount(classes)
    if classes.any():
        counts[0] = counts.max()
    return counts[classes] / len(classes)
