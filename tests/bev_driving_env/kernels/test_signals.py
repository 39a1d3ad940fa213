import itertools

import numpy as np
import pytest

from bev_driving_env.kernels.layout import SIGNAL_GREEN, SIGNAL_RED, SIGNAL_YELLOW
from bev_driving_env.kernels.signals import SignalPlan, show_signals

GREEN_S, YELLOW_S, ALL_RED_S = 10.0, 3.0, 2.0
SLOT_S = GREEN_S + YELLOW_S + ALL_RED_S
STEP_S = 0.05
SEEDS = (0, 7, 12345)


@pytest.fixture(scope="module")
def plan(ladder):
    return ladder.traffic().plan


def shown(plan, time_s, seed):
    signals = np.full(len(plan.phase), 77, np.uint8)  # every one must be overwritten
    show_signals(plan, time_s, seed, signals)
    return signals


def film(plan, seed, seconds=100.0):
    """What all signals show (T, S), every 0.05 s."""
    return np.array([shown(plan, k * STEP_S, seed) for k in range(round(seconds / STEP_S))])


def runs(column):
    """What one signal shows, in order, as pairs (state, seconds); cut runs at the ends left out."""
    cuts = np.flatnonzero(np.diff(column)) + 1
    pieces = np.split(column, cuts)[1:-1]
    return [(int(piece[0]), len(piece) * STEP_S) for piece in pieces]


def green_begins_s(plan, seed, signal=0):
    """First time at which a signal turns green."""
    column = film(plan, seed)[:, signal]
    return STEP_S * (
        1 + np.flatnonzero((column[1:] == SIGNAL_GREEN) & (column[:-1] != SIGNAL_GREEN))[0]
    )


def plan_of(*phases):
    """A plan of junctions with so many phases each."""
    junction = np.concatenate([np.full(count, k) for k, count in enumerate(phases)])
    phase = np.concatenate([np.arange(count) for count in phases])
    return SignalPlan(junction, phase, np.array(phases)[junction], GREEN_S, YELLOW_S, ALL_RED_S)


def test_the_towns_signals_take_turns_as_the_kernel_tests_assume(plan):
    assert (plan.green_s, plan.yellow_s, plan.all_red_s) == (GREEN_S, YELLOW_S, ALL_RED_S)
    for junction in np.unique(plan.junction):
        here = plan.junction == junction
        assert sorted(plan.phase[here]) == [0, 1, 2]
        assert set(plan.phases[here]) == {3}


@pytest.mark.parametrize("seed", SEEDS)
def test_never_more_than_one_approach_of_a_junction_may_go(plan, seed):
    going = film(plan, seed) != SIGNAL_RED
    for junction in np.unique(plan.junction):
        together = going[:, plan.junction == junction].sum(axis=1)
        assert set(together) == {0, 1}
        # of each slot of 15 s, all have red in 2
        assert (together == 0).mean() == pytest.approx(ALL_RED_S / SLOT_S, abs=0.03)


@pytest.mark.parametrize("seed", SEEDS)
def test_green_lasts_10_s_yellow_3_s_and_red_the_rest_of_the_cycle(plan, seed):
    wanted = {SIGNAL_GREEN: GREEN_S, SIGNAL_YELLOW: YELLOW_S, SIGNAL_RED: 3 * SLOT_S - 13.0}
    after = {SIGNAL_GREEN: SIGNAL_YELLOW, SIGNAL_YELLOW: SIGNAL_RED, SIGNAL_RED: SIGNAL_GREEN}
    for column in film(plan, seed, 150.0).T:
        seen = runs(column)
        assert {state for state, _ in seen} == set(wanted)
        for state, seconds in seen:
            assert seconds == pytest.approx(wanted[state], abs=1.01 * STEP_S)
        assert all(after[a] == b for (a, _), (b, _) in itertools.pairwise(seen))


@pytest.mark.parametrize("phases", [1, 2, 3, 4])
def test_approaches_have_green_one_after_the_other_with_all_red_between(phases):
    pictures = film(plan_of(phases), 5, 4 * SLOT_S * phases)
    going = pictures != SIGNAL_RED
    who = np.where(going.any(axis=1), going.argmax(axis=1), -1)
    turns = runs(who)
    assert len(turns) >= 2 * phases
    for (a, a_s), (b, b_s) in itertools.pairwise(turns):
        assert (a < 0) != (b < 0)
        for who_goes, seconds in ((a, a_s), (b, b_s)):
            wanted = ALL_RED_S if who_goes < 0 else GREEN_S + YELLOW_S
            assert seconds == pytest.approx(wanted, abs=1.01 * STEP_S)
    order = [a for a, _ in turns if a >= 0]
    assert all(b == (a + 1) % phases for a, b in itertools.pairwise(order))


def test_another_episode_or_junction_begins_elsewhere_in_its_cycle():
    plan = plan_of(3, 3)
    starts = [green_begins_s(plan, seed, signal) for seed in range(6) for signal in (0, 3)]
    assert np.diff(np.sort(starts)).min() > 0.0
    assert np.ptp(starts) > SLOT_S


def test_after_a_cycle_all_repeats(plan):
    for seed in SEEDS:
        for time_s in np.random.default_rng(seed).uniform(0.0, 1000.0, 100):
            now, later = shown(plan, time_s, seed), shown(plan, time_s + 3 * SLOT_S, seed)
            np.testing.assert_array_equal(now, later)


def test_what_is_shown_depends_on_nothing_but_time_and_seed(plan):
    times = np.random.default_rng(0).uniform(0.0, 200.0, 50)
    forwards = [shown(plan, time_s, 3) for time_s in times]
    backwards = [shown(plan, time_s, 3) for time_s in times[::-1]]
    np.testing.assert_array_equal(forwards, backwards[::-1])


def test_a_plan_without_signals_changes_nothing(ladder):
    signals = np.full(len(ladder.signals), 77, np.uint8)
    show_signals(ladder.traffic().no_plan, 12.0, 0, signals)
    assert (signals == 77).all()
