"""``bev-agents train``, from a log to weights that drive."""

from __future__ import annotations

import json

import pytest

from agents import make_agent
from agents.checkpoint import weights_card
from agents.cli import main
from bev_driving_env.env import BEVTownEnv

SHORT = ["--steps", "4", "--batch-size", "4", "--validate-every", "2", "--threads", "1"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a few seconds: route 0 validates, route 4 trains."""
    folder = tmp_path_factory.mktemp("log")
    arguments = ["--levels", "1", "--routes", "0", "4", "--time-limit", "3", "--workers", "1"]
    assert main(["collect", "--town", "Town02", *arguments, "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def trained(log, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "bc"
    assert main(["train", "--data", str(log), "--out", str(out), *SHORT]) == 0
    return out


def test_it_writes_weights_with_a_card_metrics_and_a_checkpoint(trained, log):
    card = weights_card(trained / "policy.safetensors")
    assert card["steps"] == 4
    assert card["data"] == [str(log)]
    assert card["command"].startswith("bev-agents train --data")
    rows = (trained / "metrics.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("step,samples,minutes,train_nll,validation_nll")
    assert [row.split(",")[0] for row in rows[1:]] == ["2", "4"]
    assert (trained / "checkpoint.pt").exists()


def test_the_weights_drive(trained):
    env = BEVTownEnv("Town02")
    observation, _ = env.reset(seed=0)
    agent = make_agent(str(trained / "policy.safetensors"), env)
    agent.reset(0)
    assert agent.act(observation) in env.action_space


def test_the_same_command_again_adds_nothing(trained, log):
    before = (trained / "metrics.csv").read_bytes()
    assert main(["train", "--data", str(log), "--out", str(trained), *SHORT]) == 0
    assert (trained / "metrics.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (["--weighting", "none"], "weighting 'kde', this one has 'none'"),
        (["--dagger", "1"], "dagger 0, this one has 1"),
        (["--channels", "road"], "channels"),
        (["--seed", "5"], "seed"),
    ],
)
def test_another_training_is_not_mixed_in(changed, named, trained, log, capsys):
    kept = (trained / "policy.safetensors").read_bytes()
    assert main(["train", "--data", str(log), "--out", str(trained), *SHORT, *changed]) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
    assert (trained / "policy.safetensors").read_bytes() == kept


def test_overwriting_starts_anew_and_leaves_other_files_alone(log, tmp_path):
    (tmp_path / "mine.txt").write_text("keep", encoding="utf-8")
    arguments = ["train", "--data", str(log), "--out", str(tmp_path), *SHORT]
    assert main(arguments) == 0
    assert main([*arguments, "--weighting", "none", "--overwrite"]) == 0
    assert weights_card(tmp_path / "policy.safetensors")["weighting"] == "none"
    recipe = json.loads((tmp_path / "training.json").read_text(encoding="utf-8"))
    assert recipe["weighting"] == "none"
    assert (tmp_path / "mine.txt").read_text(encoding="utf-8") == "keep"


def test_a_checkpoint_right_after_a_dagger_round_says_that_nothing_was_validated(log, tmp_path):
    arguments = ["train", "--data", str(log), "--out", str(tmp_path), *SHORT]
    # every step is kept, also the third, the first since the round: only even ones are validated
    assert main([*arguments, "--dagger", "1", "--checkpoint-minutes", "1e-9"]) == 0
    card = weights_card(tmp_path / "policy.safetensors")
    assert (card["dagger_rounds"], card["steps"]) == (1, 4)


def test_without_a_log_one_line_says_so(tmp_path, capsys):
    missing = tmp_path / "nothing"
    assert main(["train", "--data", str(missing), "--out", str(tmp_path / "out"), *SHORT]) == 2
    error = capsys.readouterr().err
    assert str(missing) in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out" / "policy.safetensors").exists()
