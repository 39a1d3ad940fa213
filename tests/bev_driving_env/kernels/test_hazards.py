"""What a driver sees ahead, by hand-made scenes and by brute force."""

import itertools
import math

import numpy as np
import pytest

from bev_driving_env.kernels.hazards import (
    EGO_MARGIN_M,
    SIGHT_M,
    commit_distance,
    ego_ahead,
    leader_ahead,
    line_ahead,
    people_ahead,
    speed_ahead,
)
from bev_driving_env.kernels.layout import SIGNAL_GREEN, SIGNAL_RED
from bev_driving_env.kernels.overlap import boxes_overlap
from bev_driving_env.kernels.rails import RAIL_TOP_MPS, rail_pose
from bev_driving_env.kernels.right_of_way import FREE, STOP_SIGNAL
from bev_driving_env.towns.route import route_by_turns

from .rail_scene import EGO_LENGTH_M, EGO_WIDTH_M, RailScene

EAST = 0  # the ring's rail on whose northern side traffic heads east


@pytest.fixture
def scene(ladder):
    return RailScene(ladder)


@pytest.fixture
def circle(ring):
    return RailScene(ring)


def leader(scene, i=0):
    return leader_ahead(scene.rails, scene.line_up(), i)


def test_on_an_empty_road_there_is_nobody_to_follow(scene):
    scene.approaching("WE", 10.0)
    assert leader(scene) == (-1, math.inf)


def test_the_next_on_ones_own_rail_is_followed(circle):
    for station in (100.0, 150.0, 131.0, 90.0):
        circle.add(EAST, station, EAST, EAST)
    assert leader(circle) == (2, 31.0)
    assert leader(circle, 3) == (0, 10.0)


@pytest.mark.parametrize("seed", range(5))
def test_round_a_ring_the_nearest_ahead_is_followed(circle, seed):
    length = circle.rails.length[EAST]
    stations = np.random.default_rng(seed).uniform(0.0, length, 12)
    for station in stations:
        circle.add(EAST, station, EAST, EAST)
    for i, station in enumerate(stations):
        gaps = (stations - station) % length
        gaps[i] = np.inf
        j = int(gaps.argmin())
        if stations[j] < station and length - station >= SIGHT_M:
            assert leader(circle, i) == (-1, math.inf)
        else:
            who, metres = leader(circle, i)
            assert who == j
            assert metres == pytest.approx(gaps[j])


def test_alone_on_a_ring_nobody_follows_himself(circle):
    circle.add(EAST, circle.rails.length[EAST] - 5.0, EAST, EAST)
    assert leader(circle) == (-1, math.inf)


def test_a_leader_is_found_two_rails_ahead(scene):
    scene.approaching("WE", 3.0)
    behind_m = 3.0 + 2.0 + scene.rails.length[scene.movement("WE")]
    scene.add(scene.exit("E"), 7.0)
    who, metres = leader(scene)
    assert (who, metres) == (1, pytest.approx(behind_m + 7.0))
    scene.add(scene.movement("WE"), 12.0, scene.exit("E"))
    who, metres = leader(scene)
    assert (who, metres) == (2, pytest.approx(3.0 + 2.0 + 12.0))


def test_nobody_on_a_rail_beyond_60_m_is_looked_for(scene):
    scene.add(scene.movement("WE"), 1.0, scene.exit("E"))
    near = scene.approaching("WE", 57.0)  # its centre is 59 m before the rail's end
    far = scene.approaching("WE", 59.0)
    assert leader(scene, near)[0] == 0
    scene.vehicles[near, 4] = 0.0
    assert leader(scene, far) == (-1, math.inf)


def test_the_ego_is_followed_like_any_other(ladder, scene):
    route = route_by_turns(ladder, (75.0, -2.0), "B1S", (35.0, -2.0))
    scene.send_ego(route, 0.0)
    road = scene.approach("E")
    scene.add(road, scene.line_up().station[-1] - 20.0, scene.movement("ES"), scene.exit("S"))
    who, metres = leader(scene)
    assert who == len(scene.vehicles)
    assert metres == pytest.approx(20.0)


