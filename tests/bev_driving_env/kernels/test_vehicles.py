"""Vehicles driving on toy towns: stopping, following, yielding, and never touching."""

import math

import numpy as np
import pytest

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.layout import (
    ADMITTED,
    AFTER_RAIL,
    CHOICES,
    HEADING,
    LENGTH,
    NEXT_RAIL,
    RAIL,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    SPEED,
    STATION,
    WAITED_S,
    WANTED_MPS,
    X,
    Y,
)
from bev_driving_env.kernels.rails import CROSSING, CROSSING_M, RAIL_TOP_MPS, rail_pose
from bev_driving_env.kernels.signals import show_signals
from bev_driving_env.kernels.vehicles import (
    BUMPER_M,
    choose_way,
    clear_crossings,
    set_out,
    stopping_distance,
)
from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.world.vehicles import place_vehicles, vehicle_slots

from .rail_scene import EGO_LENGTH_M, EGO_WIDTH_M, FAR_M, RailScene, anybody_touches, touch

EAST = 0  # the ring's rail on whose northern side traffic heads east
DT_S = 0.1
GRID_M = 5e-4
"""Rows lie on a grid of a millimetre."""


@pytest.fixture
def scene(ladder):
    return RailScene(ladder)


@pytest.fixture
def circle(ring):
    return RailScene(ring)


def drive(scene, seconds, seed=0):
    """Rows of all vehicles (T, V, 6) after each step."""
    rows = []
    for _ in range(round(seconds / DT_S)):
        scene.step(DT_S, seed)
        rows.append(scene.vehicles.copy())
    return np.array(rows)


def copies(scene):
    return scene.vehicles.copy(), scene.track.copy(), scene.motion.copy()


def populate(scene, count, seed):
    """Put vehicles on roads at random."""
    rails = scene.rails
    ego, rng = tuple(scene.ego[:2]), np.random.default_rng(seed)
    placed = place_vehicles(rails, vehicle_slots(rails), count, seed, ego, rng)
    scene.vehicles, scene.track, scene.motion = placed


def live(scene, steps, *, lights, seed, first=0):
    """Let a scene's signals and vehicles go on; yields after each step."""
    for k in range(first, first + steps):
        if lights:
            show_signals(scene.plan, (k + 1) * DT_S, seed, scene.signals)
        scene.step(DT_S, seed)
        yield k


@pytest.mark.parametrize("way", ["WE", "ES", "SW"])
@pytest.mark.parametrize(("line_m", "speed"), [(12.0, 0.0), (14.0, 5.0), (16.0, 8.0)])
def test_a_vehicle_stops_a_metre_before_a_red_line_and_never_beyond(scene, way, line_m, speed):
    scene.signals[:] = SIGNAL_RED
    i = scene.approaching(way, line_m, speed=speed)
    for _ in range(300):
        scene.step(DT_S)
        assert scene.track[i, RAIL] == scene.approach(way[0])
        assert scene.front_m(i) > 0.5
    assert scene.front_m(i) == pytest.approx(1.0, abs=0.3)
    assert scene.vehicles[i, SPEED] < 0.05


def test_at_green_it_goes_through_without_stopping(scene):
    scene.signals[:] = SIGNAL_GREEN
    scene.approaching("WE", 24.0, speed=6.0)
    rows = drive(scene, 8.0)
    assert rows[:, 0, SPEED].min() > 5.9
    assert rows[-1, 0, X] > 62.0


def test_it_waits_while_red_lasts_and_then_goes(scene):
    scene.signals[:] = SIGNAL_RED
    scene.approaching("WE", 5.0)
    drive(scene, 20.0)
    assert scene.motion[0, WAITED_S] == pytest.approx(18.0, abs=2.0)
    scene.signals[:] = SIGNAL_GREEN
    assert drive(scene, 8.0)[-1, 0, X] > 62.0
    assert scene.motion[0, WAITED_S] == 0.0


