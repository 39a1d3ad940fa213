"""Shapley values against their definition, and what they must be by symmetry."""

import itertools

import numpy as np
import pytest

from benchmarks.shapley import coalitions, shapley_values


def by_orders(worth, players):
    """The mean over all orders of what a player adds when it joins."""
    added = dict.fromkeys(players, 0.0)
    orders = list(itertools.permutations(players))
    for order in orders:
        for k, player in enumerate(order):
            before = frozenset(order[:k])
            added[player] += (worth[before | {player}] - worth[before]) / len(orders)
    return added


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_they_are_the_mean_over_all_orders_and_add_up_to_the_whole(count):
    players = [f"channel{k}" for k in range(count)]
    rng = np.random.default_rng(count)
    worth = {each: float(rng.uniform(0, 600)) for each in coalitions(players)}
    values = shapley_values(worth)
    assert values == pytest.approx(by_orders(worth, players))
    whole, none = worth[frozenset(players)], worth[frozenset()]
    assert sum(values.values()) == pytest.approx(whole - none)


def test_who_changes_nothing_is_worth_nothing():
    worth = {each: 100.0 * ("route" in each) for each in coalitions(["road", "route", "lane"])}
    assert shapley_values(worth) == pytest.approx({"lane": 0.0, "road": 0.0, "route": 100.0})


def test_a_missing_coalition_is_named():
    with pytest.raises(ValueError, match=r"worth of \['a'\] is missing"):
        shapley_values({frozenset(): 0.0, frozenset("ab"): 1.0, frozenset("b"): 1.0})