@pytest.mark.parametrize(("way", "other"), [("WE", "WS"), ("WS", "WE"), ("ES", "EW"), ("SE", "SW")])
def test_who_turns_off_ahead_is_followed_until_it_is_out_of_the_way(scene, way, other):
    movement = scene.movement(other)
    scene.approaching(way, 3.0)
    scene.add(movement, 0.0, scene.exit(other[1]))
    followed = []
    for station in np.arange(0.0, scene.rails.length[movement], 0.5):
        scene.motion[1, 0] = station
        who, metres = leader(scene)
        followed.append(who == 1)
        if who == 1:
            assert metres == pytest.approx(3.0 + 2.0 + station)
    assert followed[0]
    assert not followed[-1]
    assert sum(a != b for a, b in itertools.pairwise(followed)) == 1
    # it is let go only where the two bodies would no longer touch, wherever its follower is
    clear = 0.5 * followed.index(False)
    mine = scene.movement(way)
    for station in np.arange(0.0, scene.rails.length[mine], 0.5):
        assert not overlap_on_rails(scene, (mine, station), (movement, clear))


def overlap_on_rails(scene, a, b, length=4.0, width=1.8):
    boxes = []
    for rail, station in (a, b):
        x, y, heading = rail_pose(scene.rails, rail, station)
        boxes += [x, y, math.cos(heading), math.sin(heading), length / 2.0, width / 2.0]
    return boxes_overlap(*boxes)


def test_side_by_side_in_the_junction_only_who_is_ahead_is_followed(scene):
    scene.add(scene.movement("WE"), 4.0, scene.exit("E"))
    scene.add(scene.movement("WS"), 7.0, scene.exit("S"))
    assert leader(scene, 0) == (1, pytest.approx(3.0))
    assert leader(scene, 1) == (-1, math.inf)


@pytest.mark.parametrize(("same_m", "off_m", "who"), [(12.0, 5.0, 2), (4.0, 8.0, 1)])
def test_the_nearer_of_two_leaders_counts(scene, same_m, off_m, who):
    scene.approaching("WE", 3.0)
    scene.add(scene.movement("WE"), same_m, scene.exit("E"))
    scene.add(scene.movement("WS"), off_m, scene.exit("S"))
    assert leader(scene) == (who, pytest.approx(3.0 + 2.0 + min(same_m, off_m)))


def people(scene, i=0):
    return people_ahead(scene.rails, scene.line_up(), i, scene.occupied)


def crossing_at(scene, x, y):
    """Number and half of the crossing whose half a point lies on."""
    for number, (ax, ay, bx, by) in enumerate(scene.crossing_ends):
        part = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        if math.hypot(ax + part * (bx - ax) - x, ay + part * (by - ay) - y) < 0.2 and 0 < part < 1:
            return number, int(part >= 0.5)
    return None


@pytest.mark.parametrize("entry", [True, False])
def test_people_are_seen_from_the_front_to_a_metre_before_their_crossing(scene, entry):
    movement = scene.movement("WE")
    scene.approaching("WE", 5.0)
    stations = np.arange(0.0, scene.rails.length[movement], 0.1)
    found = {}
    for station in stations:
        place = crossing_at(scene, *rail_pose(scene.rails, movement, station)[:2])
        if place is not None:
            found.setdefault(place, []).append(station)
    places = sorted(found, key=lambda place: found[place][0])
    assert len(places) == 2
    place = places[0 if entry else 1]
    assert people(scene) == math.inf
    scene.occupied[place] = 1
    assert people(scene) == pytest.approx(5.0 + np.mean(found[place]) - 1.0, abs=0.15)
    scene.occupied[:] = 1
    scene.occupied[place[0]] = 0
    scene.occupied[place[0], 1 - place[1]] = 1  # the other half is somebody else's way
    other = places[1 if entry else 0]
    scene.occupied[other] = 0
    assert people(scene) == math.inf


def test_who_is_already_on_a_crossing_goes_on(scene):
    movement = scene.movement("WE")
    rails = scene.rails
    at_m = rails.crossings[rails.crossing_first[movement], 1]
    scene.occupied[:] = 1
    before = scene.add(movement, at_m - 2.0 - 0.1, scene.exit("E"))
    on_it = scene.add(movement, at_m - 2.0 + 0.1, scene.exit("E"))
    assert people(scene, before) == pytest.approx(-0.9)  # it is within the last metre
    assert people(scene, on_it) > 10.0


