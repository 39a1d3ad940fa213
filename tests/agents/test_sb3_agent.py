"""Policies that plain Stable-Baselines3 saved drive BEVTown."""

import json
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3 as sb3
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import bev_driving_env
from agents import Agent, BetaPolicy, make_agent
from agents.sb3_agent import SB3Agent


def small():
    """Policy settings, new ones: SAC writes into them."""
    return {"net_arch": [8]}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def env():
    bev = {"size": 64, "px_per_m": 1.5, "ego_row": 50}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=2.0)


def drive(agent, env, steps=5):
    """Actions of some steps, each one in the action space."""
    observation, _ = env.reset(seed=1)
    agent.reset(1)
    actions = []
    for _ in range(steps):
        actions.append(agent.act(observation))
        assert actions[-1] in env.action_space
        observation, *_ = env.step(actions[-1])
    return np.array(actions)


def ppo(policy, env, **keywords):
    settings = {"n_steps": 8, "batch_size": 8, "n_epochs": 1, "seed": 0, "device": "cpu"}
    return sb3.PPO(policy, env, **settings, policy_kwargs=small(), **keywords)


@pytest.mark.parametrize(
    ("policy", "wrapper"),
    [
        ("MultiInputPolicy", lambda env: env),
        ("CnnPolicy", bev_driving_env.BEVOnly),
        ("MlpPolicy", gym.wrappers.FlattenObservation),
    ],
)
def test_ppo_drives_in_the_plain_environment_as_it_predicts(policy, wrapper, env, tmp_path):
    wrapped = wrapper(env)
    model = ppo(policy, wrapped)
    model.learn(8)
    model.save(tmp_path / "model")
    agent = make_agent(f"sb3:{tmp_path / 'model.zip'}", env)
    assert isinstance(agent, Agent)
    actions = drive(agent, env)
    observation, _ = wrapped.reset(seed=1)
    for action in actions:
        np.testing.assert_allclose(
            action, model.predict(observation, deterministic=True)[0], atol=1e-6
        )
        observation, *_ = wrapped.step(action)


def test_an_image_policy_also_drives_where_the_wrapper_is_still_on(env, tmp_path):
    wrapped = bev_driving_env.BEVOnly(env)
    ppo("CnnPolicy", wrapped).save(tmp_path / "model")
    drive(make_agent(f"sb3:{tmp_path / 'model.zip'}", wrapped), wrapped)


@pytest.mark.parametrize("name", ["A2C", "SAC", "TD3", "DDPG"])
def test_every_algorithm_with_continuous_actions_drives(name, env, tmp_path):
    keywords = {} if name == "A2C" else {"buffer_size": 10}
    model = getattr(sb3, name)(
        "MultiInputPolicy", env, device="cpu", seed=0, policy_kwargs=small(), **keywords
    )
    model.save(tmp_path / "model")
    actions = drive(make_agent(f"sb3:{tmp_path / 'model.zip'}", env), env)
    observation, _ = env.reset(seed=1)
    expected = model.predict(observation, deterministic=True)[0]
    np.testing.assert_allclose(actions[0], expected, atol=1e-6)


def test_a_large_replay_buffer_is_not_set_aside_again(env, tmp_path):
    model = sb3.SAC("MultiInputPolicy", env, device="cpu", buffer_size=10, policy_kwargs=small())
    model.buffer_size = 10**12  # more than any machine has
    model.save(tmp_path / "model")
    drive(make_agent(f"sb3:{tmp_path / 'model.zip'}", env), env, steps=1)


def test_state_dependent_exploration_is_no_obstacle(env, tmp_path):
    ppo("MultiInputPolicy", env, use_sde=True).save(tmp_path / "model")
    drive(make_agent(f"sb3:{tmp_path / 'model.zip'}", env), env)


def test_schedules_that_cannot_be_read_any_more_are_not_read(env, tmp_path):
    ppo("MultiInputPolicy", env, learning_rate=lambda left: 1e-3 * left).save(tmp_path / "model")
    path = tmp_path / "model.zip"
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(parts["data"])
    data["learning_rate"][":serialized:"] = "bm90IGEgcGlja2xl"
    parts["data"] = json.dumps(data)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    drive(make_agent(f"sb3:{path}", env), env, steps=1)


