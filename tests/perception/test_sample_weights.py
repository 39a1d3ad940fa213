"""What samples count in the loss."""

import numpy as np
import pytest

from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.order import open_logs
from bev_driving_env.training.kde import effective_sample_size, kde_weights
from perception.actor_density import actor_weights
from perception.sample_weights import actor_shares, effective_sizes, sample_weights
from perception.samples import BEVSamples
from perception.training_config import TrainingConfig


@pytest.fixture(scope="module")
def samples(log_folder):
    return BEVSamples(open_logs([log_folder]), "train", {"route_map"})


def of(samples, weighting, channels=CHANNELS, **settings):
    return sample_weights(samples, TrainingConfig(weighting=weighting, **settings), channels)


def test_without_weighting_all_count_the_same(samples):
    assert of(samples, "none") is None
    assert effective_sizes(None, CHANNELS) is None


def test_kde_weighs_by_the_clean_actions_in_all_channels(samples):
    weights = of(samples, "kde", bandwidth=0.1, clip=3.0, temper=0.7)
    wanted = kde_weights(samples.actions(), 0.1, clip=3.0, temper=0.7)
    assert weights.shape == (len(samples), 6)
    np.testing.assert_allclose(weights, np.repeat(wanted[:, None], 6, axis=1), rtol=1e-6)
    sizes = effective_sizes(weights, CHANNELS)
    assert sizes == dict.fromkeys(CHANNELS, sizes["road"])
    assert sizes["road"] == pytest.approx(effective_sample_size(wanted), abs=0.1)


def test_shares_of_actors_are_counted_in_the_true_bev(samples):
    shares = actor_shares(samples)
    log, index = samples.locate(11)
    wanted = [np.count_nonzero(plane) / 192**2 for plane in log.bev(index)[3:]]
    assert shares[11].tolist() == wanted
    assert shares.any()


def test_actors_weigh_in_their_own_channels_alone(samples):
    channels = ("pedestrians", "road", "vehicles")
    weights = of(samples, "actors", channels)
    wanted = actor_weights(actor_shares(samples))
    np.testing.assert_array_equal(weights[:, 1], 1.0)
    np.testing.assert_allclose(weights[:, 2], wanted[:, 0], rtol=1e-6)
    np.testing.assert_allclose(weights[:, 0], wanted[:, 1], rtol=1e-6)


def test_both_are_multiplied_and_keep_unit_mean(samples):
    both, kde = of(samples, "kde+actors"), of(samples, "kde")
    np.testing.assert_allclose(both.mean(axis=0), 1.0, rtol=1e-5)
    np.testing.assert_allclose(both[:, :3], kde[:, :3], rtol=1e-5)
    product = kde[:, 3] * of(samples, "actors")[:, 3]
    np.testing.assert_allclose(both[:, 3], product / product.mean(), rtol=1e-5)


def test_actors_cannot_weigh_where_none_is_learned(samples):
    with pytest.raises(
        ValueError, match=r"'actors' needs one of the channels vehicles, .*got road"
    ):
        of(samples, "actors", ("road",))
