"""The long routes and the evaluation episodes, against what is known of them."""

import math

import numpy as np
import pytest

from bev_driving_env.towns.registry import compiled_town, route_book

# start x, y, yaw; end x, y, yaw (degrees); length; left, right, straight; bends; junctions
LEADERBOARD = {
    ("Town01", 0): (338.7, 226.75, 270, 1.37, 47.94, 270, 762.2, (2, 1, 0), 1, "D4L B4L B5R"),
    ("Town01", 1): (121.72, 59.18, 0, 92.38, 81.86, 270, 564.9, (0, 3, 1), 0, "C2S D2R D3R B3R"),
    ("Town01", 2): (53.06, -2.36, 180, 396.32, 129.71, 270, 972.3, (0, 0, 2), 3, "B5S D5S"),
    ("Town01", 3): (315.27, 1.78, 0, 1.32, 24.53, 270, 1070.6, (2, 4, 3), 1,
                    "D1R D2R C2R C1L B1L B2S B3S B4S B5R"),
    ("Town01", 4): (56.91, 1.64, 0, 310.57, 198.71, 0, 568.6, (2, 2, 2), 0,
                    "B1S C1R C2R B2L B3S B4L"),
    ("Town01", 5): (334.73, 288.91, 90, -2.19, 269.01, 90, 1187.9, (3, 2, 1), 3,
                    "D5L D1S C1L C2R B2R B1L"),
    ("Town01", 6): (92.42, 315.17, 270, 135.82, 59.19, 0, 774.6, (2, 3, 0), 0,
                    "B4R D4L D3L B3R B2R"),
    ("Town01", 7): (157.99, 39.4, 270, 269.33, 326.42, 180, 711.2, (0, 1, 2), 2, "C1R D1S D5S"),
    ("Town01", 8): (204.93, 326.38, 180, 334.68, 173.57, 90, 579.1, (0, 3, 1), 0,
                    "B5R B4S B3R D3R"),
    ("Town01", 9): (338.68, 176.0, 270, 365.13, 326.48, 180, 925.2, (1, 2, 2), 2,
                    "D3S D2L C2R C1R D1S"),
    ("Town02", 0): (-3.7, 179.06, 270, -3.67, 205.78, 270, 1014.8, (2, 2, 3), 4,
                    "D2R C2S B2L B3L C3S D3R B4S"),
    ("Town02", 1): (132.09, 202.28, 90, 189.54, 174.08, 90, 1043.7, (0, 4, 4), 4,
                    "C3R B3R B2R C2S D2R D3S B4S A2S"),
    ("Town02", 2): (193.54, 177.56, 270, 178.15, 241.33, 0, 920.0, (5, 1, 2), 3,
                    "A2L B2R B3S B4L D3S D2L C2L C3L"),
    ("Town02", 3): (-3.74, 144.44, 270, 58.52, 236.92, 180, 1002.4, (2, 1, 4), 4,
                    "D2R C2S B2S A2L B4S D3L C3S"),
    ("Town02", 4): (25.94, 105.64, 180, -3.67, 203.93, 270, 876.4, (5, 6, 1), 2,
                    "A2L B2R B3L C3L C2R D2R D3R C3R C2L B2L B3S B4R"),
}  # fmt: skip


def route_of(town, suite, index):
    return route_book(town).route(suite, index, compiled_town(town))


def corners(route):
    """Numbers of the route's corner lanes, in order: bends that are no junction."""
    lanes = [route.town.lanes[number] for number in route.lanes]
    return [k for k, lane in enumerate(lanes) if not lane.in_junction and bends(lane)]


def bends(lane):
    return abs(lane.heading_change_rad) > math.radians(80.0)


def heading_change(route):
    """Degrees turned from start to end, right turns positive."""
    headings = np.unwrap(np.arctan2(route.points[:, 3], route.points[:, 2]))
    return math.degrees(headings[-1] - headings[0])


