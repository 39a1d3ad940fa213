import numpy as np
import pytest

from bev_driving_env.world.config import RewardWeights


def test_cruising_on_the_lane_center_earns_one_a_step(start, drive):
    world = start(speed=6.0)
    drive(world, 1.0)
    np.testing.assert_allclose(world.reward_terms[0], [1, 0, 0, 0, 0], atol=1e-9)
    assert world.state.returns[0] == pytest.approx(10.0)


def test_speeding_earns_no_more_than_cruising(start, drive):
    world = start(speed=12.0)
    drive(world, 1.0)
    assert world.state.returns[0] == pytest.approx(10.0)


def test_standing_earns_nothing(start, drive):
    world = start()
    drive(world, 1.0)
    assert world.state.returns[0] == 0.0


def test_driving_the_same_metres_again_earns_nothing(start, drive):
    world = start(speed=6.0)
    drive(world, 2.0)
    world.state.ego[0, 0] -= 4.0
    drive(world, 0.6)
    assert world.reward_terms[0, 0] == 0.0
    drive(world, 0.2)
    assert world.reward_terms[0, 0] == pytest.approx(1.0)


def test_a_metre_beside_the_lane_center_costs_a_seventh(start, drive):
    world = start(y=3.0, speed=6.0)
    drive(world, 0.1)
    np.testing.assert_allclose(world.reward_terms[0], [1, -0.5 / 3.5, 0, 0, 0], atol=1e-9)
    assert world.rewards[0] == pytest.approx(1.0 - 0.5 / 3.5)


def test_the_first_action_is_compared_with_no_action(start, drive):
    world = start(speed=6.0)
    drive(world, 0.2, acceleration=-0.4)
    assert world.state.command[0, 0] == -0.4
    assert world.reward_terms[0, 3] == 0.0  # the second of two like actions
    world.step(np.array([[0.4, 0.0]]))
    assert world.reward_terms[0, 3] == pytest.approx(-0.1 * 0.8 / 4.0)


def test_an_infraction_costs_ten_once(start, drive):
    world = start(y=4.4, speed=6.0)
    drive(world, 0.1)
    assert world.reward_terms[0, 4] == pytest.approx(-10.0)
    drive(world, 0.1)
    assert world.reward_terms[0, 4] == 0.0


def test_the_reward_is_the_sum_of_its_terms_and_the_return_that_of_the_rewards(start):
    world = start(speed=4.0, worlds=2, reward=RewardWeights(lateral=2.0, comfort=1.0))
    rng, total = np.random.default_rng(0), np.zeros(2)
    for _ in range(50):
        world.step(rng.uniform(-0.3, 0.3, (2, 2)))
        np.testing.assert_allclose(world.rewards, world.reward_terms.sum(axis=1), atol=1e-12)
        total += world.rewards
    np.testing.assert_allclose(world.state.returns, total, atol=1e-9)
    assert len(set(total)) == 2
