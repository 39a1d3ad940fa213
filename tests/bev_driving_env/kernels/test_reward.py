import math

import numpy as np
import pytest

from bev_driving_env.kernels.layout import BLOCKED, OFF_ROAD, PROGRESS_COLUMNS, REWARD_TERMS
from bev_driving_env.kernels.reward import fill_reward_terms
from bev_driving_env.world.config import RewardWeights, WorldConfig

STEP_AT_CRUISE_M = 0.6  # 6 m/s for a tenth of a second


def terms(
    gained_m=0.0,
    lateral_m=0.0,
    heading_rad=0.0,
    before=(0.0, 0.0),
    command=(0.0, 0.0),
    infractions=0,
    weights=None,
):
    """Progress, lateral, heading, comfort and infraction terms of one step."""
    config = WorldConfig(reward=weights or RewardWeights())
    progress = np.zeros(PROGRESS_COLUMNS)
    progress[:4] = 100.0 + gained_m, 100.0 + gained_m, lateral_m, heading_rad
    result = np.full(REWARD_TERMS, np.nan)
    fill_reward_terms(
        config.physics(), 100.0, progress, np.array(before), np.array(command), infractions, result
    )
    return result


def test_cruising_along_the_lane_center_earns_one():
    np.testing.assert_allclose(terms(STEP_AT_CRUISE_M), [1, 0, 0, 0, 0], atol=1e-12)


def test_half_the_cruising_speed_earns_half_and_speeding_no_more_than_one():
    assert terms(STEP_AT_CRUISE_M / 2.0)[0] == pytest.approx(0.5)
    assert terms(STEP_AT_CRUISE_M * 3.0)[0] == pytest.approx(1.0)


def test_standing_on_the_lane_center_earns_nothing():
    assert not terms().any()


@pytest.mark.parametrize(("lateral_m", "cost"), [(0.7, 0.1), (-1.75, 0.25), (3.5, 0.5), (-9, 0.5)])
def test_lateral_error_costs_up_to_a_half_at_3_5_metres_on_either_side(lateral_m, cost):
    assert terms(lateral_m=lateral_m)[1] == pytest.approx(-cost)


@pytest.mark.parametrize("heading", [math.pi / 2.0, -math.pi / 2.0])
def test_driving_across_the_lane_costs_a_quarter(heading):
    assert terms(heading_rad=heading)[2] == pytest.approx(-0.25)


def test_comfort_is_the_change_of_the_command_not_its_size():
    assert terms(before=(1.0, -0.5), command=(1.0, -0.5))[3] == 0.0
    assert terms(before=(0.0, 0.0), command=(1.0, -1.0))[3] == pytest.approx(-0.05)
    assert terms(before=(1.0, -1.0), command=(-1.0, 1.0))[3] == pytest.approx(-0.1)


def test_each_infraction_that_begins_costs_ten():
    assert terms(infractions=OFF_ROAD)[4] == pytest.approx(-10.0)
    assert terms(infractions=OFF_ROAD | BLOCKED)[4] == pytest.approx(-20.0)


def test_weights_scale_their_own_term_only():
    everything = {
        "gained_m": 0.3,
        "lateral_m": 1.0,
        "heading_rad": 0.4,
        "command": (0.2, 0.3),
        "infractions": OFF_ROAD,
    }
    weights = RewardWeights(progress=2.0, lateral=1.0, heading=1.5, comfort=0.4, infraction=5.0)
    ratio = terms(**everything, weights=weights) / terms(**everything)
    np.testing.assert_allclose(ratio, [2.0, 2.0, 3.0, 4.0, 0.5])