def test_the_beta_policy_drives_from_a_zip(tmp_path):
    bev = {"size": 144, "px_per_m": 3.75, "ego_row": 114}
    env = gym.make("BEVTown01-v0", bev=bev, time_limit_s=2.0)
    model = sb3.PPO(BetaPolicy, env, n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "model")
    drive(make_agent(f"sb3:{tmp_path / 'model.zip'}", env), env, steps=2)


class Remembering(ActorCriticPolicy):
    """Steers by the number of steps since the episode began, as a recurrent policy would."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        count = 0 if state is None or episode_start[0] else int(state[0])
        return np.array([0.0, 0.1 * count], np.float32), (np.array(count + 1),)


def test_a_recurrent_policy_gets_its_state_and_loses_it_between_episodes(env):
    policy = Remembering(env.observation_space["measurements"], env.action_space, lambda _: 0.0)
    agent = SB3Agent(policy, env)
    for _ in range(2):
        np.testing.assert_allclose(drive(agent, env, 4)[:, 1], [0.0, 0.1, 0.2, 0.3], atol=1e-6)


def test_random_actions_follow_from_the_seed(env):
    model = ppo("MultiInputPolicy", env)
    agent = SB3Agent(model.policy, env, deterministic=False)
    first = drive(agent, env)
    np.testing.assert_array_equal(drive(agent, env), first)
    assert not np.allclose(first, drive(SB3Agent(model.policy, env), env))


def test_files_that_hold_no_such_policy_are_refused(env, tmp_path):
    with pytest.raises(ValueError, match="there is no file"):
        make_agent(f"sb3:{tmp_path / 'none.zip'}", env)
    path = tmp_path / "broken.zip"
    path.write_bytes(b"no zip")
    with pytest.raises(ValueError, match="no zip that Stable-Baselines3 saved"):
        make_agent(f"sb3:{path}", env)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("holiday.txt", "pictures")
    with pytest.raises(ValueError, match="no zip that Stable-Baselines3 saved"):
        make_agent(f"sb3:{path}", env)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps({"gamma": 0.99}))
    with pytest.raises(ValueError, match="holds no policy"):
        make_agent(f"sb3:{path}", env)


def test_a_policy_for_other_views_or_actions_is_refused(env, tmp_path):
    ppo("MultiInputPolicy", env).save(tmp_path / "small")
    with pytest.raises(ValueError, match=r"trained on .*\(6, 64, 64\).* gives .*\(6, 192, 192\)"):
        make_agent(f"sb3:{tmp_path / 'small.zip'}", gym.make("BEVTown01-v0"))
    sb3.PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8, device="cpu").save(
        tmp_path / "pendulum"
    )
    with pytest.raises(ValueError, match="the policy acts in"):
        make_agent(f"sb3:{tmp_path / 'pendulum.zip'}", env)


def test_actions_of_another_range_or_kind_are_refused(env, tmp_path):
    """Half throttle of one that was trained on [0, 1] is not half throttle here."""
    rescaled = gym.wrappers.RescaleAction(env, 0.0, 1.0)
    ppo("MultiInputPolicy", rescaled).save(tmp_path / "rescaled")
    actions = gym.spaces.Discrete(3)
    discrete = gym.wrappers.TransformAction(env, lambda number: np.zeros(2), actions)
    sb3.DQN("MultiInputPolicy", discrete, buffer_size=10, device="cpu", policy_kwargs=small()).save(
        tmp_path / "discrete"
    )
    for name, space in (("rescaled", r"Box\(0\.0, 1\.0"), ("discrete", r"Discrete\(3\)")):
        with pytest.raises(ValueError, match=rf"acts in {space}.*module:factory"):
            make_agent(f"sb3:{tmp_path / name}.zip", env)


def test_a_policy_whose_view_was_normalised_by_its_own_statistics_is_refused(env, tmp_path):
    # it writes into the space of its environment, so that needs to be another one
    bev = {"size": 64, "px_per_m": 1.5, "ego_row": 50}
    vector = DummyVecEnv([lambda: gym.make("BEVTown01-v0", bev=bev)])
    ppo("MultiInputPolicy", VecNormalize(vector, norm_obs_keys=["bev"])).save(tmp_path / "model")
    with pytest.raises(ValueError, match=r"bev from -10 to 10, as VecNormalize .*module:factory"):
        make_agent(f"sb3:{tmp_path / 'model.zip'}", env)
