import math

import numpy as np
import pytest

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.layout import (
    AFTER_RAIL,
    CHOICES,
    LAST_RAIL,
    LENGTH,
    NEXT_RAIL,
    RAIL,
    SPEED,
    STATION,
    WANTED_MPS,
    WIDTH,
    X,
    Y,
)
from bev_driving_env.kernels.overlap import boxes_overlap
from bev_driving_env.kernels.rails import rail_pose
from bev_driving_env.world.vehicles import KINDS, place_vehicles, vehicle_slots

NO_EGO = (-1e4, 0.0)
CAR = (4.9, 2.0)


@pytest.fixture(scope="module")
def rails(town):
    return town.traffic().network.tables


@pytest.fixture(scope="module")
def few_rails(ladder):
    return ladder.traffic().network.tables


def placed(rails, count, seed=0, ego=NO_EGO):
    return place_vehicles(
        rails, vehicle_slots(rails), count, seed, ego, np.random.default_rng(seed)
    )


def overlap(a, b):
    def box(row):
        return *row[:2], math.cos(row[2]), math.sin(row[2]), row[LENGTH] / 2.0, row[WIDTH] / 2.0

    return boxes_overlap(*box(a), *box(b))


def near_pairs(rows, within_m=9.0):
    apart = np.hypot(rows[:, None, X] - rows[None, :, X], rows[:, None, Y] - rows[None, :, Y])
    return np.argwhere(np.triu(apart < within_m, 1))


def test_a_full_town_has_no_two_vehicles_that_touch(rails):
    for seed in range(3):
        rows, _, _ = placed(rails, len(vehicle_slots(rails)), seed)
        pairs = near_pairs(rows)
        assert len(pairs) > 0
        assert not any(overlap(rows[i], rows[j]) for i, j in pairs)


def test_slots_lie_on_roads_with_room_for_the_longest_vehicle_at_both_ends(rails):
    slots = vehicle_slots(rails)
    rail, station = slots[:, 0].astype(int), slots[:, 1]
    assert not rails.movement[rail].any()
    longest = max(kind.length_m[1] for kind in KINDS)
    assert (station > longest / 2.0).all()
    assert (station < rails.length[rail] - longest / 2.0).all()
    for number, metres, *place in slots:
        assert tuple(place) == rail_pose(rails, int(number), metres)[:2]
    for number in np.unique(rail):
        assert np.diff(np.sort(station[rail == number])).min(initial=np.inf) > longest


def test_nobody_stands_on_a_stop_line_or_off_its_rail(rails):
    rows, track, motion = placed(rails, len(vehicle_slots(rails)), 1)
    half = rows[:, LENGTH] / 2.0
    assert (motion[:, STATION] > half).all()
    assert (motion[:, STATION] < rails.length[track[:, RAIL]] - half).all()
    for row, rail, station in zip(rows, track[:, RAIL], motion[:, STATION], strict=True):
        # rows lie on a grid of a millimetre
        np.testing.assert_allclose(row[:3], rail_pose(rails, int(rail), station), atol=5e-4)
    assert not rows[:, SPEED].any()


def test_no_vehicle_is_near_the_ego(few_rails):
    slots = vehicle_slots(few_rails)
    for seed in range(10):
        pose = rail_pose(few_rails, int(slots[seed, 0]), slots[seed, 1])
        room = int((np.hypot(*(slots[:, 2:] - pose[:2]).T) > 14.0).sum())
        rows, _, _ = placed(few_rails, room, seed, pose[:2])
        assert np.hypot(rows[:, X] - pose[0], rows[:, Y] - pose[1]).min() > 12.0
        corners = footprint(pose, *CAR)
        for row in rows:
            theirs = footprint(row[:3], row[LENGTH], row[WIDTH])
            apart = np.hypot(*(corners[:, None] - theirs[None]).transpose(2, 0, 1))
            assert apart.min() > 4.0


def test_placing_depends_on_nothing_but_its_arguments(rails):
    for a, b in zip(placed(rails, 40, 5), placed(rails, 40, 5), strict=True):
        assert a.tobytes() == b.tobytes()
    assert (placed(rails, 40, 5)[0] != placed(rails, 40, 6)[0]).any()


def test_the_ways_depend_on_the_episodes_seed_and_nothing_else_does(rails):
    slots = vehicle_slots(rails)
    first, second = (
        place_vehicles(rails, slots, 40, seed, NO_EGO, np.random.default_rng(0)) for seed in (1, 2)
    )
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[2], second[2])
    assert (first[1][:, NEXT_RAIL] != second[1][:, NEXT_RAIL]).any()


def test_each_vehicle_has_two_rails_to_go_on_to(rails):
    _, track, _ = placed(rails, 60)
    for row in track:
        assert row[NEXT_RAIL] in rails.following[row[RAIL]]
        assert row[AFTER_RAIL] in rails.following[row[NEXT_RAIL]]
    assert (track[:, [NEXT_RAIL, AFTER_RAIL]] >= 0).all()
    assert (track[:, LAST_RAIL] == -1).all()
    assert (track[:, CHOICES] == 2).all()


def test_vehicles_are_of_the_kinds_that_there_are_in_their_shares(rails):
    counts, total = np.zeros(len(KINDS)), 0
    for seed in range(12):
        rows, _, motion = placed(rails, 60, seed)
        values = np.column_stack([rows[:, [LENGTH, WIDTH]], motion[:, WANTED_MPS]])
        for value in values:
            fits = [
                all(
                    low <= v <= high
                    for v, (low, high) in zip(
                        value, (kind.length_m, kind.width_m, kind.wanted_mps), strict=True
                    )
                )
                for kind in KINDS
            ]
            assert sum(fits) == 1
            counts += fits
            total += 1
    np.testing.assert_allclose(counts / total, [kind.share for kind in KINDS], atol=0.05)
    assert sum(kind.share for kind in KINDS) == pytest.approx(1.0)


def test_no_vehicles_make_empty_tables(few_rails):
    assert [table.shape for table in placed(few_rails, 0)] == [(0, 6), (0, 6), (0, 3)]


def test_more_vehicles_than_there_is_room_for_are_refused(few_rails):
    room = len(vehicle_slots(few_rails))
    assert len(placed(few_rails, room)[0]) == room
    with pytest.raises(
        ValueError, match=f"room for {room} vehicles, got {room + 1}; ask for fewer"
    ):
        placed(few_rails, room + 1)


def test_the_egos_place_is_no_room(few_rails):
    slots = vehicle_slots(few_rails)
    pose = rail_pose(few_rails, int(slots[0, 0]), slots[0, 1])
    with pytest.raises(ValueError, match="there is room for"):
        placed(few_rails, len(slots), 0, pose[:2])