def test_who_has_decided_to_go_on_goes_on_when_the_light_turns(scene):
    scene.signals[:] = SIGNAL_GREEN
    scene.approaching("WE", 8.0, speed=8.0)
    drive(scene, DT_S)
    assert scene.track[0, ADMITTED]
    scene.signals[:] = SIGNAL_YELLOW
    assert drive(scene, 4.0)[-1, 0, X] > 60.0


@pytest.mark.parametrize(("gap", "speed"), [(8.0, 0.0), (20.0, 6.0), (40.0, 8.0)])
def test_a_vehicle_stops_about_5_m_behind_the_bumper_of_one_that_stands(scene, gap, speed):
    scene.signals[:] = SIGNAL_RED
    scene.approaching("WE", 1.0, length=7.0)
    scene.approaching("WE", 1.0 + 7.0 + gap, speed=speed)
    rows = drive(scene, 40.0)
    between = scene.motion[0, STATION] - scene.motion[1, STATION] - 0.5 * (7.0 + 4.0)
    assert 4.2 < between < 5.5
    assert np.diff(rows[:, 1, X]).min() > -1e-9
    assert rows[-1, 1, SPEED] < 0.1


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("gap", [1.5, 2.0, 3.0, 5.0])
def test_bumpers_never_come_closer_than_half_a_metre(scene, gap, dt_s):
    scene.signals[:] = SIGNAL_RED
    scene.approaching("WE", 1.0)
    scene.approaching("WE", 1.0 + 4.0 + gap, speed=8.0)
    for _ in range(50):
        scene.step(dt_s)
        between = scene.motion[0, STATION] - scene.motion[1, STATION] - 4.0
        assert between >= BUMPER_M - 1e-9


@pytest.mark.parametrize("gap", [1.5, 2.0, 3.0, 5.0])
def test_bumpers_stay_apart_even_when_braking_comes_too_late(scene, gap):
    """At 6 m/s^2 it would take 5.3 m."""
    scene.signals[:] = SIGNAL_RED
    scene.approaching("WE", 1.0)
    scene.approaching("WE", 1.0 + 4.0 + gap, speed=8.0)
    for _ in range(50):
        scene.step(DT_S)
        assert scene.motion[0, STATION] - scene.motion[1, STATION] - 4.0 > 0.0
    assert scene.vehicles[1, SPEED] == 0.0


@pytest.mark.parametrize("turned", [0.0, math.pi / 2, math.pi, 0.6])
@pytest.mark.parametrize("ahead", [18.0, 30.0])
def test_a_vehicle_yields_to_an_ego_standing_across_its_way_and_goes_on_after(
    circle, turned, ahead
):
    circle.add(EAST, 60.0, EAST, EAST, speed=7.0)
    x, y, heading = rail_pose(circle.rails, EAST, 60.0 + ahead)
    circle.ego[:3] = x, y, heading + turned
    ego = np.array([*circle.ego, EGO_LENGTH_M, EGO_WIDTH_M])
    rows = drive(circle, 20.0)[:, 0]
    assert not any(touch(row, ego) for row in rows)
    assert rows[-1, SPEED] < 0.1
    near_end = footprint(ego[:3], EGO_LENGTH_M, EGO_WIDTH_M)[:, 0].min()
    assert 4.5 < near_end - (rows[-1, X] + 2.0) < 6.5  # about as far as from a leader
    circle.ego[:2] = -FAR_M
    assert drive(circle, 8.0)[-1, 0, X] > x + 10.0


def test_a_vehicle_stops_behind_an_ego_that_stands_on_its_route(ring, circle):
    circle.send_ego(route_by_turns(ring, (20.0, 2.0), "", (180.0, 2.0)), 60.0)
    assert circle.line_up().rail[-1] == EAST
    circle.add(EAST, 20.0, EAST, EAST, speed=7.0)
    rows = drive(circle, 20.0)[:, 0]
    between = circle.ego[0] - rows[-1, X] - 2.0 - EGO_LENGTH_M / 2.0
    assert 4.2 < between < 6.5
    assert rows[-1, SPEED] < 0.1


