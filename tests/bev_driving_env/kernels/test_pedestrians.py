import numpy as np
import pytest

from bev_driving_env.kernels.layout import (
    ACTOR_COLUMNS,
    HEADING,
    LENGTH,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
    WIDTH,
    X,
    Y,
)
from bev_driving_env.kernels.pedestrians import find_contacts, mark_occupied, step_pedestrians
from bev_driving_env.kernels.walks import (
    ALONG_M,
    COUNTER,
    CROSSING,
    DIRECTION,
    HESITATE_S,
    KERB_M,
    MODE,
    ON_CROSSING,
    PACE_MPS,
    PED_MOTION_COLUMNS,
    PED_TRACK_COLUMNS,
    PLACE,
    WAITED_FOR_S,
    WAITING,
    WALK,
    WALK_STATION,
    WALKING,
    walk_point,
)
from bev_driving_env.towns.sidewalks import build_sidewalks
from bev_driving_env.world.pedestrians import place_pedestrians

FAR = np.array([-900.0, -900.0, 0.0, 0.0])


class Street:
    """Pedestrians of one world on the ladder, stepped with what the test sets."""

    def __init__(self, sidewalks, rows, track, motion, seed=11):
        self.walks, self.crossings = sidewalks.walks, sidewalks.crossings
        self.rows, self.track, self.motion, self.seed = rows, track, motion, seed
        self.signals = np.full(6, SIGNAL_OFF, np.uint8)
        self.threatened = np.zeros(len(self.crossings.length), np.uint8)
        self.ego, self.vehicles = FAR, np.zeros((0, ACTOR_COLUMNS))

    def step(self, count=1):
        for _ in range(count):
            step_pedestrians(
                self.walks,
                self.crossings,
                0.1,
                self.seed,
                self.signals,
                self.threatened,
                self.ego,
                2.3,
                1.0,
                self.vehicles,
                self.rows,
                self.track,
                self.motion,
            )

    def on_road(self):
        """Which crossing everybody is on the road part of; -1 for none."""
        crossing = self.track[:, CROSSING]
        along = self.motion[:, ALONG_M]
        inside = (along > 0.0) & (along < self.crossings.length[crossing])
        return np.where((self.track[:, MODE] == ON_CROSSING) & inside, crossing, -1)

    def done(self, i=0):
        """Metres that pedestrian i is past the kerb he started from."""
        along = self.motion[i, ALONG_M]
        length = self.crossings.length[self.track[i, CROSSING]]
        return along if self.track[i, DIRECTION] > 0 else length - along


def gaps(rows):
    distance = np.hypot(*(rows[:, None, [X, Y]] - rows[None, :, [X, Y]]).T)
    gap = distance - 0.75 * (rows[:, None, LENGTH] + rows[None, :, LENGTH])
    return gap[np.triu_indices(len(rows), 1)]


@pytest.fixture(scope="module")
def sidewalks(ladder):
    return build_sidewalks(ladder)


@pytest.fixture
def crowd(sidewalks):
    return Street(sidewalks, *place_pedestrians(sidewalks, 120, np.random.default_rng(4)))


@pytest.fixture
def alone(sidewalks):
    """Function that puts people of pace 1.3 at stations of a walk, all going one way."""

    def stand(*stations, walk=0, direction=1, kerb_m=2.0, size=0.5):
        count = len(stations)
        rows = np.zeros((count, ACTOR_COLUMNS))
        track = np.zeros((count, PED_TRACK_COLUMNS), np.int64)
        motion = np.zeros((count, PED_MOTION_COLUMNS))
        rows[:, [LENGTH, WIDTH]] = size
        track[:, WALK], track[:, DIRECTION], track[:, CROSSING] = walk, direction, -1
        motion[:, WALK_STATION], motion[:, KERB_M] = stations, kerb_m
        motion[:, PACE_MPS], motion[:, PLACE] = 1.3, 0.5
        for k, station in enumerate(stations):
            rows[k, [X, Y]] = walk_point(sidewalks.walks, walk, station, kerb_m)
        return Street(sidewalks, rows, track, motion)

    return stand


@pytest.fixture
def waiting(sidewalks, alone):
    """Function that puts one at the kerb of a crossing's first end, about to cross."""

    def wait(c, seed=11):
        walk, station = sidewalks.crossings.walk[c, 0], sidewalks.crossings.station[c, 0]
        street = alone(station + 0.5, walk=walk, kerb_m=0.5)
        street.track[:, MODE], street.track[:, CROSSING] = WAITING, c
        street.seed = seed
        return street

    return wait


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


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_walker_keeps_his_pace_and_faces_where_he_goes(alone, direction):
    street = alone(20.0, direction=direction)
    for _ in range(100):
        before = street.rows.copy()
        street.step()
        dx, dy = (street.rows - before)[0, [X, Y]]
        assert np.hypot(dx, dy) == pytest.approx(0.1 * street.rows[0, SPEED])
        assert street.rows[0, SPEED] == pytest.approx(1.3, abs=0.15)
        turn = np.angle(np.exp(1j * (street.rows[0, HEADING] - np.arctan2(dy, dx))))
        assert abs(turn) < 0.002
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
        assert gaps(street.rows).min() > -1e-9
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


def test_who_touches_another_may_only_move_away(alone):
    street = alone(20.0, 20.5, size=0.6)  # 0.9 m apart would be enough
    before = street.motion[:, WALK_STATION].copy()
    street.step()
    after = street.motion[:, WALK_STATION]
    assert after[0] == before[0]
    assert after[1] > before[1]


def test_contacts_are_those_with_somebody_before(alone):
    street = alone(20.0, 30.0, 20.3, 30.95, 40.0, size=0.6)
    touching = np.ones(5, np.bool_)
    assert find_contacts(street.rows, touching) == 1
    assert touching.tolist() == [False, False, True, False, False]


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
