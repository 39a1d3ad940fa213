"""Rank correlations with intervals."""

import numpy as np
import pytest
from scipy import stats

from benchmarks.correlation import (
    advantage,
    equal_but_different,
    order_agreement,
    rank_correlation,
)


def test_they_are_scipys_and_lie_in_their_intervals():
    rng = np.random.default_rng(0)
    metric = rng.uniform(size=120)
    outcome = metric + rng.normal(0.0, 0.3, 120)
    found = rank_correlation(metric, outcome, resamples=300)
    assert found.variants == 120
    assert found.spearman == pytest.approx(stats.spearmanr(metric, outcome).statistic)
    assert found.kendall == pytest.approx(stats.kendalltau(metric, outcome).statistic)
    for value, (low, high) in (
        (found.spearman, found.spearman_interval),
        (found.kendall, found.kendall_interval),
    ):
        assert low < value < high
        assert high - low < 0.4


def test_the_interval_covers_no_correlation_where_there_is_none():
    rng = np.random.default_rng(1)
    low, high = rank_correlation(*rng.uniform(size=(2, 60)), resamples=300).spearman_interval
    assert low < 0.0 < high


def test_only_order_counts_and_what_is_unknown_is_left_out():
    metric = np.array([0.1, 0.2, 0.5, np.nan, 0.9])
    found = rank_correlation(metric, np.exp(10.0 * np.nan_to_num(metric)), resamples=50)
    assert (found.variants, found.spearman, found.kendall) == (4, 1.0, 1.0)


def test_too_few_variants_are_an_error():
    with pytest.raises(ValueError, match="at least 3 variants with both, got 2"):
        rank_correlation([0.1, 0.2, np.nan], [1.0, 2.0, 3.0])


def test_pairs_that_the_metric_cannot_tell_apart_come_largest_gap_first():
    metric, outcome = [0.50, 0.505, 0.495, 0.9], [600.0, 100.0, 300.0, 0.0]
    pairs = equal_but_different(metric, outcome, 0.011, 150.0)
    assert [(pair.better, pair.worse) for pair in pairs] == [(0, 1), (0, 2), (2, 1)]


def test_intervals_are_those_of_scipy_on_resampled_sets():
    rng = np.random.default_rng(2)
    metric = rng.integers(0, 6, 30).astype(float)  # with ties
    outcome = metric + rng.integers(0, 8, 30)
    found = rank_correlation(metric, outcome, seed=5, resamples=100)
    drawn = np.random.default_rng(5).integers(30, size=(100, 30))
    for function, interval in (
        (stats.spearmanr, found.spearman_interval),
        (stats.kendalltau, found.kendall_interval),
    ):
        values = [function(metric[some], outcome[some]).statistic for some in drawn]
        assert interval == pytest.approx(np.quantile(values, [0.025, 0.975]))


def test_one_metric_is_better_than_another_by_the_difference_on_the_same_sets():
    rng = np.random.default_rng(3)
    outcome = rng.uniform(size=80)
    good, worse = outcome + rng.normal(0.0, 0.1, 80), outcome + rng.normal(0.0, 0.6, 80)
    found = advantage(good, worse, outcome, resamples=300)
    rhos = [stats.spearmanr(metric, outcome).statistic for metric in (good, worse)]
    assert found.difference == pytest.approx(rhos[0] - rhos[1])
    assert 0.0 < found.interval[0] < found.difference < found.interval[1]
    assert advantage(good, good**3, outcome, resamples=50).interval == pytest.approx((0.0, 0.0))
    with pytest.raises(ValueError, match=r"got \(80,\), \(79,\) and \(80,\)"):
        advantage(good, worse[1:], outcome)


def test_order_agreement_is_the_share_of_pairs_in_order():
    rng = np.random.default_rng(4)
    metric, outcome = rng.uniform(size=(2, 20))
    pairs = [(a, b) for a in range(20) for b in range(20) if outcome[a] > outcome[b]]
    expected = sum(metric[a] > metric[b] for a, b in pairs) / len(pairs)
    assert order_agreement(metric, outcome) == pytest.approx(expected)
    assert np.isnan(order_agreement(metric, np.ones(20)))