def test_people_on_a_crossing_are_waited_for(scene):
    scene.signals[:] = SIGNAL_OFF
    movement = scene.movement("WE")
    scene.approaching("WE", 25.0, speed=7.0)
    inside = scene.add(movement, 2.0, scene.exit("E"), scene.rails.following[scene.exit("E"), 0])
    scene.occupied[:] = 1
    rows = drive(scene, 15.0)
    at_m = scene.rails.crossings[scene.rails.crossing_first[movement + 1] - 1, 1]
    assert scene.front_m(0) == pytest.approx(1.0, abs=0.3)  # the line is nearer than the crossing
    assert scene.track[inside, RAIL] == movement
    assert scene.motion[inside, STATION] + 2.0 < at_m - 1.0
    assert rows[-1, :, SPEED].max() < 0.1
    scene.occupied[:] = 0
    assert (drive(scene, 10.0)[-1, :, X] > 60.0).all()


def test_a_vehicle_goes_round_a_ring_forever(circle):
    length = circle.rails.length[EAST]
    for k in range(6):
        circle.add(EAST, k * length / 6.0, EAST, EAST, wanted=6.0 + 0.3 * k)
    rows = drive(circle, 600.0)
    steps = np.diff(rows[:, :, :2], axis=0)
    driven = np.hypot(*np.moveaxis(steps, 2, 0)).sum(axis=0)
    assert (driven > 5.0 * length).all()
    assert rows[600:, :, SPEED].min() > 2.0
    assert not any(anybody_touches(row) for row in rows[::10])
    # still in its lane: y = 2, y = 58, x = 198 or x = 2, or in a corner between
    off = np.abs(rows[:, :, None, [Y, Y, X, X]] - [2.0, 58.0, 198.0, 2.0]).min(axis=(2, 3))
    assert off.max() < 4.0


def test_no_vehicle_drives_faster_than_it_wants_or_its_rail_allows(scene):
    populate(scene, 6, 3)
    for _ in range(600):
        scene.step(DT_S)
        rails, track = scene.rails, scene.track
        rows = rails.first[track[:, RAIL]] + (
            scene.motion[:, STATION] / rails.step_m[track[:, RAIL]]
        ).astype(int)
        assert (scene.vehicles[:, SPEED] <= scene.motion[:, WANTED_MPS] + 1e-6).all()
        # the model lets go of speed gradually
        assert (scene.vehicles[:, SPEED] <= rails.samples[rows, RAIL_TOP_MPS] + 1.0).all()


def test_positions_are_those_of_the_rails_and_change_by_what_was_driven(scene):
    populate(scene, 10, 5)
    before, *_ = copies(scene)
    for _ in range(600):
        scene.step(DT_S)
        for row, track, motion in zip(*copies(scene), strict=True):
            pose = rail_pose(scene.rails, int(track[RAIL]), motion[STATION])
            np.testing.assert_allclose(row[:3], pose, atol=GRID_M)
        moved = np.hypot(*(scene.vehicles - before)[:, :2].T)
        mean = 0.5 * (scene.vehicles[:, SPEED] + before[:, SPEED])
        np.testing.assert_allclose(moved, mean * DT_S, atol=0.03)
        before = scene.vehicles.copy()


def test_vehicles_take_the_ways_they_have_chosen(scene):
    populate(scene, 8, 1)
    changes = 0
    _, before, _ = copies(scene)
    for _ in range(1200):
        scene.step(DT_S)
        changed = scene.track[:, RAIL] != before[:, RAIL]
        changes += changed.sum()
        now = scene.track[changed]
        assert (now[:, RAIL] == before[changed, NEXT_RAIL]).all()
        assert (now[:, NEXT_RAIL] == before[changed, AFTER_RAIL]).all()
        for a, b in ((RAIL, NEXT_RAIL), (NEXT_RAIL, AFTER_RAIL)):
            for track in scene.track:
                assert track[b] in scene.rails.following[track[a]]
        before = scene.track.copy()
    assert changes > 50


def test_no_room_for_long_makes_a_vehicle_take_another_way(scene):
    scene.approaching("WE", 1.0)
    blocker = scene.add(scene.exit("E"), 3.0)
    for _ in range(150):
        scene.step(DT_S)
        scene.motion[blocker, STATION], scene.vehicles[blocker, SPEED] = 3.0, 0.0  # it never moves
        if scene.track[0, NEXT_RAIL] != scene.movement("WE"):
            break
    assert scene.track[0, NEXT_RAIL] == scene.movement("WS")
    assert scene.track[0, AFTER_RAIL] == scene.exit("S")


