import math

import numpy as np
import pytest

from bev_driving_env.kernels.layout import HEADING, LENGTH, SPEED, STATION
from bev_driving_env.kernels.rails import rail_pose
from bev_driving_env.towns.route import route_by_turns

from .rail_scene import EGO_LENGTH_M, RailScene

NOBODY = -1


@pytest.fixture
def scene(ladder):
    return RailScene(ladder)


@pytest.fixture(scope="module")
def route(ladder):
    """From the northern road west into the rung, on to the south and back up in the west."""
    return route_by_turns(ladder, (75.0, -2.0), "B1L B2R", (2.0, 20.0))


def crowded(town, seed, *, ties=False):
    """A town with 40 vehicles anywhere on its rails, some of them empty slots."""
    scene, rng = RailScene(town), np.random.default_rng(seed)
    for _ in range(40):
        rail = int(rng.integers(len(scene.rails.length)))
        station = rng.uniform(0.0, scene.rails.length[rail])
        scene.add(rail, station // 20 * 20 if ties else station, speed=rng.uniform(0.0, 9.0))
    scene.vehicles[rng.random(40) < 0.2, LENGTH] = 0.0
    return scene


def chain(lineup, rail):
    """Drivers on a rail from the rearmost on."""
    found, i = [], int(lineup.rearmost[rail])
    while i != NOBODY:
        found.append(i)
        i = int(lineup.ahead[i])
    return found


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("name", ["ladder", "ring"])
def test_each_rail_lists_its_drivers_by_their_stations(name, ties, seed, request):
    scene = crowded(request.getfixturevalue(name), seed, ties=ties)
    lineup = scene.line_up()
    there = scene.vehicles[:, LENGTH] > 0.0
    for rail in range(len(scene.rails.length)):
        here = np.flatnonzero(there & (scene.track[:, 0] == rail))
        wanted = here[np.argsort(scene.motion[here, STATION], kind="stable")].tolist()
        assert chain(lineup, rail) == wanted
        assert lineup.foremost[rail] == (wanted[-1] if wanted else NOBODY)
    assert (lineup.rail[:-1] >= 0).tolist() == there.tolist()


def test_a_line_up_forgets_the_last_one(scene):
    scene.add(0, 10.0)
    lineup = scene.line_up()
    assert chain(lineup, 0) == [0]
    scene.vehicles[0, LENGTH] = 0.0
    assert chain(scene.line_up(), 0) == []


def test_a_line_up_tells_of_each_vehicle_what_the_state_does(scene):
    i = scene.approaching("WE", 7.0, speed=3.0, length=5.5, waited=2.0, admitted=True)
    lineup = scene.line_up()
    assert lineup.rail[i] == scene.approach("W")
    assert lineup.onward[i] == scene.movement("WE")
    assert lineup.after[i] == scene.exit("E")
    assert lineup.station[i] == scene.motion[i, STATION]
    assert (lineup.speed[i], lineup.length[i], lineup.waited[i]) == (3.0, 5.5, 2.0)
    assert lineup.admitted[i] == 1


def test_the_ego_is_where_its_route_runs(scene, route):
    visited = []
    for position in np.arange(0.0, route.length_m, 0.5):
        scene.send_ego(route, position, speed=4.0)
        lineup = scene.line_up()
        rail, station = int(lineup.rail[-1]), lineup.station[-1]
        assert 0.0 <= station <= scene.rails.length[rail] + 1e-6
        pose = rail_pose(scene.rails, rail, station)
        assert math.dist(pose[:2], scene.ego[:2]) < 0.3  # the nearest of the route's points
        assert math.cos(pose[2] - scene.ego[HEADING]) > 0.99
        assert chain(lineup, rail) == [0]
        assert lineup.speed[-1] == scene.ego[SPEED]
        if not visited or visited[-1] != rail:
            visited.append(rail)
            coming = [int(lineup.onward[-1]), int(lineup.after[-1])]
            ahead = [int(rail) for rail in scene.route_rails[len(visited) :]]
            assert coming == [*ahead, NOBODY, NOBODY][:2]
    assert visited == scene.route_rails.tolist()
    assert visited[:3] == [scene.approach("E"), scene.movement("ES"), scene.exit("S")]


def test_the_ego_stands_in_line_among_the_vehicles(scene, route):
    scene.send_ego(route, 5.0)
    road = scene.approach("E")
    station = scene.line_up().station[-1]
    behind, ahead = scene.add(road, station - 8.0), scene.add(road, station + 8.0)
    lineup = scene.line_up()
    ego = len(scene.vehicles)
    assert chain(lineup, road) == [behind, ego, ahead]
    assert lineup.length[ego] == EGO_LENGTH_M


@pytest.mark.parametrize(
    ("off", "there"),
    [
        ({"distance_m": 1.9}, True),
        ({"distance_m": 2.1}, False),
        ({"error_rad": math.radians(59.0)}, True),
        ({"error_rad": math.radians(61.0)}, False),
        ({"error_rad": math.radians(-59.0)}, True),
        ({"error_rad": math.radians(-61.0)}, False),
    ],
)
def test_an_ego_off_its_route_or_turned_away_is_left_out(scene, route, off, there):
    scene.send_ego(route, 5.0)
    scene.turn_ego_off(**off)
    lineup = scene.line_up()
    assert (lineup.rail[-1] >= 0) == there
    assert (chain(lineup, scene.approach("E")) == [0]) == there


def test_an_ego_that_comes_back_to_its_route_is_in_line_again(scene, route):
    scene.send_ego(route, 5.0)
    scene.turn_ego_off(distance_m=3.0)
    assert scene.line_up().rail[-1] == NOBODY
    scene.turn_ego_off()
    assert scene.line_up().rail[-1] == scene.approach("E")


def test_an_ego_without_a_route_is_left_out(scene):
    scene.progress[:] = 0.0
    assert scene.line_up().rail[-1] == NOBODY


@pytest.mark.parametrize(("speed", "admitted"), [(0.0, 0), (7.5, 0), (9.0, 1)])
def test_an_ego_too_fast_to_stop_at_its_line_counts_as_going_on(scene, route, speed, admitted):
    """At 3.5 m/s^2 it stops from 7.5 m/s within 8.0 m, from 9 m/s within 11.6 m."""
    scene.send_ego(route, 0.0)
    line = scene.rails.length[scene.approach("E")] - scene.line_up().station[-1]
    scene.send_ego(route, line - EGO_LENGTH_M / 2.0 - 10.0, speed=speed)
    assert scene.line_up().admitted[-1] == admitted
