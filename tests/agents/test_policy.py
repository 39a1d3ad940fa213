"""The Beta policy under Stable-Baselines3: learning, saving, predicting, cloning."""

import gymnasium as gym
import numpy as np
import pytest
import scipy.stats
import torch
from stable_baselines3 import A2C, PPO

import agents
import bev_driving_env
from agents.beta import beta_mode, beta_nll
from agents.distribution import BetaDistribution
from agents.policy import BetaPolicy
from agents.registry import agent_source

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def env():
    bev = {"size": 144, "px_per_m": 3.75, "ego_row": 114}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=1.0)


def make_policy(env, **keywords):
    torch.manual_seed(0)
    return BetaPolicy(env.observation_space, env.action_space, lambda _: 1e-3, **keywords)


def make_ppo(env, **policy_kwargs):
    return PPO(
        BetaPolicy,
        env,
        n_steps=16,
        batch_size=16,
        n_epochs=1,
        seed=0,
        device="cpu",
        policy_kwargs=policy_kwargs,
    )


def observe(env, seed=0):
    return env.reset(seed=seed)[0]


def batch(env, number):
    observations = [observe(env, seed) for seed in range(number)]
    return {k: torch.from_numpy(np.stack([o[k] for o in observations])) for k in observations[0]}


def test_it_is_exported_by_the_package():
    assert agents.BetaPolicy is BetaPolicy


@pytest.mark.parametrize("algorithm", [PPO, A2C])
def test_it_learns_and_predicts_the_same_after_saving_and_loading(algorithm, env, tmp_path):
    if algorithm is PPO:
        model = make_ppo(env, channels=(0, 1, 2, 5))
    else:
        model = A2C(BetaPolicy, env, n_steps=8, seed=0, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(16)
    after = list(model.policy.parameters())
    moved = [not torch.equal(a, b) for a, b in zip(before, after, strict=True)]
    assert all(moved)  # actor and critic, to the last layer
    assert all(torch.isfinite(p).all() for p in after)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=env, device="cpu")
    assert loaded.policy.config == model.policy.config
    observation = observe(env)
    action, _ = loaded.predict(observation, deterministic=True)
    np.testing.assert_array_equal(action, model.predict(observation, deterministic=True)[0])
    assert action in env.action_space
    loaded.learn(8)  # fine-tuning goes on


def test_the_shipped_weights_are_where_reinforcement_learning_can_go_on_from(tmp_path):
    cloned = agents.load_weights(agent_source("bc"))
    env = gym.make("BEVTown01-v0", time_limit_s=1.0)
    model = PPO(
        BetaPolicy,
        env,
        n_steps=16,
        batch_size=16,
        n_epochs=1,
        device="cpu",
        policy_kwargs=cloned.config.policy_kwargs,
    )
    model.policy.actor().load_state_dict(cloned.actor().state_dict())
    observation = observe(env)
    observation["measurements"][0] = 4.0  # a scale of its own would show
    expected, _ = cloned.predict(observation, deterministic=True)
    np.testing.assert_array_equal(model.predict(observation, deterministic=True)[0], expected)
    model.learn(16)
    assert not np.array_equal(model.predict(observation, deterministic=True)[0], expected)
    model.save(tmp_path / "tuned")
    tuned = PPO.load(tmp_path / "tuned", device="cpu")
    np.testing.assert_array_equal(
        tuned.predict(observation, deterministic=True)[0],
        model.predict(observation, deterministic=True)[0],
    )


def test_its_policy_alone_can_be_saved_and_loaded(env, tmp_path):
    policy = make_policy(
        env,
        channels=(1,),
        measurements=(0,),
        speed_scale_mps=3.0,
        concentration_floor=0.1,
        deterministic_action="mean",
    )
    policy.save(tmp_path / "policy.pt")
    loaded = BetaPolicy.load(tmp_path / "policy.pt", device="cpu")
    assert loaded.config == policy.config
    observation = observe(env)
    actions = [p.predict(observation, deterministic=True)[0] for p in (policy, loaded)]
    np.testing.assert_array_equal(*actions)


def test_a_batch_is_evaluated_as_its_rows_are_predicted(env):
    policy = make_policy(env)
    observations = batch(env, 3)
    actions, values, log_prob = policy(observations)
    again = policy.evaluate_actions(observations, actions)
    torch.testing.assert_close(again[0], values)
    torch.testing.assert_close(again[1], log_prob)
    assert again[2].shape == log_prob.shape == (3,)
    assert values.shape == (3, 1)
    distribution = policy.get_distribution(observations)
    alpha, beta = (c.detach().numpy() for c in (distribution.alpha, distribution.beta))
    chosen = actions.numpy()
    density = scipy.stats.beta(alpha, beta, loc=-1.0, scale=2.0)
    np.testing.assert_allclose(
        log_prob.detach().numpy(), density.logpdf(chosen).sum(axis=1), rtol=1e-4, atol=1e-4
    )
    np.testing.assert_allclose(
        again[2].detach().numpy(), density.entropy().sum(axis=1), rtol=1e-4, atol=1e-4
    )


