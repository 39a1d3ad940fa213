from functools import partial

import numpy as np
import pytest

from bev_driving_env.kernels.crossing import mark_occupied
from bev_driving_env.kernels.layout import (
    ACTOR_COLUMNS,
    HEADING,
    SIGNAL_GREEN,
    SIGNAL_RED,
    SPEED,
    X,
    Y,
)
from bev_driving_env.kernels.walks import (
    ALONG_M,
    DIRECTION,
    HESITATE_S,
    MODE,
    ON_CROSSING,
    WAITED_FOR_S,
    WAITING,
    WALK,
    WALK_STATION,
    WALKING,
    walk_point,
)
from bev_driving_env.towns.sidewalks import build_sidewalks

from .walk_scene import gaps, one_at_kerb


@pytest.fixture(scope="module")
def sidewalks(ladder):
    return build_sidewalks(ladder)


@pytest.fixture
def waiting(sidewalks):
    return partial(one_at_kerb, sidewalks)


def with_signal(sidewalks):
    return int(np.flatnonzero(sidewalks.crossings.signal >= 0)[0])


@pytest.mark.parametrize(
    ("direction", "done", "expected"),
    [
        (1, -0.6, [0, 0]),
        (1, -0.4, [1, 1]),
        (1, 2.0, [1, 1]),
        (1, 4.8, [1, 1]),
        (1, 5.0, [0, 1]),
        (1, 8.5, [0, 1]),
        (1, 8.7, [0, 0]),
        (-1, -0.4, [1, 1]),
        (-1, 5.0, [1, 0]),
        (-1, 8.7, [0, 0]),
    ],
)
def test_who_crosses_occupies_the_half_ahead_and_leaves_the_one_behind(
    sidewalks, waiting, direction, done, expected
):
    street = waiting(0)
    length = sidewalks.crossings.length[0]
    assert length == pytest.approx(8.6, abs=0.1)
    street.track[0, [MODE, DIRECTION]] = ON_CROSSING, direction
    street.motion[0, ALONG_M] = done if direction > 0 else length - done
    occupied = np.ones((len(sidewalks.crossings.length), 2), np.uint8)
    mark_occupied(sidewalks.crossings, street.track, street.motion, occupied)
    assert occupied[0].tolist() == expected
    assert not occupied[1:].any()


def test_who_walks_or_waits_occupies_nothing(sidewalks, waiting):
    street = waiting(2)
    occupied = np.ones((len(sidewalks.crossings.length), 2), np.uint8)
    mark_occupied(sidewalks.crossings, street.track, street.motion, occupied)
    assert not occupied.any()


def test_he_waits_for_red_and_then_goes_over_on_the_right_of_the_line(sidewalks, waiting):
    c = with_signal(sidewalks)
    street = waiting(c)
    street.signals[:] = SIGNAL_GREEN
    street.step(100)
    assert street.track[0, MODE] == WAITING
    assert street.motion[0, WAITED_FOR_S] == pytest.approx(10.0)
    street.signals[sidewalks.crossings.signal[c]] = SIGNAL_RED
    street.step(30)
    ax, ay, bx, by = sidewalks.crossings.ends[c]
    way = np.array([bx - ax, by - ay]) / sidewalks.crossings.length[c]
    dx, dy = street.rows[0, [X, Y]] - (ax, ay)
    assert street.track[0, MODE] == ON_CROSSING
    assert 0.5 < dx * way[0] + dy * way[1] < 5.0
    assert dy * way[0] - dx * way[1] == pytest.approx(0.5, abs=0.1)
    street.step(150)
    assert street.track[0, MODE] != ON_CROSSING
    assert street.track[0, WALK] == sidewalks.crossings.walk[c, 1]


def test_he_gives_up_after_forty_seconds(waiting):
    street = waiting(0)
    street.threatened[:] = 1
    street.step(395)
    assert street.track[0, MODE] == WAITING
    street.step(10)
    assert street.track[0, MODE] == WALKING
    street.step(20)
    assert street.rows[0, SPEED] > 0.0


def test_about_one_in_seven_hesitates_on_the_road_for_one_to_three_seconds(waiting):
    hesitating = 0
    for seed in range(200):
        street = waiting(0, seed)
        stood = []
        for _ in range(140):
            street.step()
            if street.on_road()[0] >= 0 and street.rows[0, SPEED] == 0.0:
                stood.append(street.done())
        assert street.track[0, MODE] != ON_CROSSING
        if stood:
            hesitating += 1
            assert 9 <= len(stood) <= 31
            assert 0.7 <= stood[0] <= 1.6 or 3.9 <= stood[0] <= 4.8
    assert 0.09 * 200 < hesitating < 0.22 * 200


def test_opposite_directions_pass_each_other_on_a_crossing(sidewalks, waiting):
    street = waiting(0)
    other = waiting(0)
    walk, station = sidewalks.crossings.walk[0, 1], sidewalks.crossings.station[0, 1]
    other.track[0, WALK], other.motion[0, WALK_STATION] = walk, station + 0.5
    other.rows[0, [X, Y]] = walk_point(sidewalks.walks, walk, station + 0.5, 0.5)
    for name in ("rows", "track", "motion"):
        setattr(street, name, np.vstack([getattr(street, name), getattr(other, name)]))
    street.step(1)
    street.motion[:, HESITATE_S] = 0.0
    standing = 0
    for _ in range(70):
        street.step()
        assert gaps(street.rows).min() > 0.0
        standing += np.count_nonzero((street.rows[:, SPEED] == 0.0) & (street.on_road() >= 0))
    assert standing == 0


@pytest.mark.parametrize("who", ["ego", "vehicle"])
def test_he_does_not_walk_into_a_vehicle_that_stands_on_the_crossing(sidewalks, waiting, who):
    street = waiting(0)
    ax, ay, bx, by = sidewalks.crossings.ends[0]
    across = np.arctan2(by - ay, bx - ax) + np.pi / 2.0
    box = np.array([[(ax + bx) / 2.0, (ay + by) / 2.0, across, 0.0, 4.6, 2.0]])
    if who == "ego":
        street.ego = box[0, :4].copy()
    else:
        street.vehicles = np.vstack([np.zeros((1, ACTOR_COLUMNS)), box])
    nearest = np.inf
    for _ in range(150):
        street.step()
        nearest = min(nearest, abs(street.motion[0, ALONG_M] - 4.3) - 1.0)
    # half the vehicle's width apart, the gap, and the pedestrian's radius
    assert 0.3 + 0.375 - 1e-9 <= nearest < 0.3 + 0.375 + 0.14


def test_who_was_driven_into_may_walk_away(sidewalks, waiting):
    street = waiting(0)
    street.step(25)
    street.motion[0, HESITATE_S] = 0.0
    assert street.on_road()[0] == 0
    x, y = street.rows[0, [X, Y]]
    ax, ay, bx, by = sidewalks.crossings.ends[0]
    way = np.array([bx - ax, by - ay]) / 8.6
    # its side overlaps him from behind
    street.ego = np.array([x - 1.1 * way[0], y - 1.1 * way[1], 0.0, 0.0])
    street.ego[HEADING] = np.arctan2(way[1], way[0]) + np.pi / 2.0
    before = street.done()
    street.step(10)
    assert street.done() > before + 1.0
