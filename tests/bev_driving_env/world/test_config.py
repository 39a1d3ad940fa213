import math

import pytest

from bev_driving_env.world.config import RewardWeights, Rules, VehicleModel, WorldConfig


def test_defaults_are_those_of_the_contract():
    config = WorldConfig()
    assert (config.control_hz, config.physics_hz, config.cruise_speed_mps) == (10, 20, 6.0)
    assert (config.vehicle.length_m, config.vehicle.width_m) == (5.0, 2.0)
    assert (config.rules.deviation_m, config.rules.wrong_lane_s) == (3.5, 1.0)
    assert (config.rules.blocked_s, config.rules.blocked_mps) == (30.0, 0.1)
    assert (config.rules.success_fraction, config.rules.success_distance_m) == (0.99, 10.0)
    assert (config.bev.size, config.bev.px_per_m, config.bev.ego_row) == (192, 5.0, 152)
    assert len(config.terminate_on) == 8


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "5", None])
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (VehicleModel, "length_m"),
        (VehicleModel, "max_acceleration_mps2"),
        (VehicleModel, "max_steering_rad"),
        (Rules, "deviation_m"),
        (Rules, "blocked_s"),
        (WorldConfig, "cruise_speed_mps"),
        (WorldConfig, "control_hz"),
        (WorldConfig, "physics_hz"),
    ],
)
def test_a_number_that_is_not_positive_is_refused_by_name_and_value(kind, name, value):
    with pytest.raises(ValueError, match=f"{name} must be .*{value!r}"):
        kind(**{name: value})


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, "1"])
def test_a_reward_weight_may_be_zero_but_not_negative(value):
    assert RewardWeights(comfort=0.0).comfort == 0.0
    with pytest.raises(ValueError, match=f"comfort must be .*{value!r}"):
        RewardWeights(comfort=value)


def test_wheels_cannot_stand_across():
    with pytest.raises(ValueError, match=r"max_steering_rad must be below pi/2, got 1\.6"):
        VehicleModel(max_steering_rad=1.6)


@pytest.mark.parametrize(("control", "physics"), [(10, 25), (20, 10), (7, 20)])
def test_physics_must_run_a_whole_number_of_times_per_action(control, physics):
    with pytest.raises(ValueError, match=f"multiple of control_hz, got {physics} and {control}"):
        WorldConfig(control_hz=control, physics_hz=physics)


def test_an_unknown_terminating_infraction_is_refused():
    with pytest.raises(ValueError, match="unknown infraction 'crash'"):
        WorldConfig(terminate_on=("off_road", "crash"))


@pytest.mark.parametrize("value", [0.0, -3.0])
def test_a_time_limit_must_be_positive(value):
    with pytest.raises(ValueError, match=f"time_limit_s .*{value}"):
        WorldConfig(time_limit_s=value)


def test_a_route_gets_30_s_plus_0_8_s_a_metre_unless_told_otherwise():
    assert WorldConfig().time_limit_for(100.0) == pytest.approx(110.0)
    assert WorldConfig(time_limit_s=12.0).time_limit_for(100.0) == 12.0
