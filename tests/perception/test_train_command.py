"""``bev-perception train``, from a log to a predictor that sees."""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import torch

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import CHANNELS
from perception import train_run
from perception.cli import main
from perception.models.presets import PRESETS
from perception.training_report import Report
from perception.weights import load_predictor, predictor_card

SHORT = ["--steps", "4", "--batch-size", "2", "--validate-every", "2", "--threads", "1"]
SHORT += ["--validation-samples", "5", "--precision", "fp32", "--workers", "0"]


@pytest.fixture(scope="module", autouse=True)
def _tiny_preset(tiny_spec):
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(PRESETS, "tiny", tiny_spec)
        yield


def train(log, out, *flags):
    arguments = ["--preset", "tiny", "--data", str(log), "--out", str(out), *SHORT]
    return main(["train", *arguments, *flags])


def rows_of(folder):
    with (folder / "metrics.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def trained(log_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "tiny"
    assert train(log_folder, out, "--weighting", "kde") == 0
    return out


def test_metrics_have_a_row_for_each_validation(trained):
    rows = rows_of(trained)
    assert [(row["step"], row["samples"]) for row in rows] == [("2", "4"), ("4", "8")]
    wanted = {"minutes", "train_loss", "validation_loss", "learning_rate", "gradient_norm"}
    wanted |= {f"{kind}_{name}" for kind in ("loss", "iou", "threshold") for name in CHANNELS}
    assert wanted | {"waiting_share"} <= set(rows[0])
    losses = [float(rows[0][f"loss_{name}"]) for name in CHANNELS]
    assert float(rows[0]["validation_loss"]) == pytest.approx(np.mean(losses), rel=1e-4)


def test_the_predictor_has_the_best_weights_and_their_thresholds(trained):
    best = min(rows_of(trained), key=lambda row: float(row["validation_loss"]))
    predictor = load_predictor(trained / "predictor.safetensors")
    wanted = [float(best[f"threshold_{name}"]) for name in CHANNELS]
    assert predictor.thresholds == pytest.approx(wanted)
    kept = torch.load(trained / "checkpoint.pt", weights_only=True)
    for name, value in predictor.model.state_dict().items():
        assert torch.equal(value, kept["best"][name].half().float()), name


def test_the_card_says_where_it_came_from(trained, log_folder):
    card = predictor_card(trained / "predictor.safetensors")
    assert card["command"].startswith("bev-perception train --preset tiny --data")
    assert card["data"] == [str(log_folder)]
    assert (card["preset"], card["steps"], card["batch_size"]) == ("tiny", 4, 2)
    assert card["samples"] == card["distinct_frames"] == 8
    assert (card["weighting"], card["seeds"]) == ("kde", [0])
    assert 1.0 <= card["effective_sample_size"]["road"] <= 30.0
    assert {"machine", "git_commit", "hours", "date_utc"} <= set(card)
    measured = card["validation"]
    assert set(measured["iou"]) == set(measured["iou_at_0.5"]) == set(CHANNELS)
    assert measured["iou"]["road"] >= measured["iou_at_0.5"]["road"] >= 0.0


def test_an_env_drives_on_what_was_trained(trained):
    with BEVTownEnv("Town02", bev_source=str(trained / "predictor.safetensors")) as env:
        assert env.reset(seed=0)[0]["bev"].shape == (6, 192, 192)


def test_a_training_can_start_from_a_predictor_and_its_card_says_so(
    trained, log_folder, tmp_path, capsys
):
    old = str(trained / "predictor.safetensors")
    flags = ["--start", old, "--learning-rate", "1e-9"]
    assert train(log_folder, tmp_path, *flags) == 0
    card = predictor_card(tmp_path / "predictor.safetensors")
    assert card["started_from"]["samples"] == 8
    assert card["started_from"]["weighting"] == "kde"
    before, after = (
        load_predictor(folder / "predictor.safetensors").model.state_dict()
        for folder in (trained, tmp_path)
    )
    for name, value in before.items():
        torch.testing.assert_close(after[name], value, rtol=1e-3, atol=1e-5)
    assert train(log_folder, tmp_path, "--learning-rate", "1e-9") == 2
    assert "start" in capsys.readouterr().err
    assert train(log_folder, tmp_path / "other", "--start", old, "--preset", "blind") == 2
    assert "start from a predictor of the same preset" in capsys.readouterr().err


def test_no_more_distinct_frames_are_counted_than_there_are(log_folder, tmp_path):
    assert train(log_folder, tmp_path, "--batch-size", "16") == 0
    card = predictor_card(tmp_path / "predictor.safetensors")
    assert (card["samples"], card["distinct_frames"]) == (64, 30)


def test_the_same_command_again_adds_nothing(trained, log_folder, capsys):
    before = (trained / "metrics.csv").read_bytes()
    assert train(log_folder, trained, "--weighting", "kde") == 0
    assert (trained / "metrics.csv").read_bytes() == before
    assert "after 4 steps" in capsys.readouterr().out


def test_it_tells_pace_waiting_and_effective_sample_size(log_folder, tmp_path, capsys):
    assert train(log_folder, tmp_path, "--weighting", "kde+actors") == 0
    out = capsys.readouterr().out
    assert "weighting kde+actors: effective sample size road " in out
    assert "of 30 samples" in out
    assert "frames/s in fp32" in out
    assert "of the time spent waiting for samples" in out


def test_fewer_channels_can_be_learned(log_folder, tmp_path):
    assert train(log_folder, tmp_path, "--channels", "lane", "road") == 0
    predictor = load_predictor(tmp_path / "predictor.safetensors")
    assert predictor.channels == ("lane", "road")
    assert "iou_vehicles" not in rows_of(tmp_path)[0]


def test_fields_of_the_network_can_be_changed(log_folder, tmp_path, capsys):
    assert train(log_folder, tmp_path, "--set", "widths=[4, 8]", "places=false") == 0
    config = load_predictor(tmp_path / "predictor.safetensors").spec.config
    assert (config.widths, config.places) == ((4, 8), False)
    for wrong, named in (
        ("depth=3", "no field 'depth'; it has channels"),
        ("widths=4", "cannot be a network's"),
        ("widths=[4, 0]", "widths must be positive"),
        ("widths", "expected NAME=VALUE"),
    ):
        try:
            code = train(log_folder, tmp_path / "other", "--set", wrong)
        except SystemExit as stop:  # of argparse
            code = stop.code
        assert code == 2
        assert named in capsys.readouterr().err


def interrupted_after(step, monkeypatch):
    """Ctrl-C while this step is reported."""

    class Interrupting(Report):
        def advance(self, loss):
            super().advance(loss)
            if self._trainer.step == step:
                signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(train_run, "Report", Interrupting)


def test_an_interrupted_training_goes_on_to_the_same_bits(
    trained, log_folder, tmp_path, monkeypatch, capsys
):
    with monkeypatch.context() as patched:
        interrupted_after(3, patched)
        assert train(log_folder, tmp_path, "--weighting", "kde") == 130
    assert "predictor and checkpoint are kept" in capsys.readouterr().err
    assert_that_the_rest_leads_to_the_same(trained, log_folder, tmp_path)


def test_a_training_can_stop_on_the_way(trained, log_folder, tmp_path, capsys):
    assert train(log_folder, tmp_path, "--weighting", "kde", "--until", "3") == 0
    assert_that_the_rest_leads_to_the_same(trained, log_folder, tmp_path)
    assert train(log_folder, tmp_path, "--weighting", "kde", "--until", "5") == 2
    assert "--until must be from 1 to --steps 4, got 5" in capsys.readouterr().err


def assert_that_the_rest_leads_to_the_same(trained, log_folder, tmp_path):
    half = predictor_card(tmp_path / "predictor.safetensors")
    assert (half["steps"], half["best_step"]) == (3, 2)
    assert train(log_folder, tmp_path, "--weighting", "kde") == 0
    whole, parts = (
        torch.load(folder / "checkpoint.pt", weights_only=True) for folder in (trained, tmp_path)
    )
    assert parts["step"] == 4
    for kind in ("weights", "best"):
        assert all(torch.equal(value, parts[kind][name]) for name, value in whole[kind].items())
    same = [name for name in whole["rows"][0] if name not in ("minutes", "waiting_share")]
    for row, other in zip(whole["rows"], parts["rows"], strict=True):
        assert [f"{row[name]}" for name in same if name != "train_loss"] == [
            f"{other[name]}" for name in same if name != "train_loss"
        ]


def test_a_finished_training_is_left_alone(trained, log_folder):
    files = [trained / name for name in ("predictor.safetensors", "checkpoint.pt", "metrics.csv")]
    before = [file.read_bytes() for file in files]
    assert train(log_folder, trained, "--weighting", "kde") == 0
    assert [file.read_bytes() for file in files] == before


def test_before_the_first_validation_the_last_weights_are_kept(log_folder, tmp_path, monkeypatch):
    interrupted_after(1, monkeypatch)
    assert train(log_folder, tmp_path) == 130
    predictor = load_predictor(tmp_path / "predictor.safetensors")
    assert predictor.thresholds == (0.5,) * 6
    assert predictor.card["validation"] is None
    assert (tmp_path / "metrics.csv").read_text(encoding="utf-8") == ""


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ([], "weighting 'kde', this one has 'none'"),
        (["--weighting", "kde", "--preset", "blind"], "preset 'tiny', this one has 'blind'"),
        (["--weighting", "kde", "--channels", "road"], "channels"),
        (["--weighting", "kde", "--temper", "0.5"], "temper 1.0, this one has 0.5"),
        (["--weighting", "kde", "--no-flips"], "flips True, this one has False"),
    ],
)
def test_another_training_is_not_mixed_in(changed, named, trained, log_folder, capsys):
    kept = (trained / "predictor.safetensors").read_bytes()
    assert train(log_folder, trained, *changed) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
    assert (trained / "predictor.safetensors").read_bytes() == kept


