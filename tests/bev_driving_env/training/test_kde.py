"""Kernel density of actions and its weights, against scikit-learn and closed forms."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.neighbors import KernelDensity

from bev_driving_env.training.kde import (
    binned_density,
    effective_sample_size,
    exact_density,
    inverse_density_weights,
    kde_weights,
)


def drive(count, seed=0):
    """Actions like a drive's: cruising, a fifth of the time turning, some exactly full brake."""
    rng = np.random.default_rng(seed)
    actions = rng.normal((0.1, 0.0), (0.1, 0.02), (count, 2))
    turning = rng.random(count) < 0.2
    actions[turning, 1] += rng.normal(0.0, 0.4, turning.sum())
    actions[rng.random(count) < 0.02] = (-1.0, 0.0)
    return np.clip(actions, -1.0, 1.0)


def lonely_samples(bandwidth, count=155_007):
    """All actions alike but for some at any distance, up to eight bandwidths."""
    rng = np.random.default_rng(1)
    distance, angle = rng.uniform(0.0, 8.0 * bandwidth, 40), rng.uniform(0.0, 2.0 * np.pi, 40)
    crowd = np.full((count - 40, 2), (0.0987, -0.3021))
    lonely = crowd[:40] + distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([np.clip(lonely, -1.0, 1.0), crowd])


def sklearn_density(actions, bandwidth, at):
    estimate = KernelDensity(bandwidth=bandwidth, rtol=0.0, atol=0.0)
    return np.exp(estimate.fit(actions).score_samples(at))


@pytest.mark.parametrize("bandwidth", [0.02, 0.05, 0.3])
def test_the_exact_density_equals_scikit_learn(bandwidth):
    actions = drive(1500)
    expected = sklearn_density(actions, bandwidth, actions)
    np.testing.assert_allclose(exact_density(actions, bandwidth), expected, rtol=1e-9)
    weights = kde_weights(actions, bandwidth, method="exact")
    np.testing.assert_allclose(weights, (1 / expected) / (1 / expected).mean(), rtol=1e-6)


@pytest.mark.parametrize("bandwidth", [0.01, 0.05, 0.3])
def test_the_binned_weights_equal_scikit_learn_within_a_percent(bandwidth):
    actions = drive(2000)
    inverse = 1 / sklearn_density(actions, bandwidth, actions)
    weights = kde_weights(actions, bandwidth, method="binned")
    np.testing.assert_allclose(weights, inverse / inverse.mean(), rtol=0.002)


@pytest.mark.parametrize("bandwidth", [0.02, 0.05, 0.1])
def test_the_binned_density_is_right_for_lonely_samples_far_from_a_crowd(bandwidth):
    actions = lonely_samples(bandwidth)
    expected = sklearn_density(actions, bandwidth, actions[:40])
    assert expected.max() > 1e3 * expected.min()
    np.testing.assert_allclose(binned_density(actions, bandwidth)[:40], expected, rtol=0.001)


@pytest.mark.parametrize("density", [exact_density, binned_density])
def test_one_sample_has_the_density_of_a_gaussian(density):
    at = np.array([[1.0, -1.0], [0.9, -1.0], [0.9, -0.8]])
    squares = np.array([0.0, 0.01, 0.05])
    expected = np.exp(-squares / (2 * 0.1**2)) / (2 * np.pi * 0.1**2)
    np.testing.assert_allclose(density([[1.0, -1.0]], 0.1, at=at), expected, rtol=1e-3)


@pytest.mark.parametrize("density", [exact_density, binned_density])
def test_the_density_integrates_to_one(density):
    axis = np.linspace(-1.0, 1.0, 101)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    total = density([[0.0, 0.1], [0.2, -0.3], [-0.1, 0.2]], 0.08, at=grid).sum() * 0.02**2
    assert total == pytest.approx(1.0, abs=1e-6)


def test_the_method_changes_with_the_number_of_samples(monkeypatch):
    actions = drive(200)
    exact = kde_weights(actions, method="exact")
    binned = kde_weights(actions, method="binned")
    assert not np.array_equal(exact, binned)
    assert np.array_equal(kde_weights(actions), exact)
    monkeypatch.setattr("bev_driving_env.training.kde.EXACT_UP_TO", 199)
    assert np.array_equal(kde_weights(actions), binned)


