"""``bev-agents``: collecting a log and looking at it."""

import json
import subprocess
import sys

import pytest

from agents.cli import main
from bev_driving_env.logs.drive_log import DriveLog

SHORT = ["--town", "Town02", "--time-limit", "3", "--workers", "1"]


def run(capsys, *arguments):
    """Status, output lines and error lines of a command."""
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out.splitlines(), captured.err.splitlines()


def test_a_collected_log_tells_what_was_done(tmp_path, capsys):
    out = tmp_path / "log"
    flags = ["--collections", 2, "--routes", 0, 5, "--traffic", "light", "--lights", "--seed", 4]
    status, lines, _ = run(capsys, "collect", *SHORT, *flags, "--out", out)
    assert status == 0
    assert lines[0].startswith("4 episodes (4 time_limit), 120 samples")
    log = DriveLog(out)
    assert [episode.level for episode in log.episodes] == [0.0, 0.0, 1.0, 1.0]
    header = json.loads((out / "log.json").read_text(encoding="utf-8"))
    assert header["settings"]["traffic"] == {"vehicles": 15, "pedestrians": 50}
    assert header["settings"]["traffic_lights"] is True
    assert header["provenance"]["command"].startswith("bev-agents collect --town Town02")
    assert header["provenance"]["versions"]["pyarrow"]
    status, lines, _ = run(capsys, "info", out)
    text = "\n".join(lines)
    assert status == 0
    assert "Town02, 4 episodes, 120 samples, 0.00 h at 10 Hz" in text
    assert "splits: train 60, val 60" in text
    assert "collection 1: level 1, 2 episodes, 60 samples" in text
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    assert f"{size / 120:.0f} bytes a sample" in text
    assert text.count("100.00 %") + text.count("#") > 20


def test_a_log_made_with_other_flags_is_not_mixed_in(tmp_path, capsys):
    flags = ["--levels", 0, "--routes", 1, "--out", tmp_path / "log"]
    assert run(capsys, "collect", *SHORT, *flags)[0] == 0
    status, _, errors = run(capsys, "collect", *SHORT, *flags, "--seed", 1)
    assert status == 2
    assert "holds a log with seed 0, this one has 1" in errors[-1]
    assert DriveLog(tmp_path / "log").header.seed == 0
    assert run(capsys, "collect", *SHORT, *flags, "--seed", 1, "--overwrite")[0] == 0
    assert DriveLog(tmp_path / "log").header.seed == 1


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--town", "Town09"], "unknown town 'Town09'; registered towns: Town01, Town02"),
        (["--levels", "2"], "--levels must be from 0 to 1, got 2"),
        (["--collections", "0"], "--collections must be at least 1"),
        (["--workers", "0"], "--workers must be at least 1, got 0"),
        (["--seed", "-1"], "--seed must be at least 0, got -1"),
        (["--routes", "12"], "routes 0 to 9, got 12"),
        (["--time-limit", "0"], "time_limit_s must be a positive number"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(tmp_path, capsys, flags, message):
    out = tmp_path / "log"
    status, _, errors = run(capsys, "collect", *SHORT, "--out", out, *flags)
    assert status == 2
    assert len(errors) == 1
    assert message in errors[0]
    assert not out.exists()


def test_an_unknown_flag_is_one_line(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["collect", "--speed", "9"])
    assert stopped.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_looking_at_what_is_no_log_is_one_line(tmp_path, capsys):
    status, _, errors = run(capsys, "info", tmp_path)
    assert status == 2
    assert len(errors) == 1
    assert "is not a drive log" in errors[0]


def test_only_training_loads_pytorch():
    code = "import sys, agents.cli; agents.cli.build_parser(); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
