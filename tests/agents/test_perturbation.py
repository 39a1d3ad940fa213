"""Triangular impulses on simulated time."""

import numpy as np
import pytest

from agents.perturbation import STEERING_IMPULSES, Perturbation, draw_impulses, impulse_at


def test_an_impulse_rises_evenly_to_its_peak_and_falls_again():
    impulses = np.array([[10.0, 2.0, -0.6]])
    times = [9.9, 10.0, 10.5, 11.0, 11.5, 12.0, 12.1]
    values = [impulse_at(impulses, time) for time in times]
    assert values == pytest.approx([0.0, 0.0, -0.3, -0.6, -0.3, 0.0, 0.0])


def test_level_zero_leaves_actions_alone():
    perturbation = Perturbation(0.0, 1, 1000.0)
    clean = np.array([0.3, -0.7], np.float32)
    for time_s in np.arange(0.0, 100.0, 0.1):
        np.testing.assert_array_equal(perturbation.applied(clean, time_s), clean)


def test_the_same_seed_gives_the_same_impulses_whenever_they_are_asked_for():
    one, other = Perturbation(0.7, 4, 200.0), Perturbation(0.7, 4, 200.0)
    clean = np.zeros(2, np.float32)
    times = np.arange(0.0, 200.0, 0.1)
    forward = [one.applied(clean, time_s) for time_s in times]
    backward = [other.applied(clean, time_s) for time_s in times[::-1]][::-1]
    np.testing.assert_array_equal(forward, backward)
    assert np.ptp(forward, axis=0).min() > 0.5
    other_seed = Perturbation(0.7, 5, 200.0)
    assert not np.array_equal([other_seed.applied(clean, t) for t in times], forward)


def test_the_level_scales_how_often_and_how_strongly():
    rng = np.random.default_rng(0)
    weak = draw_impulses(STEERING_IMPULSES, 0.25, 20_000.0, rng)
    strong = draw_impulses(STEERING_IMPULSES, 1.0, 20_000.0, rng)
    assert np.abs(weak[:, 2]).max() <= 0.25 * STEERING_IMPULSES.peak[1]
    assert np.abs(strong[:, 2]).mean() == pytest.approx(4 * np.abs(weak[:, 2]).mean(), rel=0.1)
    assert len(strong) == pytest.approx(20_000.0 / (5.0 + 1.4), rel=0.1)
    assert len(weak) == pytest.approx(20_000.0 / (20.0 + 1.4), rel=0.1)
    # to both sides alike, and never two at a time
    assert abs(np.sign(strong[:, 2]).mean()) < 0.1
    assert (strong[1:, 0] >= strong[:-1, 0] + strong[:-1, 1]).all()


def test_applied_actions_stay_in_their_range():
    perturbation = Perturbation(1.0, 0, 500.0)
    actions = [
        perturbation.applied(np.array([1.0, -1.0], np.float32), time_s)
        for time_s in np.arange(0.0, 500.0, 0.1)
    ]
    assert actions[0].dtype == np.float32
    assert np.abs(actions).max() == 1.0


@pytest.mark.parametrize("level", [-0.1, 1.1, float("nan"), "high"])
def test_a_level_out_of_range_is_named(level):
    with pytest.raises(ValueError, match="perturbation level must be from 0 to 1"):
        Perturbation(level, 0, 10.0)