def test_the_papers_number_of_actions_takes_less_than_half_a_second():
    actions = drive(155_007)
    started = time.process_time()
    weights = kde_weights(actions)
    assert time.process_time() - started < 0.5
    assert weights.shape == (155_007,)
    assert weights.mean() == pytest.approx(1.0)


def test_float32_commands_a_rounding_beyond_the_ends_are_taken():
    ends = np.array([[1.0, -1.0], [np.nextafter(np.float32(1), np.float32(2)), 0.0]], np.float32)
    for method in ("exact", "binned"):
        np.testing.assert_allclose(kde_weights(ends, method=method), [1.0, 1.0], rtol=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=30),
    st.one_of(st.none(), st.floats(1.0, 20.0)),
    st.floats(0.0, 1.0),
)
def test_weights_have_unit_mean_keep_their_order_and_their_limit(density, clip, temper):
    weights = inverse_density_weights(density, clip=clip, temper=temper)
    assert weights.mean() == pytest.approx(1.0)
    assert weights.min() > 0.0
    assert (np.diff(weights[np.argsort(density)[::-1]]) >= -1e-9 * weights.max()).all()
    free = inverse_density_weights(density, temper=temper)
    if clip is not None and free.max() > clip:
        assert weights.max() == pytest.approx(clip)
        below = weights < clip * (1 - 1e-6)
        ratios = weights[below] / free[below]
        assert ratios == pytest.approx(ratios[:1].repeat(len(ratios)))


def test_tempering_takes_a_power_of_the_papers_weights():
    actions = drive(500)
    roots = np.sqrt(kde_weights(actions))
    np.testing.assert_allclose(kde_weights(actions, temper=0.5), roots / roots.mean(), rtol=1e-9)
    assert (kde_weights(actions, temper=0.0) == 1.0).all()


def test_tempering_and_clipping_raise_the_effective_sample_size():
    actions = drive(2000)
    plain = effective_sample_size(kde_weights(actions))
    assert plain < 0.2 * len(actions)
    assert effective_sample_size(kde_weights(actions, temper=0.5)) > 2 * plain
    assert effective_sample_size(kde_weights(actions, clip=5.0)) > 2 * plain


def test_the_effective_sample_size_of_equal_weights_is_their_number():
    assert effective_sample_size(np.full(7, 1e200)) == pytest.approx(7.0)
    assert effective_sample_size([1.0, 3.0]) == pytest.approx(16.0 / 10.0)


@pytest.mark.parametrize(
    ("actions", "named"),
    [
        (np.zeros(4), r"actions must have shape \(n, 2\), n at least 1, got \(4,\)"),
        (np.zeros((0, 2)), r"n at least 1, got \(0, 2\)"),
        ([[0.0, 1.1]], r"actions must be in \[-1, 1\], got values from 0.0 to 1.1"),
        ([[0.0, np.nan]], "actions must be in"),
    ],
)
def test_other_actions_are_refused(actions, named):
    with pytest.raises(ValueError, match=named):
        kde_weights(actions)


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ({"bandwidth": 0.0}, "bandwidth must be a positive number, got 0.0"),
        ({"bandwidth": 0.005, "method": "binned"}, "at least 0.01 .* method=.exact."),
        ({"method": "fft"}, "method must be one of auto, exact, binned, got 'fft'"),
        ({"clip": 0.5}, "clip must be at least 1 .* got 0.5"),
        ({"temper": 1.5}, "temper must be from 0 .* got 1.5"),
    ],
)
def test_settings_out_of_range_are_refused(setting, named):
    with pytest.raises(ValueError, match=named):
        kde_weights([[0.0, 0.0], [0.1, 0.0]], **setting)


@pytest.mark.parametrize("weights", [[], [0.0, 0.0], [1.0, -1.0], [np.nan], [[1.0]]])
def test_weights_without_an_effective_sample_size_are_refused(weights):
    with pytest.raises(ValueError, match="weights must"):
        effective_sample_size(weights)


@pytest.mark.parametrize("density", [[], [0.0, 1.0], [np.inf], [[1.0]]])
def test_densities_that_cannot_be_inverted_are_refused(density):
    with pytest.raises(ValueError, match="density must"):
        inverse_density_weights(density)
