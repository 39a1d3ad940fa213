"""Conflicts between movements: who could touch whom in a junction, until where, who goes first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.rails import (
    CONFLICT_COLUMNS,
    CROSSES,
    DIVERGES,
    MERGES,
    RAIL_HEADING,
    RAIL_X,
    RAIL_Y,
    Rails,
)
from ..kernels.sweep import last_contacts
from .route import TURN_RAD

LARGEST_LENGTH_M = 7.4
LARGEST_WIDTH_M = 2.45
"""The largest vehicle that drives on rails."""
MARGIN_M = 0.2
"""Room around each of two bodies that still counts as touching."""
BEFORE_M = 2.0
"""How far before a movement a body's centre counts as in it: vehicles wait farther back."""
BEYOND_M = 6.0
"""How far beyond a movement a body that goes through it may still be in the way."""
STEP_M = 0.25

STRAIGHT_RANK, LEFT_RANK, STEM_RIGHT_RANK, STEM_LEFT_RANK = 3, 2, 1, 0


def find_conflicts(rails: Rails) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """All pairs of movements whose traffic could touch.

    Movements that part from the same rail, or lead on to the same rail, always are a pair. Others
    are if the boxes of the largest vehicle touch anywhere on them; where one leads on to the other
    vehicles simply follow each other.

    Args:
        rails: The rails; their ``conflicts`` and ``crossings`` are not looked at.

    Returns:
        ``conflict_first`` (G + 1,) and ``conflicts`` (K, 4) as in ``Rails``, the other movements
        of each in ascending order.
    """
    count = len(rails.length)
    part, meet = _sharing(rails)
    leads = _leads(rails)
    pairs = np.argwhere((part | meet | _near(rails)) & ~np.eye(count, dtype=bool))
    pairs = np.ascontiguousarray(pairs, dtype=np.int64)
    mine, other = pairs.T
    last_m = last_contacts(
        rails,
        pairs,
        BEFORE_M,
        BEYOND_M,
        LARGEST_LENGTH_M / 2.0 + MARGIN_M,
        LARGEST_WIDTH_M / 2.0 + MARGIN_M,
        STEP_M,
    )
    relation = np.where(part[mine, other], DIVERGES, np.where(meet[mine, other], MERGES, CROSSES))
    clear_m = np.where(relation == MERGES, rails.length[other], last_m + STEP_M / 2.0)
    follows = leads[mine, other] | leads[other, mine]
    kept = (relation != CROSSES) | (np.isfinite(last_m) & ~follows)
    rank = right_of_way(rails)
    yields = (rank[other] > rank[mine]) & (relation != DIVERGES)
    conflicts = np.empty((int(kept.sum()), CONFLICT_COLUMNS))
    conflicts[:] = np.column_stack([other, relation, clear_m, yields])[kept]
    first = np.concatenate([[0], np.cumsum(np.bincount(mine[kept], minlength=count))])
    return first.astype(np.int64), conflicts


def right_of_way(rails: Rails) -> NDArray[np.int64]:
    """Rank (G,) of each movement where no signal decides; the greater goes first, roads have -1.

    Going straight on and right from a through road comes first, left from it second; a stem, whose
    traffic can only turn, comes last and there right before left.
    """
    turn = rails.samples[rails.first[1:] - 1, RAIL_HEADING]
    turn = turn - rails.samples[rails.first[:-1], RAIL_HEADING]
    # a movement that nothing leads into is judged by itself
    origin = np.where(rails.approach < 0, np.arange(len(turn)), rails.approach)
    through = np.isin(origin, origin[rails.movement & (np.abs(turn) < TURN_RAD)])
    from_through = np.where(turn <= -TURN_RAD, LEFT_RANK, STRAIGHT_RANK)
    from_stem = np.where(turn > 0.0, STEM_RIGHT_RANK, STEM_LEFT_RANK)
    rank = np.where(through, from_through, from_stem)
    return np.where(rails.movement, rank, -1).astype(np.int64)


def movement_clusters(rails: Rails) -> NDArray[np.int64]:
    """Number (G,) of the cluster of connected movements each movement is in; -1 for roads.

    Connected are movements with a conflict between them and those that lead on to each other.
    Clusters are numbered in the order of their first movements.

    Args:
        rails: The rails with their conflicts.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count = len(rails.length)
    linked = _leads(rails) & rails.movement[:, None] & rails.movement
    mine = np.repeat(np.arange(count), np.diff(rails.conflict_first))
    linked[mine, rails.conflicts[:, 0].astype(np.int64)] = True
    _, label = connected_components(csr_array(linked), directed=False)
    cluster = np.full(count, -1, dtype=np.int64)
    numbers: dict[int, int] = {}
    for rail in np.flatnonzero(rails.movement):
        cluster[rail] = numbers.setdefault(int(label[rail]), len(numbers))
    return cluster


def _leads(rails: Rails) -> NDArray[np.bool_]:
    """Whether (G, G) each rail leads on to each other."""
    leads = np.zeros((len(rails.length),) * 2, dtype=bool)
    rail, column = np.nonzero(rails.following >= 0)
    leads[rail, rails.following[rail, column]] = True
    return leads


def _sharing(rails: Rails) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether (G, G) two movements part from a common rail, and whether they lead to one."""
    leads = _leads(rails).astype(np.float32)
    both = rails.movement[:, None] & rails.movement
    return both & (leads.T @ leads > 0.0), both & (leads @ leads.T > 0.0)


def _near(rails: Rails) -> NDArray[np.bool_]:
    """Whether (G, G) two movements come so close that bodies on them might touch."""
    reach_m = BEYOND_M + np.hypot(LARGEST_LENGTH_M, LARGEST_WIDTH_M) / 2.0 + 2.0 * MARGIN_M
    places = rails.samples[:, [RAIL_X, RAIL_Y]]
    low = np.minimum.reduceat(places, rails.first[:-1]) - reach_m  # (G, 2)
    high = np.maximum.reduceat(places, rails.first[:-1]) + reach_m
    meet = (low[:, None] <= high).all(axis=2)
    return meet & meet.T & rails.movement[:, None] & rails.movement