def test_overwriting_starts_anew_and_leaves_other_files_alone(log_folder, tmp_path):
    (tmp_path / "mine.txt").write_text("keep", encoding="utf-8")
    assert train(log_folder, tmp_path) == 0
    assert train(log_folder, tmp_path, "--weighting", "kde", "--overwrite") == 0
    assert predictor_card(tmp_path / "predictor.safetensors")["weighting"] == "kde"
    assert (tmp_path / "mine.txt").exists()


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_weights_of_another_origin_are_not_written_over(overwrite, log_folder, tmp_path, capsys):
    weights = tmp_path / "predictor.safetensors"
    weights.write_bytes(b"of somebody")
    assert train(log_folder, tmp_path, *overwrite) == 2
    assert "holds predictor.safetensors but no training.json" in capsys.readouterr().err
    assert weights.read_bytes() == b"of somebody"


def test_a_foreign_checkpoint_is_refused(trained, log_folder, tmp_path, capsys):
    shutil.copy(trained / "training.json", tmp_path)
    torch.save({"epoch": 3}, tmp_path / "checkpoint.pt")
    assert train(log_folder, tmp_path, "--weighting", "kde") == 2
    assert "is not a checkpoint of BEVTown's training" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--preset", "huge"], "unknown preset 'huge'; presets are: fast, paper"),
        (["--device", "abacus"], "--device 'abacus' cannot be used"),
        (["--threads", "0"], "--threads must be an int of at least 1, got 0"),
        (["--workers", "-1"], "--workers must be at least 0, got -1"),
        (["--checkpoint-minutes", "0"], "--checkpoint-minutes must be positive"),
        (["--temper", "2"], "temper must be from 0 to 1, got 2.0"),
        (["--data", "nowhere"], "nowhere"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(flags, message, log_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert train(log_folder, out, *flags) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("workers", ["0", "1"])
def test_a_damaged_log_is_one_line_wherever_it_is_read(workers, log_folder, tmp_path, capsys):
    spoilt = shutil.copytree(log_folder, tmp_path / "log")
    path = next((spoilt / "episodes").glob("*_03.actors.parquet"))
    path.write_bytes(path.read_bytes()[:300])
    out = tmp_path / "out"
    assert train(spoilt, out, "--workers", workers) == 2
    error = capsys.readouterr().err
    told = [line for line in error.splitlines() if line.startswith("bev-perception train: ")]
    assert len(told) == 1
    assert f"{path} is truncated" in told[0]
    assert "Traceback" not in error
    assert not (out / "predictor.safetensors").exists()


def test_tensorboard_gets_every_validation(log_folder, tmp_path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    assert train(log_folder, tmp_path, "--tensorboard") == 0
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [scalar.step for scalar in events.Scalars("validation_loss")] == [2, 4]
    assert "iou_road" in events.Tags()["scalars"]


def test_without_tensorboard_one_line_names_the_cure(log_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    assert train(log_folder, tmp_path / "out", "--tensorboard") == 2
    assert "pip install tensorboard" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_help_needs_no_pytorch():
    code = "import sys; from perception.cli import build_parser; build_parser().format_help(); "
    code += "sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_torchrun_trains_as_one_process_and_nobody_waits_for_ever(log_folder, tmp_path):
    command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
    command += ["--standalone", "-m", "perception.cli", "train", "--preset", "blind"]
    command += ["--data", str(log_folder), "--out", str(tmp_path), *SHORT, "--weighting", "kde"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}

    def run(*flags):
        return subprocess.run(
            [*command, *flags],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    done = run()
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("frames/s") == 1
    assert [row["step"] for row in rows_of(tmp_path)] == ["2", "4"]
    assert predictor_card(tmp_path / "predictor.safetensors")["samples"] == 8
    refused = run("--weighting", "none")
    assert refused.returncode != 0
    assert "weighting 'kde', this one has 'none'" in refused.stderr
