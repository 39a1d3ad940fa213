"""Weights by the number of visible actors."""

import numpy as np
import pytest

from perception.actor_density import ONE_ACTOR, actor_weights


def shares(counts):
    """Shares (n, 3) of as many whole vehicles; no pedestrians, no lights."""
    table = np.zeros((len(counts), 3))
    table[:, 0] = np.array(counts) * ONE_ACTOR[0]
    return table


def test_a_sample_weighs_the_inverse_frequency_of_its_class():
    counts = [0] * 8 + [1] * 4 + [2] * 1 + [3] * 1 + [5] * 1 + [7] * 1
    weights = actor_weights(shares(counts), temper=1.0)[:, 0]
    expected = np.array([1 / 8] * 8 + [1 / 4] * 4 + [1 / 2] * 4)
    np.testing.assert_allclose(weights, expected / expected.mean())


def test_the_corner_of_a_vehicle_counts_as_one_and_drawing_errors_do_not_matter():
    weights = actor_weights(shares([0, 0, 0, 0, 0, 1e-3, 0.6, 1.0, 1.3, 1.97, 2.04]))[:, 0]
    assert len(set(weights[5:9])) == 1
    assert weights[9] == weights[10] > weights[8]


def test_in_dense_traffic_empty_samples_weigh_no_more_than_the_commonest_others():
    weights = actor_weights(shares([0] + [1] * 6 + [4] * 3))[:, 0]
    assert weights[0] == weights[1] == weights.min()


def test_channels_are_weighed_each_by_itself_with_unit_mean():
    rng = np.random.default_rng(0)
    table = rng.random((50, 3)) * (rng.random((50, 3)) < 0.3) * 0.02
    weights = actor_weights(table, clip=3.0)
    np.testing.assert_allclose(weights.mean(axis=0), 1.0)
    assert weights.max() <= 3.0 + 1e-9
    table[:, 1] = 0.0
    assert (actor_weights(table)[:, 1] == 1.0).all()
    np.testing.assert_array_equal(actor_weights(table, clip=3.0)[:, 0], weights[:, 0])


def test_tempering_takes_a_power():
    table = shares([0] * 9 + [1])
    full, root = actor_weights(table, temper=1.0)[:, 0], actor_weights(table)[:, 0]
    assert full[-1] / full[0] == pytest.approx(9.0)
    assert root[-1] / root[0] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("table", "setting", "named"),
    [
        (np.zeros((4, 2)), {}, r"shares must have shape \(n, 3\), n at least 1, got \(4, 2\)"),
        (np.zeros((0, 3)), {}, r"got \(0, 3\)"),
        ([[250.0, 0.0, 0.0]], {}, "got 0.0 to 250.0; divide counts of pixels"),
        ([[np.nan, 0.0, 0.0]], {}, r"shares must be in \[0, 1\]"),
        (np.zeros((4, 3)), {"one_actor": (0.1, 0.0, 0.1)}, "one_actor must be three shares"),
        (np.zeros((4, 3)), {"temper": -1.0}, "temper must be"),
    ],
)
def test_other_shares_and_settings_are_refused(table, setting, named):
    with pytest.raises(ValueError, match=named):
        actor_weights(table, **setting)