@pytest.mark.parametrize("lights", [True, False], ids=["lights", "no lights"])
@pytest.mark.parametrize("seed", [0, 1])
def test_12_vehicles_live_10_minutes_in_two_junctions_without_touching_or_being_stuck(
    scene, lights, seed
):
    populate(scene, 12, seed)
    still_s, longest_s = np.zeros(12), np.zeros(12)
    passed = 0
    for k in live(scene, 6000, lights=lights, seed=seed):
        if k % 2 == 0:
            assert not anybody_touches(scene.vehicles), f"after step {k}"
        still_s = np.where(scene.vehicles[:, SPEED] < 0.1, still_s + DT_S, 0.0)
        longest_s = np.maximum(longest_s, still_s)
        passed += (scene.track[:, CHOICES] > 2).all()
    assert longest_s.max() < 180.0
    assert (scene.track[:, CHOICES] >= 10).all()
    assert passed > 3000  # all are on their second rail well before half time


def test_nobody_enters_a_junction_that_has_been_red_for_3_s(scene):
    """All the time before that, red or yellow, it could have stopped."""
    populate(scene, 12, 2)
    before, red_s = scene.track.copy(), np.zeros(len(scene.signals))
    entered = {SIGNAL_GREEN: 0, SIGNAL_YELLOW: 0, SIGNAL_RED: 0}
    for _ in live(scene, 6000, lights=True, seed=2):
        red_s = np.where(scene.signals == SIGNAL_RED, red_s + DT_S, 0.0)
        moved = scene.track[:, RAIL] != before[:, RAIL]
        for rail in before[moved & scene.rails.movement[scene.track[:, RAIL]], RAIL]:
            signal = scene.rails.signal[rail]
            entered[int(scene.signals[signal])] += 1
            assert red_s[signal] < 3.0
        before = scene.track.copy()
    assert entered[SIGNAL_GREEN] > 50
    assert entered[SIGNAL_RED] < 0.1 * entered[SIGNAL_GREEN]


def test_the_same_state_stepped_twice_gives_the_same_bits(scene):
    populate(scene, 12, 4)
    for _ in live(scene, 300, lights=True, seed=4):
        start = copies(scene)
        scene.step(DT_S, 4)
        first = copies(scene)
        scene.vehicles, scene.track, scene.motion = (array.copy() for array in start)
        scene.step(DT_S, 4)
        for a, b in zip(first, copies(scene), strict=True):
            assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("lights", [True, False], ids=["lights", "no lights"])
def test_a_run_that_is_rewound_and_repeated_is_the_same(scene, lights):
    populate(scene, 12, 6)
    for _ in live(scene, 500, lights=lights, seed=6):
        pass
    start = copies(scene)
    runs = []
    for _ in range(2):
        scene.vehicles, scene.track, scene.motion = (array.copy() for array in start)
        scene.signals[:] = 77 if lights else SIGNAL_OFF  # set again from time and seed alone
        live_on = live(scene, 500, lights=lights, seed=6, first=500)
        runs.append([copies(scene) for _ in live_on])
    for first, second in zip(*runs, strict=True):
        for a, b in zip(first, second, strict=True):
            assert a.tobytes() == b.tobytes()


def test_another_seed_takes_other_ways(scene):
    ends = []
    for seed in (0, 1):
        populate(scene, 12, 0)
        for _ in live(scene, 600, lights=True, seed=seed):
            pass
        ends.append(scene.track.copy())
    assert (ends[0] != ends[1]).any()


def test_empty_slots_stay_as_they_are(scene):
    populate(scene, 5, 0)
    scene.vehicles[2, LENGTH] = 0.0
    before = [array[2].copy() for array in copies(scene)]
    drive(scene, 10.0)
    for array, was in zip(copies(scene), before, strict=True):
        np.testing.assert_array_equal(array[2], was)


