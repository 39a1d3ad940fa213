import math

import numpy as np
import pytest
from highway_env.road.lane import CircularLane
from highway_env.vehicle.kinematics import Vehicle

from bev_driving_env.kernels.dynamics import advance, braked
from bev_driving_env.towns.registry import road_network
from bev_driving_env.world.config import VehicleModel

DT_S = 0.05
HALF_LENGTH_M = 2.5
SPEED_LIMIT_MPS = 40.0


def drive(ego, acceleration, steering):
    advance(ego, braked(acceleration, ego[3], SPEED_LIMIT_MPS, DT_S), steering, HALF_LENGTH_M, DT_S)


def highway_vehicle(ego):
    return Vehicle(None, ego[:2].copy(), heading=ego[2], speed=ego[3])


def assert_same_motion(ego, vehicle, accelerations, steerings):
    for acceleration, steering in zip(accelerations, steerings, strict=True):
        drive(ego, acceleration, steering)
        vehicle.act({"acceleration": acceleration, "steering": steering})
        vehicle.step(DT_S)
        assert ego[3] > 0.0
        state = [*vehicle.position, vehicle.heading, vehicle.speed]
        np.testing.assert_allclose(ego, state, rtol=0.0, atol=1e-9)


def test_motion_equals_highway_env_over_600_random_actions():
    rng = np.random.default_rng(0)
    ego = np.array([12.0, -7.0, 0.4, 25.0])
    accelerations = rng.uniform(-5.0, 5.0, 600)
    assert (25.0 + np.cumsum(accelerations) * DT_S).min() > 5.0  # so the brakes never end a step
    assert_same_motion(ego, highway_vehicle(ego), accelerations, rng.uniform(-1.2, 1.2, 600))


def test_above_the_speed_limit_the_car_slows_down_as_in_highway_env():
    rng = np.random.default_rng(1)
    ego = np.array([0.0, 0.0, 0.0, 48.0])
    assert Vehicle.MAX_SPEED == SPEED_LIMIT_MPS
    assert_same_motion(ego, highway_vehicle(ego), rng.uniform(0.0, 5.0, 200), np.zeros(200))
    assert ego[3] == pytest.approx(SPEED_LIMIT_MPS, abs=5.0 * DT_S)


def test_brakes_stop_the_car_at_exactly_zero_and_never_reverse_it():
    speeds_left = []
    for speed in np.random.default_rng(2).uniform(0.0, 5.0 * DT_S, 1000):
        ego = np.array([0.0, 0.0, 0.7, speed])
        drive(ego, -5.0, 0.3)
        speeds_left.append(ego[3])
    assert (min(speeds_left), max(speeds_left)) == (0.0, 0.0)


def test_full_brakes_take_speed_squared_over_two_decelerations():
    ego = np.array([0.0, 0.0, 0.0, 12.0])
    while ego[3] > 1e-9:
        drive(ego, -5.0, 0.0)
    # explicit Euler moves with the speed before each step, so half a step farther
    assert ego[0] == pytest.approx(12.0**2 / (2.0 * 5.0) + 12.0 * DT_S / 2.0, abs=1e-9)


def test_a_standing_car_stays_where_it_is_while_the_brakes_hold():
    ego = np.array([3.0, 4.0, 0.7, 0.0])
    for _ in range(20):
        drive(ego, -5.0, 0.5)
    assert ego.tolist() == [3.0, 4.0, 0.7, 0.0]


def test_right_steering_is_a_positive_heading_change_towards_the_south():
    ego = np.array([0.0, 0.0, 0.0, 5.0])
    for _ in range(10):
        drive(ego, 0.0, 0.3)
    assert ego[2] > 0.0
    assert ego[1] > 0.0


def test_left_and_right_steering_mirror_each_other():
    right, left = np.array([[0.0, 0.0, 0.0, 5.0], [0.0, 0.0, 0.0, 5.0]])
    for _ in range(100):
        drive(right, 1.0, 0.5)
        drive(left, 1.0, -0.5)
    np.testing.assert_allclose(left, right * [1.0, -1.0, -1.0, 1.0], atol=1e-12)


def full_lock_radius_m():
    """Radius of the circle that the centre of the default car drives at full lock."""
    model = VehicleModel()
    ego, xs = np.array([0.0, 0.0, 0.0, 1.0]), []
    while ego[2] < 2.0 * math.pi:
        advance(ego, 0.0, model.max_steering_rad, model.length_m / 2.0, 0.01)
        xs.append(ego[0])
    return (max(xs) - min(xs)) / 2.0


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_full_lock_is_enough_for_the_tightest_turn_of_the_town(town):
    lanes = road_network(town).lanes_list()
    tightest = min(lane.radius for lane in lanes if isinstance(lane, CircularLane))
    assert full_lock_radius_m() < 0.9 * tightest
