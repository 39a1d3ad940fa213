"""``bev-agents train``, from a log to weights that drive."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import torch

from agents import make_agent, train_run
from agents.checkpoint import weights_card
from agents.cli import main
from agents.training_report import Report
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


def test_a_finished_training_is_left_alone(trained, log):
    files = [trained / name for name in ("policy.safetensors", "checkpoint.pt", "metrics.csv")]
    before = [(file.read_bytes(), file.stat().st_mtime_ns) for file in files]
    assert main(["train", "--data", str(log), "--out", str(trained), *SHORT]) == 0
    assert [(file.read_bytes(), file.stat().st_mtime_ns) for file in files] == before


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


def test_validation_that_gets_no_better_ends_training_only_after_the_last_round(
    log, tmp_path, monkeypatch
):
    values = iter([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    monkeypatch.setattr(
        train_run.Trainer, "validate", lambda self, _: self.judge(next(values)) or 9
    )
    arguments = ["train", "--data", str(log), "--out", str(tmp_path), "--batch-size", "4"]
    arguments += ["--threads", "1", "--steps", "6", "--dagger", "1", "--patience", "2"]
    assert main([*arguments, "--validate-every", "1"]) == 0
    # the best of the first phase is forgotten: 4.0 is the best of the second, 6.0 the second worse
    assert weights_card(tmp_path / "policy.safetensors")["steps"] == 6
    assert (tmp_path / "dagger" / "round_00").is_dir()


def test_without_a_log_one_line_says_so(tmp_path, capsys):
    missing = tmp_path / "nothing"
    assert main(["train", "--data", str(missing), "--out", str(tmp_path / "out"), *SHORT]) == 2
    error = capsys.readouterr().err
    assert str(missing) in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out" / "policy.safetensors").exists()


def torchrun(*arguments):
    """Start ``torchrun --nproc-per-node 2`` of ``bev-agents train``."""
    command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
    return subprocess.Popen(
        [*command, "--standalone", "-m", "agents.cli", "train", *map(str, arguments)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def finished(process):
    """Status of a process and what it said, once it has ended of itself."""
    try:
        _, errors = process.communicate(timeout=60)
    finally:
        process.terminate()  # which ends the workers too
    return process.returncode, errors


@pytest.mark.slow
def test_torchrun_trains_drives_resumes_and_stops_as_one_process(log, tmp_path):
    arguments = ["--data", log, "--out", tmp_path / "two", *SHORT, "--dagger", "1"]
    # so little patience that processes which disagreed on the best would wait for each other
    arguments += ["--steps", "8", "--batch-size", "4", "--patience", "2"]
    assert finished(torchrun(*arguments))[0] == 0
    checkpoint = torch.load(tmp_path / "two" / "checkpoint.pt", weights_only=True)
    assert checkpoint["step"] > 4
    rows = (tmp_path / "two" / "metrics.csv").read_text(encoding="utf-8")
    assert len(rows.splitlines()) >= 4
    # once more: nothing is left to do
    assert finished(torchrun(*arguments))[0] == 0
    assert (tmp_path / "two" / "metrics.csv").read_text(encoding="utf-8") == rows
    # another training in that folder is refused by all processes, none of which waits for ever
    status, errors = finished(torchrun(*arguments, "--weighting", "none"))
    assert status != 0
    assert "weighting 'kde', this one has 'none'" in errors
    assert "Connection" not in errors


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_torchrun_that_is_interrupted_leaves_a_checkpoint_to_resume_from(log, tmp_path):
    arguments = ["--data", log, "--out", tmp_path, *SHORT, "--steps", "100000"]
    arguments += ["--patience", "100000", "--checkpoint-minutes", "0.001"]
    process = torchrun(*arguments)
    deadline = time.monotonic() + 120.0
    while not (tmp_path / "checkpoint.pt").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGTERM)
    _, errors = finished(process)
    assert "interrupted; policy and checkpoint are kept" in errors
    assert "Connection" not in errors
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["step"] > 0


def test_the_best_of_a_round_survives_an_interruption_after_it(log, tmp_path, monkeypatch):
    """What counts as the best starts anew when a round has been driven, not when one resumes."""
    arguments = ["train", "--data", str(log), *SHORT, "--dagger", "1", "--steps", "8"]
    arguments += ["--validate-every", "1"]
    assert main([*arguments, "--out", str(tmp_path / "whole")]) == 0

    class Interrupting(Report):
        def validated(self, measured, value):
            super().validated(measured, value)
            if self._trainer.step == 7:
                signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patched:
        patched.setattr(train_run, "Report", Interrupting)
        assert main([*arguments, "--out", str(tmp_path / "parts")]) == 130
    assert main([*arguments, "--out", str(tmp_path / "parts")]) == 0
    whole, parts = (
        torch.load(tmp_path / name / "checkpoint.pt", weights_only=True)
        for name in ("whole", "parts")
    )
    assert parts["step"] == 8
    assert parts["best_value"] == whole["best_value"]
    assert all(torch.equal(value, parts["best"][name]) for name, value in whole["best"].items())


def test_tensorboard_gets_every_validation_once(log, tmp_path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    arguments = ["train", "--data", str(log), "--out", str(tmp_path), *SHORT, "--tensorboard"]
    assert main(arguments) == 0
    assert main(arguments) == 0
    events = EventAccumulator(str(tmp_path)).Reload()
    assert {"train_nll", "validation_nll", "learning_rate"} <= set(events.Tags()["scalars"])
    rows = (tmp_path / "metrics.csv").read_text(encoding="utf-8").splitlines()[1:]
    noted = events.Scalars("validation_nll")
    assert [scalar.step for scalar in noted] == [2, 4]
    written = [float(row.split(",")[4]) for row in rows]
    assert [scalar.value for scalar in noted] == pytest.approx(written, rel=1e-4)
    assert main([*arguments, "--overwrite"]) == 0
    assert len([*tmp_path.glob("events.out.tfevents.*")]) == 1


def test_without_tensorboard_one_line_names_the_cure(log, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    out = tmp_path / "out"
    assert main(["train", "--data", str(log), "--out", str(out), *SHORT, "--tensorboard"]) == 2
    assert "pip install tensorboard" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--device", "abacus"], "--device 'abacus' cannot be used"),
        (["--device", "meta"], "--device 'meta' cannot be used"),
        (["--threads", "0"], "--threads must be an int of at least 1, got 0"),
        (["--dagger", "4"], "--dagger 4 needs more --steps than that, got 4"),
        (["--dagger", "-1"], "--dagger must be at least 0"),
        (["--checkpoint-minutes", "0"], "--checkpoint-minutes must be positive"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(flags, message, log, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["train", "--data", str(log), "--out", str(out), *SHORT, *flags]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_weights_of_another_origin_are_not_written_over(overwrite, log, tmp_path, capsys):
    weights = tmp_path / "policy.safetensors"
    weights.write_bytes(b"of somebody")
    assert main(["train", "--data", str(log), "--out", str(tmp_path), *SHORT, *overwrite]) == 2
    assert "holds policy.safetensors but no training.json" in capsys.readouterr().err
    assert weights.read_bytes() == b"of somebody"


@pytest.mark.parametrize("ending", ["steps", "actors"])
def test_a_damaged_log_is_one_error_and_no_policy_is_written(ending, log, tmp_path, capsys):
    spoilt = shutil.copytree(log, tmp_path / "log")
    path = next((spoilt / "episodes").glob(f"*_04.{ending}.parquet"))
    path.write_bytes(path.read_bytes()[:300])
    out = tmp_path / "out"
    assert main(["train", "--data", str(spoilt), "--out", str(out), *SHORT]) == 2
    error = capsys.readouterr().err
    assert f"{path} is truncated" in error
    assert "Traceback" not in error
    assert not (out / "policy.safetensors").exists()
