"""Weights as safetensors, and the agent that drives with them."""

import json
import struct

import gymnasium as gym
import numpy as np
import pytest
import torch

import bev_driving_env
from agents import Agent, load_weights, save_weights
from agents.beta_agent import BetaAgent, load_beta_agent
from agents.checkpoint import KIND, VERSION, WeightsError, weights_card
from agents.policy import BetaPolicy

CARD = {"trained_on": "Town01", "clean_episodes": 10}


@pytest.fixture(scope="module")
def env():
    bev = {"size": 144, "px_per_m": 3.75, "ego_row": 114}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=1.0)


@pytest.fixture(scope="module")
def policy(env):
    torch.manual_seed(0)
    return BetaPolicy(
        env.observation_space,
        env.action_space,
        lambda _: 1e-3,
        channels=(1, 0),
        measurements=(0,),
        speed_scale_mps=5.0,
        concentration_floor=1.0,  # so that mode and mean differ
        deterministic_action="mean",
    )


@pytest.fixture
def path(policy, tmp_path):
    save_weights(policy, tmp_path / "a" / "policy.safetensors", CARD)
    return tmp_path / "a" / "policy.safetensors"


def rewritten(path, change):
    """The file with its header, a dict, changed."""
    content = path.read_bytes()
    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # tensors start aligned
    path.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + length :])


def own_header(header, **fields):
    stored = json.loads(header["__metadata__"][KIND])
    header["__metadata__"][KIND] = json.dumps({**stored, **fields})


def test_a_policy_comes_back_in_half_precision(policy, path):
    loaded = load_weights(path)
    assert loaded.config == policy.config
    assert loaded.action_dist.point == "mean"
    assert not loaded.training
    before, after = policy.actor().state_dict(), loaded.actor().state_dict()
    assert before.keys() == after.keys()
    for name, value in before.items():
        assert torch.equal(after[name], value.half().float())
    assert weights_card(path) == CARD


def test_a_file_takes_two_bytes_a_weight(policy, path):
    weights = sum(p.numel() for p in policy.actor().parameters())
    assert 2 * weights < path.stat().st_size < 2 * weights + 10_000


def test_loaded_weights_start_reinforcement_learning(policy, path, env):
    other = BetaPolicy(
        env.observation_space,
        env.action_space,
        lambda _: 1e-3,
        channels=(1, 0),
        measurements=(0,),
    )
    other.actor().load_state_dict(load_weights(path).actor().state_dict())
    assert torch.equal(other.action_net.alpha.weight, policy.action_net.alpha.weight.half().float())


def test_weights_that_half_precision_cannot_hold_are_kept_in_single(env, tmp_path):
    large = BetaPolicy(env.observation_space, env.action_space, lambda _: 1e-3)
    with torch.no_grad():
        large.action_net.beta.bias[:] = 123_456.7
    save_weights(large, tmp_path / "large.safetensors", {})
    loaded = load_weights(tmp_path / "large.safetensors")
    assert torch.equal(loaded.action_net.beta.bias, large.action_net.beta.bias)


def test_weights_that_are_not_finite_are_not_written(env, tmp_path):
    broken = BetaPolicy(env.observation_space, env.action_space, lambda _: 1e-3)
    with torch.no_grad():
        broken.action_net.beta.bias[0] = float("inf")
    with pytest.raises(ValueError, match=r"head\.beta\.bias .*not finite"):
        save_weights(broken, tmp_path / "broken.safetensors", {})
    assert list(tmp_path.iterdir()) == []


def test_a_card_that_json_cannot_hold_leaves_the_old_file(policy, path):
    before = path.read_bytes()
    with pytest.raises(TypeError):
        save_weights(policy, path, {"when": object()})
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no file .*none\.safetensors"):
        load_weights(tmp_path / "none.safetensors")


@pytest.mark.parametrize("kept", [0, 5, 300, -1])
def test_a_truncated_file_is_refused(kept, path):
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(WeightsError, match=r"policy\.safetensors is damaged"):
        load_weights(path)


