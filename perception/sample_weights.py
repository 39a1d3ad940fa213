"""What each sample counts in the loss of each channel, by a training's configuration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bev_driving_env.frames import CHANNELS
from bev_driving_env.training.kde import effective_sample_size, kde_weights

from .actor_density import actor_weights
from .samples import BEVSamples
from .training_config import TrainingConfig

ACTORS = CHANNELS[3:]


def sample_weights(
    samples: BEVSamples, config: TrainingConfig, channels: Sequence[str], *, shown: bool = False
) -> NDArray[np.float32] | None:
    """Weights of a training split, by its clean actions, its actors, or both.

    Args:
        samples: The split.
        config: Which weighting, and its settings.
        channels: Names of the channels that are learned.
        shown: Whether to show how counting the actors goes; it renders every BEV once.

    Returns:
        (n, C) with unit mean in every channel; None if all samples count the same.

    Raises:
        ValueError: Actors shall decide, but none of their channels is learned.
    """
    if config.weighting == "none":
        return None
    weights = np.ones((len(samples), len(channels)))
    if "kde" in config.weighting:
        kde = kde_weights(
            samples.actions(), config.bandwidth, clip=config.clip, temper=config.temper
        )
        weights *= kde[:, None]
    if "actors" in config.weighting:
        learned = [name for name in ACTORS if name in channels]
        if not learned:
            raise ValueError(
                f"weighting {config.weighting!r} needs one of the channels {', '.join(ACTORS)}, "
                f"got {', '.join(channels)}"
            )
        by_actors = actor_weights(actor_shares(samples, shown=shown))
        for name in learned:
            weights[:, list(channels).index(name)] *= by_actors[:, ACTORS.index(name)]
        weights /= weights.mean(axis=0)
    return weights.astype(np.float32)


def actor_shares(samples: BEVSamples, *, shown: bool = False) -> NDArray[np.float64]:
    """Share (n, 3) of the BEV that vehicles, pedestrians and lights cover in each sample."""
    shares = np.empty((len(samples), len(ACTORS)))
    numbers = range(len(samples))
    for number in tqdm(numbers, desc="counting actors", unit="BEV", disable=not shown):
        log, index = samples.locate(number)
        shares[number] = (log.bev(index)[-len(ACTORS) :] >= 128).mean(axis=(1, 2))
    return shares


def effective_sizes(
    weights: NDArray[np.float32] | None, channels: Sequence[str]
) -> dict[str, float] | None:
    """Effective sample size of each channel; None without weights."""
    if weights is None:
        return None
    columns = weights.astype(np.float64).T
    return {
        name: round(effective_sample_size(column), 1)
        for name, column in zip(channels, columns, strict=True)
    }
