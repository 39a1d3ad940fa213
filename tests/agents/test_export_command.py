"""``bev-agents export``."""

import sys

import pytest

from agents.cli import main

from .finished_drives import GIVEN_UP_AFTER, record_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    record_log(folder)
    return folder


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path / "datasets"


def run(capsys, *arguments):
    status = main(["export", *map(str, arguments)])
    captured = capsys.readouterr()
    return status, captured.out.splitlines(), captured.err.splitlines()


def test_the_command_says_what_it_wrote(folder, root, capsys):
    minari = pytest.importorskip("minari")
    name = "bevtown/town02-v0"
    status, lines, _ = run(capsys, folder, "--minari", name, "--limit", 1, "--format", "parquet")
    assert status == 0
    assert lines[0] == f"1 drives, {GIVEN_UP_AFTER} steps in {root / name}"
    assert lines[1] == "read them with: minari.load_dataset('bevtown/town02-v0')"
    metadata = minari.load_dataset(name).storage.metadata
    assert metadata["bevtown"]["export"]["command"].startswith("bev-agents export ")
    status, _, errors = run(capsys, folder, "--minari", name)
    assert status == 2
    assert len(errors) == 1
    assert "add --overwrite" in errors[0]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--minari", "town02"], "is no id of a Minari dataset"),
        (["--minari", "town02-v0", "--levels", "0.7"], "no level 0.7; its levels are: 0, 1"),
        (["--minari", "town02-v0", "--limit", "0"], "at least 1 episode, got 0"),
        (["--minari", "town02-v0", "--max-steps", "0"], "at 1 step or more, got 0"),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_written(flags, message, folder, root, capsys):
    pytest.importorskip("minari")
    status, _, errors = run(capsys, folder, *flags)
    assert status == 2
    assert len(errors) == 1
    assert message in errors[0]
    assert not root.exists() or not any(root.iterdir())


def test_what_is_no_log_is_one_line(root, tmp_path, capsys):
    status, _, errors = run(capsys, tmp_path / "nowhere", "--minari", "town02-v0")
    assert status == 2
    assert len(errors) == 1
    assert "is not a drive log" in errors[0]


def test_without_minari_the_extra_is_named(folder, root, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    status, _, errors = run(capsys, folder, "--minari", "town02-v0")
    assert status == 2
    assert len(errors) == 1
    assert "pip install 'bev-driving-env[minari]'" in errors[0]