def test_a_file_of_another_kind_is_refused(path):
    path.write_bytes(b"PK\x03\x04" + bytes(1000))
    with pytest.raises(WeightsError, match="damaged or no safetensors file"):
        load_weights(path)


def test_weights_of_something_else_are_refused(path):
    rewritten(path, lambda header: header["__metadata__"].clear())
    with pytest.raises(WeightsError, match="is no bevtown_policy"):
        load_weights(path)


def test_a_newer_file_is_refused_with_the_cure(path):
    rewritten(path, lambda header: own_header(header, version=VERSION + 1))
    with pytest.raises(WeightsError, match=f"version {VERSION + 1}, .* update BEVTown"):
        load_weights(path)
    with pytest.raises(WeightsError, match="update BEVTown"):
        weights_card(path)


@pytest.mark.parametrize(
    "fields",
    [
        {"config": {"channels": [0, 1, 2], "bev_size": 144}},  # other shapes than the tensors
        {"config": {"colour": "red"}},
        {"config": {"channels": "all"}},
        {"config": None},
        {"version": "new"},
        {"deterministic_action": "median"},
    ],
)
def test_a_header_that_does_not_fit_is_refused(fields, path):
    rewritten(path, lambda header: own_header(header, **fields))
    with pytest.raises(WeightsError, match=r"policy\.safetensors"):
        load_weights(path)


def test_a_file_without_one_tensor_is_refused(path):
    def rename(header):
        header["head.gamma.bias"] = header.pop("head.beta.bias")

    rewritten(path, rename)
    with pytest.raises(WeightsError, match="does not hold the policy"):
        load_weights(path)


def test_the_agent_answers_as_the_policy_predicts(policy, env):
    observation, _ = env.reset(seed=3)
    agent = BetaAgent(policy, env)
    assert isinstance(agent, Agent)
    agent.reset(0)
    action = agent.act(observation)
    expected, _ = policy.predict(observation, deterministic=True)  # its mean
    np.testing.assert_allclose(action, expected, atol=1e-6)
    assert action.shape == (2,)
    assert action.dtype == np.float32
    mode = BetaAgent(policy, env, "mode").act(observation)
    assert not np.allclose(mode, action)


def test_sampled_actions_follow_from_the_seed_alone(policy, env):
    observation, _ = env.reset(seed=0)
    agent = BetaAgent(policy, env, "sample")

    def drawn(seed):
        torch.manual_seed(torch.seed())  # other draws in the process do not matter
        agent.reset(seed)
        return np.array([agent.act(observation) for _ in range(4)])

    first = drawn(5)
    np.testing.assert_array_equal(drawn(5), first)
    assert not np.array_equal(drawn(6), first)
    assert len(np.unique(first)) == 8
    assert all(action in env.action_space for action in first)


def test_samples_are_distributed_as_the_policy_says(policy, env):
    observation, _ = env.reset(seed=0)
    agent = BetaAgent(policy, env, "sample")
    agent.reset(0)
    drawn = np.array([agent.act(observation) for _ in range(400)])
    mean = BetaAgent(policy, env, "mean").act(observation)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=4 * drawn.std() / 20)


def test_acting_leaves_the_number_of_threads_as_it_was(policy, env):
    observation, _ = env.reset(seed=0)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        BetaAgent(policy, env).act(observation)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_an_agent_that_cannot_see_in_this_environment_is_refused(policy, path, env):
    with pytest.raises(ValueError, match=r"144 x 144 pixels, the environment's .*\(6, 192, 192\)"):
        load_beta_agent(path, gym.make("BEVTown01-v0"))
    with pytest.raises(ValueError, match="looks at 'bev' and 'measurements'"):
        BetaAgent(policy, bev_driving_env.BEVOnly(env))
    with pytest.raises(ValueError, match="mode, mean, sample, got 'best'"):
        BetaAgent(policy, env, "best")