def count(route, letter):
    return sum(word.endswith(letter) for word in route.turns.split())


@pytest.mark.parametrize(("name", "index"), LEADERBOARD)
def test_a_long_route_is_the_leaderboards(name, index):
    *start, end_x, end_y, end_yaw, length, letters, bend_count, junctions = LEADERBOARD[name, index]
    route = route_of(name, "route", index)
    assert route.turns == junctions
    assert tuple(count(route, letter) for letter in "LRS") == letters
    assert len(corners(route)) == bend_count
    assert route.length_m == pytest.approx(length, rel=0.002)
    for (x, y, dx, dy), pose in zip(
        route.points[[0, -1]], (start, (end_x, end_y, end_yaw)), strict=True
    ):
        assert math.dist((x, y), pose[:2]) < 0.75  # recorded waypoints lie up to 0.69 m off
        assert math.cos(math.atan2(dy, dx) - math.radians(pose[2])) > 0.9999


@pytest.mark.parametrize("name", ["Town01", "Town02"])
def test_a_town_has_ten_different_long_routes(name):
    book = route_book(name)
    assert book.size("route") == 10
    assert len(set(book.suites["route"])) == 10
    assert all(route_of(name, "route", k).length_m > 500.0 for k in range(10))


@pytest.mark.parametrize("suite", ["route", "episode"])
@pytest.mark.parametrize("name", ["Town01", "Town02"])
def test_lefts_and_rights_add_up_to_the_heading_that_changed(name, suite):
    for index in range(route_book(name).size(suite)):
        route = route_of(name, suite, index)
        quarter_turns = count(route, "R") - count(route, "L")
        for k in corners(route):
            quarter_turns += 1 if route.town.lanes[route.lanes[k]].heading_change_rad > 0 else -1
        assert heading_change(route) == pytest.approx(90.0 * quarter_turns, abs=0.01)


@pytest.mark.parametrize(("name", "total_m"), [("Town01", 598.0), ("Town02", 604.0)])
def test_the_five_episodes_are_as_long_as_the_papers(name, total_m):
    routes = [route_of(name, "episode", k) for k in range(5)]
    assert route_book(name).size("episode") == 5
    assert sum(route.length_m for route in routes) == pytest.approx(total_m, rel=0.02)


@pytest.mark.parametrize("name", ["Town01", "Town02"])
def test_the_episodes_hold_three_lefts_three_rights_and_a_corner(name):
    routes = [route_of(name, "episode", k) for k in range(5)]
    assert sum(count(route, "L") for route in routes) >= 3
    assert sum(count(route, "R") for route in routes) >= 3
    assert sum(len(corners(route)) for route in routes) >= 1


def test_episode_2_of_town01_has_a_curve_and_two_junctions():
    route = route_of("Town01", "episode", 1)
    assert len(corners(route)) >= 1
    assert len(route.turns.split()) == 2


def test_episode_3_of_town01_goes_west_then_south_round_the_north_west_bend():
    route = route_of("Town01", "episode", 2)
    np.testing.assert_allclose(route.points[0, 2:], (-1.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(route.points[-1, 2:], (0.0, 1.0), atol=1e-9)
    (bend,) = corners(route)
    assert math.dist(route.town.lanes[route.lanes[bend]].points[0, :2], (0.0, 0.0)) < 12.0
    assert 5.0 < route.points[0, 0] - 8.9 < 60.0  # it starts shortly before the bend
    assert route.turns == ""


def test_episode_1_of_town02_ends_with_a_left_turn_in_the_middle():
    last = route_of("Town02", "episode", 0).turns.split()[-1]
    assert last in ("B2L", "B3L", "C2L", "C3L")


def test_episode_4_of_town02_turns_left_in_the_east():
    turns = route_of("Town02", "episode", 3).turns.split()
    assert {"D2L", "D3L"} & set(turns)
