"""Whose fault it was, by Shapley value: what errors of each channel cost, over all orders.

Shapley, "A Value for n-Person Games", 1953. Players are channels; a coalition's worth is what the
drive comes to when these channels are true and the others are predicted.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

Coalition = frozenset[str]


def coalitions(players: Sequence[str]) -> list[Coalition]:
    """All subsets, the empty one first, the whole last.

    >>> [sorted(each) for each in coalitions(["lane", "road"])]
    [[], ['lane'], ['road'], ['lane', 'road']]
    """
    return [
        frozenset(chosen)
        for size in range(len(players) + 1)
        for chosen in itertools.combinations(players, size)
    ]


def shapley_values(worth: Mapping[Coalition, float]) -> dict[str, float]:
    """What each player adds on average over all orders in which they could join.

    Args:
        worth: Of every subset of the players.

    Returns:
        Value by player; they add up to the worth of all less that of none.

    Raises:
        ValueError: A subset is missing.

    >>> shapley_values({frozenset(): 0.0, frozenset("a"): 1.0, frozenset("b"): 0.0,
    ...                 frozenset("ab"): 3.0})
    {'a': 2.0, 'b': 1.0}
    """
    players = sorted(frozenset().union(*worth))
    missing = [each for each in coalitions(players) if each not in worth]
    if missing:
        raise ValueError(f"the worth of {sorted(missing[0])} is missing")
    count = len(players)
    values = {}
    for player in players:
        others = [name for name in players if name != player]
        terms = [
            math.factorial(len(each))
            * math.factorial(count - len(each) - 1)
            * (worth[each | {player}] - worth[each])
            for each in coalitions(others)
        ]
        values[player] = math.fsum(terms) / math.factorial(count)
    return values