def test_people_more_than_60_m_ahead_do_not_matter(scene):
    scene.occupied[:] = 1
    assert people(scene, scene.approaching("WE", 59.0)) < 60.0
    assert people(scene, scene.approaching("WE", 61.0)) == math.inf


def seen_ego(scene, i=0):
    row = scene.vehicles[i]
    return ego_ahead(
        scene.rails,
        scene.line_up(),
        i,
        row[0],
        row[1],
        row[5] / 2.0,
        scene.ego,
        EGO_LENGTH_M / 2.0,
        EGO_WIDTH_M / 2.0,
    )


def metres_to_contact(scene, ahead_m=0.0, beside_m=0.0, reach_m=25.0):
    """How far the front half of vehicle 0, that much larger, can go before it meets the ego."""
    rails, (rail, onward) = scene.rails, scene.track[0, :2]
    length, width = scene.vehicles[0, 4], scene.vehicles[0, 5]
    x, y, heading, _ = scene.ego
    ego = (x, y, math.cos(heading), math.sin(heading), EGO_LENGTH_M / 2.0, EGO_WIDTH_M / 2.0)
    half = length / 4.0 + ahead_m / 2.0
    for gone in np.arange(0.0, reach_m, 0.05):
        station = scene.motion[0, 0] + gone
        if station > rails.length[rail]:
            px, py, turned = rail_pose(rails, onward, station - rails.length[rail])
        else:
            px, py, turned = rail_pose(rails, rail, station)
        cos, sin = math.cos(turned), math.sin(turned)
        box = (px + half * cos, py + half * sin, cos, sin, half, width / 2.0 + beside_m)
        if boxes_overlap(*box, *ego):
            return gone
    return math.inf


def random_ego_scenes(town, count):
    """Vehicles on the ring's straights and corners with the ego somewhere ahead of each."""
    rng = np.random.default_rng(11)
    while count:
        scene = RailScene(town)
        length = scene.rails.length[EAST]
        station = rng.uniform(0.0, length)
        scene.add(EAST, station, EAST, EAST, speed=rng.uniform(0.0, 8.0))
        x, y, _ = rail_pose(scene.rails, EAST, (station + rng.uniform(3.0, 20.0)) % length)
        scene.ego[:3] = *(np.array([x, y]) + rng.normal(0.0, 2.0, 2)), rng.uniform(-4.0, 4.0)
        if metres_to_contact(scene, 1.5, 0.5, 0.01) == math.inf:  # the two begin well apart
            count -= 1
            yield scene


def test_an_ego_in_the_way_is_seen_in_time_and_one_that_is_not_does_not_matter(ring):
    """Between the contact of the bodies as they are and that of bodies with all their margins."""
    hits = misses = 0
    for scene in random_ego_scenes(ring, 150):
        speed = scene.vehicles[0, 3]
        look_m = min(30.0, 6.0 + 1.5 * speed + speed * speed / 4.0)
        seen, contact_m = seen_ego(scene), metres_to_contact(scene)
        wide_m = metres_to_contact(scene, 0.9 + EGO_MARGIN_M + 0.1, EGO_MARGIN_M + 0.3)
        if contact_m <= look_m - 0.75:
            assert seen <= contact_m
            hits += 1
        if seen < math.inf:
            assert seen >= wide_m - EGO_MARGIN_M - 0.05
        else:
            misses += 1
    assert hits > 50
    assert misses > 20


@pytest.mark.parametrize("way", ["WE", "WS", "SW"])
@pytest.mark.parametrize("turned", [0.0, 1.0, math.pi / 2])
def test_an_ego_in_the_junction_ahead_is_seen_along_ones_own_way(scene, way, turned):
    scene.approaching(way, 4.0, speed=7.0)
    x, y, heading = rail_pose(scene.rails, scene.movement(way), 9.0)
    scene.ego[:3] = x, y, heading + turned
    wide_m = metres_to_contact(scene, 0.9 + EGO_MARGIN_M + 0.1, EGO_MARGIN_M + 0.3)
    assert wide_m - EGO_MARGIN_M - 0.05 <= seen_ego(scene) <= metres_to_contact(scene)


