"""The car-following model against highway-env's own vehicles."""

import importlib.util

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle import behavior

from bev_driving_env.kernels import idm
from bev_driving_env.kernels.idm import idm_free, idm_interaction


def pristine(module):
    """A module loaded anew: highway-env's intersections overwrite parameters of its classes."""
    spec = importlib.util.spec_from_file_location("pristine", module.__file__)
    fresh = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fresh)
    return fresh


IDMVehicle = pristine(behavior).IDMVehicle
CENTRES_JAM_M = idm.JAM_GAP_M + IDMVehicle.LENGTH
LIMIT_MPS = 50.0


@pytest.fixture(scope="module")
def road():
    return Road(RoadNetwork.straight_road_network(1, length=1000, speed_limit=LIMIT_MPS))


def car(road, x, speed, wanted=None):
    return IDMVehicle(road, [x, 0.0], speed=speed, target_speed=wanted)


def followings(count):
    """Random own speed, wanted speed, leader's speed and distance between centres."""
    rng = np.random.default_rng(3)
    return rng.uniform((0.0, 1.0, 0.0, 0.5), (25.0, 30.0, 25.0, 80.0), (count, 4))


def desired_gap_m(speed, leader_speed):
    closing = speed * (speed - leader_speed) / (2.0 * np.sqrt(15.0))
    return 10.0 + 1.5 * speed + closing


def test_the_parameters_are_those_of_highway_env():
    assert idm.COMFORT_MPS2 == IDMVehicle.COMFORT_ACC_MAX
    assert -idm.BRAKING_MPS2 == IDMVehicle.COMFORT_ACC_MIN
    assert idm.TIME_GAP_S == IDMVehicle.TIME_WANTED
    assert CENTRES_JAM_M == IDMVehicle.DISTANCE_WANTED
    assert idm.CLIP_MPS2 == IDMVehicle.ACC_MAX


def test_behind_a_leader_the_unclipped_acceleration_equals_highway_env(road):
    compared = 0
    for speed, wanted, leader_speed, distance in followings(400):
        if desired_gap_m(speed, leader_speed) < 0.0:
            continue
        ego, leader = car(road, 100.0, speed, wanted), car(road, 100.0 + distance, leader_speed)
        ours = idm_free(speed, wanted)
        ours -= idm_interaction(speed, distance, CENTRES_JAM_M, speed - leader_speed)
        theirs = ego.acceleration(ego, front_vehicle=leader)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
        compared += 1
    assert compared > 300


def test_without_a_leader_the_unclipped_acceleration_equals_highway_env(road):
    for speed, wanted, _, _ in followings(100):
        ego = car(road, 100.0, speed, wanted)
        theirs = ego.acceleration(ego)
        np.testing.assert_allclose(idm_free(speed, wanted), theirs, rtol=1e-9, atol=1e-9)


def test_a_leader_that_flees_fast_is_no_reason_to_brake_unlike_in_highway_env(road):
    speed, leader_speed, distance = 10.0, 40.0, 12.0
    assert desired_gap_m(speed, leader_speed) < 0.0
    assert idm_interaction(speed, distance, CENTRES_JAM_M, speed - leader_speed) == 0.0
    ego, leader = car(road, 100.0, speed, 20.0), car(road, 100.0 + distance, leader_speed)
    assert ego.acceleration(ego, front_vehicle=leader) < ego.acceleration(ego) - 1.0


def test_on_an_empty_road_acceleration_falls_to_nothing_at_the_wanted_speed():
    assert idm_free(0.0, 8.0) == 3.0
    assert idm_free(8.0, 8.0) == 0.0
    assert idm_free(9.0, 8.0) < 0.0 < idm_free(7.0, 8.0)


def test_standing_at_the_jam_distance_nobody_moves():
    assert idm_free(0.0, 8.0) - idm_interaction(0.0, 5.0, 5.0, 0.0) == pytest.approx(0.0)


def test_nothing_is_infinite_when_bumpers_touch_or_nobody_wants_to_move():
    assert np.isfinite(idm_interaction(8.0, 0.0, 5.0, 8.0))
    assert np.isfinite(idm_interaction(8.0, -3.0, 5.0, 8.0))
    assert np.isfinite(idm_free(8.0, 0.0))
