from functools import partial

import numpy as np
import pytest

from bev_driving_env.kernels.layout import (
    HEADING,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
    X,
    Y,
)
from bev_driving_env.kernels.walks import (
    COUNTER,
    KERB_M,
    MODE,
    ON_CROSSING,
    PLACE,
    WAITING,
    WALKING,
)
from bev_driving_env.towns.sidewalks import build_sidewalks
from bev_driving_env.world.pedestrians import place_pedestrians

from .walk_scene import Street, gaps, people_on_walk


@pytest.fixture(scope="module")
def sidewalks(ladder):
    return build_sidewalks(ladder)


@pytest.fixture
def crowd(sidewalks):
    return Street(sidewalks, *place_pedestrians(sidewalks, 120, np.random.default_rng(4)))


@pytest.fixture
def alone(sidewalks):
    return partial(people_on_walk, sidewalks)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_walker_keeps_his_pace_and_faces_where_he_goes(alone, direction):
    street = alone(20.0, direction=direction)
    for _ in range(100):
        before = street.rows.copy()
        street.step()
        dx, dy = (street.rows - before)[0, [X, Y]]
        assert np.hypot(dx, dy) == pytest.approx(0.1 * street.rows[0, SPEED], abs=1e-3)
        assert street.rows[0, SPEED] == pytest.approx(1.3, abs=0.15)
        turn = np.angle(np.exp(1j * (street.rows[0, HEADING] - np.arctan2(dy, dx))))
        assert abs(turn) < 0.01  # rows lie on a grid of a millimetre
        if street.track[0, MODE] != WALKING:
            break


def test_a_walker_drifts_to_his_place_in_the_band_at_no_more_than_a_slow_step(alone):
    street = alone(20.0, kerb_m=0.6)
    street.motion[0, PLACE] = 1.0
    steps = []
    for _ in range(90):
        before = street.motion[0, KERB_M]
        street.step()
        steps.append(street.motion[0, KERB_M] - before)
        street.track[0, MODE] = WALKING
    assert max(steps) == pytest.approx(0.04)
    assert min(steps[:70]) > 0.0


def test_a_crowd_never_overlaps_and_everybody_gets_on(crowd):
    street = crowd
    rng = np.random.default_rng(0)
    anchor, since = street.rows[:, [X, Y]].copy(), np.zeros(len(street.rows))
    modes = set()
    for step in range(2400):
        if step % 50 == 0:
            street.signals[:] = rng.choice([SIGNAL_GREEN, SIGNAL_YELLOW, SIGNAL_RED], 6)
            street.threatened[:] = rng.random(len(street.threatened)) < 0.3
        street.step()
        assert gaps(street.rows).min() > -1.5e-3  # circles, on a grid of a millimetre
        moved = np.hypot(*(street.rows[:, [X, Y]] - anchor).T) > 1.0
        anchor[moved], since[moved] = street.rows[moved][:, [X, Y]], step
        assert (step - since).max() < 1800
        modes |= set(street.track[:, MODE])
    assert modes == {WALKING, WAITING, ON_CROSSING}
    assert (street.rows[:, SPEED] <= 2.2).all()


def test_nobody_steps_on_to_the_road_while_threatened_or_unless_the_signal_is_red(crowd):
    street = crowd
    rng = np.random.default_rng(1)
    stepped = 0
    for step in range(3000):
        if step % 30 == 0:
            street.signals[:] = rng.choice([SIGNAL_OFF, SIGNAL_GREEN, SIGNAL_YELLOW, SIGNAL_RED], 6)
            street.threatened[:] = rng.random(len(street.threatened)) < 0.4
        before = street.on_road()
        street.step()
        after = street.on_road()
        for c in after[(after >= 0) & (before < 0)]:
            stepped += 1
            assert not street.threatened[c]
            signal = street.crossings.signal[c]
            assert signal < 0 or street.signals[signal] in (SIGNAL_OFF, SIGNAL_RED)
    assert stepped > 30


def test_an_empty_slot_stays_empty(alone):
    street = alone(20.0, 40.0)
    street.rows[0] = 0.0
    street.step(20)
    assert not street.rows[0].any()
    assert street.rows[1, SPEED] > 1.0


def test_a_step_repeated_from_copies_gives_equal_bits(crowd):
    crowd.step(300)
    arrays = crowd.rows, crowd.track, crowd.motion
    copies = [array.copy() for array in arrays]
    crowd.step(300)
    first = [array.copy() for array in arrays]
    crowd.rows, crowd.track, crowd.motion = copies
    crowd.step(300)
    for a, b in zip(first, (crowd.rows, crowd.track, crowd.motion), strict=True):
        assert a.tobytes() == b.tobytes()


def test_the_seed_decides_who_crosses(sidewalks):
    placed = place_pedestrians(sidewalks, 60, np.random.default_rng(4))
    streets = [Street(sidewalks, *(part.copy() for part in placed), seed=k) for k in (1, 2)]
    for street in streets:
        street.step(300)
    assert (streets[0].track != streets[1].track).any()
    assert (streets[0].track[:, COUNTER] > 0).any()
