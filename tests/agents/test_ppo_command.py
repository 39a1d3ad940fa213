"""``bev-agents ppo``, a few steps of it."""

from __future__ import annotations

import pytest
import torch
from stable_baselines3 import PPO

from agents import make_agent
from agents.checkpoint import load_weights, weights_card
from agents.cli import main
from agents.learning_curve import read_curve
from agents.ppo_run import Falling
from agents.registry import agent_source
from bev_driving_env.env import BEVTownEnv

SHORT = [
    "--town",
    "Town02",
    "--worlds",
    "2",
    "--horizon",
    "8",
    "--batch-size",
    "8",
    "--epochs",
    "1",
]
SHORT += ["--validate-every", "16", "--validation-routes", "1", "--threads", "1"]


def run(out, *arguments):
    return main(["ppo", "--out", str(out), *SHORT, *arguments])


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    out = tmp_path_factory.mktemp("ppo") / "scratch"
    assert run(out, "--steps", "16") == 0
    return out


def test_it_writes_weights_that_drive_a_model_that_loads_and_a_curve(scratch):
    card = weights_card(scratch / "policy.safetensors")
    assert card["command"].startswith("bev-agents ppo --out")
    assert (scratch / "curve.png").stat().st_size > 10_000
    assert [row["steps"] for row in read_curve(scratch / "curve.csv")] == [0.0, 16.0]
    env = BEVTownEnv("Town02")
    seen, _ = env.reset(seed=0)
    for spec in (str(scratch / "policy.safetensors"), f"sb3:{scratch / 'model.zip'}"):
        agent = make_agent(spec, env)
        agent.reset(0)
        assert agent.act(seen) in env.action_space


def test_the_same_command_with_more_steps_goes_on(scratch):
    before = PPO.load(scratch / "model.zip").policy.state_dict()
    assert run(scratch, "--steps", "32") == 0
    rows = read_curve(scratch / "curve.csv")
    assert [row["steps"] for row in rows] == [0.0, 16.0, 32.0]
    assert rows[2]["minutes"] > rows[1]["minutes"]
    model = PPO.load(scratch / "model.zip")
    assert model.num_timesteps == 32
    after = model.policy.state_dict()
    assert any((after[name] != before[name]).any() for name in after)


def test_a_run_that_is_done_is_left_alone(scratch):
    before = (scratch / "model.zip").read_bytes()
    assert run(scratch, "--steps", "16") == 0
    assert (scratch / "model.zip").read_bytes() == before


def test_another_recipe_is_refused(scratch, capsys):
    assert run(scratch, "--steps", "64", "--gamma", "0.5") == 2
    assert "holds a training with gamma 0.97, this one has 0.5" in capsys.readouterr().err


def test_fine_tuning_starts_from_the_weights_and_lets_the_critic_learn_first(tmp_path):
    assert run(tmp_path, "--from", "bc", "--steps", "16", "--critic-steps", "16") == 0
    model = PPO.load(tmp_path / "model.zip")
    cloned = load_weights(agent_source("bc"))
    assert model.policy.config == cloned.config
    learned = model.policy.actor().state_dict()
    for name, value in cloned.actor().state_dict().items():
        torch.testing.assert_close(learned[name], value, rtol=0, atol=0)
    assert weights_card(tmp_path / "policy.safetensors")["from"] == "bc"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--from", "expert"], "--from 'expert' must be 'bc' or the .safetensors file"),
        (["--from", "nothing.safetensors"], "there is no file nothing.safetensors"),
        (["--town", "Atlantis"], "Atlantis"),
        (["--batch-size", "7"], "batch_size 7 must divide"),
    ],
)
def test_mistakes_are_one_clear_line(tmp_path, capsys, arguments, message):
    assert run(tmp_path / "out", "--steps", "16", *arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert message in error
    assert not (tmp_path / "out").exists()


def test_the_learning_rate_falls_to_a_tenth():
    rate = Falling(2.0)
    assert (rate(1.0), rate(0.0)) == (2.0, 0.2)