def test_an_ego_standing_ahead_is_seen_a_little_nearer_than_it_is(circle):
    circle.add(EAST, 20.0, EAST, EAST, speed=8.0)
    x, y, heading = rail_pose(circle.rails, EAST, 40.0)
    circle.ego[:3] = x, y, heading
    gap = 20.0 - 2.0 - EGO_LENGTH_M / 2.0
    assert gap - 0.9 - 2.0 * EGO_MARGIN_M <= seen_ego(circle) <= gap


@pytest.mark.parametrize(("aside", "seen"), [(2.2, True), (2.5, False)])
def test_an_ego_beside_the_lane_is_passed_with_40_cm_to_spare(circle, aside, seen):
    """Half of both widths is 1.9 m."""
    circle.add(EAST, 20.0, EAST, EAST, speed=8.0)
    x, y, heading = rail_pose(circle.rails, EAST, 35.0)
    circle.ego[:3] = x - aside * math.sin(heading), y + aside * math.cos(heading), heading
    assert (seen_ego(circle) < math.inf) == seen


def test_an_ego_behind_or_in_the_other_lane_does_not_matter(circle):
    circle.add(EAST, 50.0, EAST, EAST, speed=8.0)
    x, y, heading = rail_pose(circle.rails, EAST, 40.0)
    circle.ego[:3] = x, y, heading
    assert seen_ego(circle) == math.inf
    x, y, heading = rail_pose(circle.rails, EAST, 65.0)
    circle.ego[:3] = x, y - 4.0, heading + math.pi
    assert seen_ego(circle) == math.inf


def line(scene, i=0):
    return line_ahead(scene.rails, scene.line_up(), i, scene.signals, scene.occupied)


def test_a_line_is_as_far_as_ones_front_is_from_it(scene):
    scene.signals[:] = SIGNAL_RED
    scene.approaching("WE", 12.5)
    assert line(scene) == (pytest.approx(12.5), STOP_SIGNAL)
    scene.signals[:] = SIGNAL_GREEN
    assert line(scene) == (math.inf, FREE)


def test_only_the_first_in_line_minds_the_line_and_only_within_60_m(scene):
    scene.signals[:] = SIGNAL_RED
    second, first = scene.approaching("WE", 20.0), scene.approaching("WE", 10.0)
    assert line(scene, second) == (math.inf, FREE)
    assert line(scene, first)[0] == pytest.approx(10.0)
    far = scene.approaching("EW", 61.0)
    assert line(scene, far) == (math.inf, FREE)


def test_who_is_on_its_way_in_minds_no_line(scene):
    scene.signals[:] = SIGNAL_RED
    admitted = scene.approaching("WE", 2.0, speed=6.0, admitted=True)
    inside = scene.add(scene.movement("ES"), 2.0, scene.exit("S"))
    assert line(scene, admitted) == line(scene, inside) == (math.inf, FREE)


def test_on_a_ring_there_is_no_line(circle):
    circle.add(EAST, circle.rails.length[EAST] - 5.0, EAST, EAST)
    assert line(circle) == (math.inf, FREE)


def test_a_slower_rail_ahead_is_approached_at_2_mps2(scene):
    movement = scene.movement("WS")
    slow = scene.rails.samples[scene.rails.first[movement], RAIL_TOP_MPS]
    for line_m in (1.0, 4.0, 8.0):
        scene.approaching("WS", line_m)
        allowed = speed_ahead(scene.rails, scene.line_up(), len(scene.vehicles) - 1)
        assert allowed <= math.sqrt(slow**2 + 2.0 * 2.0 * (line_m + 2.0)) + 1e-9
    assert allowed > slow


def test_speed_on_a_straight_ring_is_what_its_rail_allows(circle):
    circle.add(EAST, 60.0, EAST, EAST)
    rails = circle.rails
    row = rails.first[EAST] + int(60.0 / rails.step_m[EAST])
    assert speed_ahead(rails, circle.line_up(), 0) == rails.samples[row, RAIL_TOP_MPS]


@pytest.mark.parametrize("speed", [0.0, 3.0, 8.0])
def test_a_driver_decides_to_go_on_where_it_could_still_stop_at_2_5_mps2(speed):
    assert commit_distance(speed) > speed**2 / (2.0 * 2.5)
    assert commit_distance(0.0) > 1.0  # where drivers stand and wait
