from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from benchmarks.report.intervals import ratio_interval, resampling_weights, share_interval

RESAMPLES = 20_000


def test_the_interval_of_a_mean_is_scipys_percentile_bootstrap():
    values = np.random.default_rng(3).gamma(2.0, 50.0, size=12)
    weights = resampling_weights(list(range(12)), RESAMPLES)
    ours = ratio_interval(values, np.ones(12), weights)
    theirs = stats.bootstrap(
        (values,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=1
    ).confidence_interval
    spread = theirs.high - theirs.low
    assert ours == pytest.approx((theirs.low, theirs.high), abs=0.03 * spread)


def test_the_interval_of_a_ratio_of_sums_is_scipys_paired_bootstrap():
    rng = np.random.default_rng(4)
    wholes = rng.integers(100, 1000, size=10).astype(float)
    hits = wholes * rng.uniform(0.3, 0.9, size=10)
    ours = ratio_interval(hits, wholes, resampling_weights(list(range(10)), RESAMPLES))
    theirs = stats.bootstrap(
        (hits, wholes),
        lambda a, b, axis=-1: a.sum(axis) / b.sum(axis),
        paired=True,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=1,
    ).confidence_interval
    spread = theirs.high - theirs.low
    assert ours == pytest.approx((theirs.low, theirs.high), abs=0.03 * spread)


def test_each_set_has_as_many_drives_as_there_are():
    weights = resampling_weights([0, 0, 1, 1, 2, 2], 500)
    assert weights.shape == (500, 6)
    assert (weights.sum(axis=1) == 6.0).all()


def test_further_seeds_of_the_same_routes_do_not_make_the_interval_narrower():
    values = np.array([10.0, 50.0, 90.0, 30.0, 70.0])
    one = ratio_interval(values, np.ones(5), resampling_weights(list(range(5)), RESAMPLES))
    # four seeds that all drive alike
    routes = [route for route in range(5) for _ in range(4)]
    four = ratio_interval(np.repeat(values, 4), np.ones(20), resampling_weights(routes, RESAMPLES))
    assert four == pytest.approx(one, abs=2.0)


def test_routes_with_different_numbers_of_seeds_are_drawn_alike():
    weights = resampling_weights(["a", "b", "b", "b"], RESAMPLES)
    assert weights[:, 0].mean() == pytest.approx(1.0, abs=0.03)
    assert weights[:, 1:].sum(axis=1).mean() == pytest.approx(3.0, abs=0.09)
    assert weights[:, 1].mean() == pytest.approx(1.0, abs=0.03)


def test_a_ratio_without_denominator_has_no_interval():
    low, high = ratio_interval([0.0, 0.0], [0.0, 0.0], resampling_weights([0, 1], 50))
    assert np.isnan([low, high]).all()


def test_wilsons_interval_is_not_empty_at_the_ends():
    low, high = share_interval(5, 5)
    # (z^2 / n) / (1 + z^2 / n) lies above
    z2 = stats.norm.ppf(0.975) ** 2
    assert low == pytest.approx(1.0 - z2 / (5.0 + z2))
    assert high == 1.0