def test_the_actor_is_the_same_network_on_the_same_parameters(env):
    policy = make_policy(env)
    observations = batch(env, 2)
    actor = policy.actor()
    distribution = policy.get_distribution(observations)
    alpha, beta = actor(observations["bev"], observations["measurements"])
    assert torch.equal(alpha, distribution.alpha)
    assert torch.equal(beta, distribution.beta)
    own = {id(parameter) for parameter in policy.parameters()}
    assert {id(parameter) for parameter in actor.parameters()} < own


def test_cloning_the_actor_teaches_the_policy(env):
    policy = make_policy(env)
    observations = batch(env, 4)
    observations["measurements"][:, 0] = torch.tensor([0.0, 2.0, 4.0, 6.0])
    target = torch.tensor([[0.8, -0.6], [0.2, -0.1], [-0.8, 0.5], [0.4, 0.9]])
    actor = policy.actor()
    optimizer = torch.optim.Adam(actor.parameters(), 3e-4)

    def loss():
        return beta_nll(*actor(observations["bev"], observations["measurements"]), target).mean()

    first = loss().item()
    for _ in range(90):
        optimizer.zero_grad()
        loss().backward()
        optimizer.step()
    last = loss().item()
    assert last < first - 2.0
    _, log_prob, _ = policy.evaluate_actions(observations, target)
    # per action, of which there are two, the density halves from (0, 1) to (-1, 1)
    assert -log_prob.mean().item() == pytest.approx(last + 2 * np.log(2.0), abs=1e-3)


def test_deterministic_actions_are_the_mode_or_the_mean_and_others_vary(env):
    observation = observe(env)
    for point in ("mode", "mean"):
        policy = make_policy(env, deterministic_action=point)
        distribution = policy.get_distribution(policy.obs_to_tensor(observation)[0])
        alpha, beta = distribution.alpha, distribution.beta
        expected = beta_mode(alpha, beta) if point == "mode" else (alpha - beta) / (alpha + beta)
        action, _ = policy.predict(observation, deterministic=True)
        np.testing.assert_array_equal(action, expected[0].detach().numpy())
    sampled = [policy.predict(observation)[0] for _ in range(5)]
    assert len({tuple(a) for a in sampled}) == 5
    assert all(a in env.action_space for a in sampled)


def test_a_floor_of_one_gives_every_distribution_a_single_peak(env):
    distribution = make_policy(env, concentration_floor=1.0).get_distribution(batch(env, 2))
    assert distribution.alpha.min() > 1.0
    assert distribution.beta.min() > 1.0


def test_stable_baselines3_can_compare_two_distributions(env):
    from stable_baselines3.common.distributions import kl_divergence

    ones = torch.ones(3, 2)
    first = BetaDistribution(2).proba_distribution(ones, ones)
    second = BetaDistribution(2).proba_distribution(2 * ones, ones)
    # KL(uniform || 2x) = -log 2 + 1 per dimension
    torch.testing.assert_close(kl_divergence(first, second), (1 - np.log(2.0)) * ones)


def test_an_unknown_point_is_refused(env):
    with pytest.raises(ValueError, match="'mode' or 'mean', got 'median'"):
        make_policy(env, deterministic_action="median")


def test_observations_that_it_cannot_look_at_are_refused(env):
    with pytest.raises(ValueError, match="Dict observation with 'bev' and 'measurements'"):
        make_policy(bev_driving_env.BEVOnly(env))
    spaces = {**env.observation_space.spaces, "bev": gym.spaces.Box(0, 1, (6, 144, 144))}
    with pytest.raises(ValueError, match="square uint8 'bev'"):
        BetaPolicy(gym.spaces.Dict(spaces), env.action_space, lambda _: 1e-3)
    spaces["bev"] = gym.spaces.Box(0, 255, (3, 144, 144), np.uint8)
    with pytest.raises(ValueError, match=r"\(0, 5\) are not all among the BEV's 3"):
        BetaPolicy(gym.spaces.Dict(spaces), env.action_space, lambda _: 1e-3, channels=(0, 5))


def test_actions_that_it_does_not_cover_are_refused(env):
    with pytest.raises(ValueError, match="RescaleAction"):
        BetaPolicy(env.observation_space, gym.spaces.Box(0.0, 1.0, (2,)), lambda _: 1e-3)


def test_noise_of_another_kind_is_refused(env):
    with pytest.raises(ValueError, match="use_sde=False"):
        PPO(BetaPolicy, env, use_sde=True, device="cpu")