def test_ways_are_chosen_evenly_and_again_the_same(scene):
    rails = scene.rails
    road = scene.approach("W")
    ways = [choose_way(rails, road, 3, vehicle, k) for vehicle in range(20) for k in range(50)]
    again = [choose_way(rails, road, 3, vehicle, k) for vehicle in range(20) for k in range(50)]
    assert ways == again
    assert ways[:50] != ways[50:100]  # another vehicle goes another way
    shares = [ways.count(scene.movement(way)) / len(ways) for way in ("WE", "WS")]
    assert shares == pytest.approx([0.5, 0.5], abs=0.06)


def test_the_end_of_a_rail_without_a_choice_leads_to_the_only_next(scene):
    assert choose_way(scene.rails, scene.movement("WE"), 0, 0, 0) == scene.exit("E")


def test_at_a_dead_end_there_is_no_way_and_vehicles_stop(scene):
    rails, road = scene.rails, scene.exit("E")
    following = rails.following.copy()
    following[road] = -1
    scene.rails = rails._replace(following=following)
    assert choose_way(scene.rails, road, 0, 0, 0) == -1
    scene.add(road, rails.length[road] - 12.0, speed=6.0)
    drive(scene, 5.0)
    assert scene.motion[0, STATION] == rails.length[road]
    assert scene.vehicles[0, SPEED] == 0.0


def test_setting_out_chooses_two_ways_and_writes_the_pose(scene):
    road = scene.approach("W")
    scene.add(road, 30.0)
    scene.vehicles[0, :3] = 77.0
    set_out(scene.rails, 5, scene.vehicles, scene.track, scene.motion)
    row, track = scene.vehicles[0], scene.track[0]
    np.testing.assert_allclose(row[:3], rail_pose(scene.rails, road, 30.0), atol=GRID_M)
    assert track[NEXT_RAIL] == choose_way(scene.rails, road, 5, 0, 0)
    assert track[AFTER_RAIL] == choose_way(scene.rails, int(track[NEXT_RAIL]), 5, 0, 1)
    assert track[CHOICES] == 2


@pytest.mark.parametrize("speed", [0.0, 4.0, 8.0])
def test_the_stopping_distance_is_half_a_second_and_braking_at_2_mps2(speed):
    where, left = 0.5 * speed, speed
    while left > 0.0:
        where, left = where + left * 0.001, left - 2.0 * 0.001
    assert stopping_distance(speed) == pytest.approx(where, abs=0.02)


def threatened(scene, i, last_rail=-1, reach_m=0.0):
    marks = np.zeros(len(scene.crossing_ends), np.uint8)
    clear_crossings(scene.rails, scene.line_up(), i, last_rail, reach_m, marks)
    return set(np.flatnonzero(marks).tolist())


def test_a_vehicle_threatens_the_crossings_under_and_before_it(scene):
    rails, movement = scene.rails, scene.movement("WE")
    here = rails.crossings[slice(*rails.crossing_first[movement : movement + 2])]
    (entry, leaving), (entry_m, leaving_m) = here[:, CROSSING].astype(int), here[:, CROSSING_M]
    before = scene.approaching("WE", 6.0)
    assert threatened(scene, before, reach_m=6.0 + entry_m - 1.2) == set()
    assert threatened(scene, before, reach_m=6.0 + entry_m - 0.8) == {entry}
    assert threatened(scene, before, reach_m=6.0 + leaving_m) == {entry, leaving}
    between = scene.add(movement, 10.0, scene.exit("E"))
    assert threatened(scene, between) == set()
    on_it = scene.add(scene.exit("E"), 1.5)
    assert threatened(scene, on_it) == set()
    assert threatened(scene, on_it, last_rail=movement) == {leaving}  # its tail is still on it


def test_heading_and_speed_are_finite_and_never_negative(scene):
    populate(scene, 12, 8)
    rows = drive(scene, 60.0)
    assert np.isfinite(rows).all()
    assert (rows[:, :, SPEED] >= 0.0).all()
    assert np.abs(np.diff(np.unwrap(rows[:, :, HEADING], axis=0), axis=0)).max() < 0.2
