from functools import partial

import numpy as np
import pytest

from bev_driving_env.kernels.crowd import (
    empty_crowd,
    find_contacts,
    find_near,
    hash_cells,
    touches_vehicle,
)
from bev_driving_env.kernels.layout import ACTOR_COLUMNS, HEADING, LENGTH, WIDTH, X, Y
from bev_driving_env.kernels.walks import WALK_STATION
from bev_driving_env.towns.sidewalks import build_sidewalks

from .walk_scene import gaps, people_on_walk


@pytest.fixture(scope="module")
def sidewalks(ladder):
    return build_sidewalks(ladder)


@pytest.fixture
def alone(sidewalks):
    return partial(people_on_walk, sidewalks)


def scattered(count, side_m, rng):
    """Rows of people anywhere in a square around the origin, every tenth slot empty."""
    rows = np.zeros((count, ACTOR_COLUMNS))
    rows[:, [X, Y]] = rng.uniform(-side_m / 2.0, side_m / 2.0, (count, 2))
    rows[:, LENGTH] = rows[:, WIDTH] = rng.uniform(0.35, 0.6, count)
    rows[::10] = 0.0
    return rows


@pytest.mark.parametrize("side_m", [20.0, 400.0])
def test_who_is_near_is_found_by_cells_as_by_comparing_everybody(side_m):
    rows = scattered(300, side_m, np.random.default_rng(2))
    people = rows[:, LENGTH] > 0.0
    distance = np.hypot(*(rows[:, None, [X, Y]] - rows[None, :, [X, Y]]).T)
    expected = (distance < 1.3) & people & people[:, None] & ~np.eye(300, dtype=bool)
    crowd = empty_crowd(300)
    hash_cells(rows, 1.3, crowd)
    np.testing.assert_array_equal(crowd.crowded, expected.any(axis=1))
    assert crowd.crowded.any()
    for i in np.flatnonzero(people):
        count = find_near(rows, i, 1.3, crowd)
        assert sorted(crowd.near[:count]) == np.flatnonzero(expected[i]).tolist()


def test_contacts_are_those_with_somebody_before(alone):
    street = alone(20.0, 30.0, 20.3, 30.95, 40.0, size=0.6)
    touching = np.ones(5, np.bool_)
    assert find_contacts(street.rows, empty_crowd(5), touching) == 1
    assert touching.tolist() == [False, False, True, False, False]


def test_contacts_are_found_in_a_crush_as_by_comparing_everybody():
    rows = scattered(200, 15.0, np.random.default_rng(3))
    people = np.flatnonzero(rows[:, LENGTH] > 0.0)
    apart = np.full((200, 200), np.inf)
    upper = np.triu_indices(len(people), 1)
    apart[people[upper[0]], people[upper[1]]] = gaps(rows[people])
    expected = (apart < 0.0).any(axis=0)
    touching = np.zeros(200, np.bool_)
    assert find_contacts(rows, empty_crowd(200), touching) == expected.sum()
    np.testing.assert_array_equal(touching, expected)
    assert 20 < expected.sum() < 180


def test_who_touches_another_may_only_move_away(alone):
    street = alone(20.0, 20.5, size=0.6)  # 0.9 m apart would be enough
    before = street.motion[:, WALK_STATION].copy()
    street.step()
    after = street.motion[:, WALK_STATION]
    assert after[0] == before[0]
    assert after[1] > before[1]


@pytest.mark.parametrize("who", ["ego", "vehicle"])
def test_a_vehicle_keeps_people_off_its_box_and_the_gap_around_it(who):
    heading = 0.6
    box = np.array([[3.0, -2.0, heading, 0.0, 4.6, 2.0]])
    ego, vehicles = np.array([-900.0, 0.0, 0.0, 0.0]), np.vstack([np.zeros((1, 6)), box])
    if who == "ego":
        ego, vehicles = box[0, :4].copy(), np.zeros((0, ACTOR_COLUMNS))
    rows = np.array([[50.0, 50.0, 0.0, 0.0, 0.4, 0.4]])
    cos, sin = np.cos(box[0, HEADING]), np.sin(box[0, HEADING])
    keep_m = 0.75 * 0.4 + 0.3
    for ahead, aside in np.random.default_rng(4).uniform(-4.0, 4.0, (500, 2)):
        x, y = 3.0 + ahead * cos - aside * sin, -2.0 + ahead * sin + aside * cos
        distance = np.hypot(max(abs(ahead) - 2.3, 0.0), max(abs(aside) - 1.0, 0.0))
        touches = touches_vehicle(rows, 0, x, y, ego, 2.3, 1.0, vehicles)
        assert touches == (distance < keep_m)
