from __future__ import annotations

import contextlib
import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.cli import main
from benchmarks.run_command import RunOptions
from benchmarks.suites import SUITES


def test_the_paper_suite_writes_table_rows_and_maps(tmp_path, capsys):
    arguments = ["run", "--suite", "paper", "--out", str(tmp_path), "--workers", "1"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[0] in (tmp_path / "table.md").read_text(encoding="utf-8")
    content = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert len(content["episodes"]) == 10
    towns = {entry["town"]: entry for entry in content["scores"]}
    assert towns["Town01"]["planned_m"] == pytest.approx(598.0, rel=0.02)
    assert towns["Town02"]["planned_m"] == pytest.approx(604.0, rel=0.02)
    assert all(entry["infracted"] == 0 and entry["clean"] == 5 for entry in towns.values())
    looks = {row["town"]: row["appearance"] for row in content["episodes"]}
    assert looks == {"Town01": "train", "Town02": "test"}
    assert content["provenance"]["command"].startswith("bev-bench run --suite paper")
    text = (tmp_path / "episodes.csv").read_text(encoding="utf-8")
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    assert len(rows) == 11
    for town in ("Town01", "Town02"):
        with Image.open(tmp_path / f"map_{town}.png") as image:
            assert json.loads(image.text["provenance"])["seeds"] == [0]
            assert min(image.size) > 400


@pytest.fixture
def short_suite_town(monkeypatch):
    """Suite ``town`` on the short episodes and without signals."""
    suite = SUITES["town"]
    conditions = replace(suite.conditions, traffic_lights=False)
    monkeypatch.setitem(SUITES, "town", replace(suite, routes="episode", conditions=conditions))


@pytest.mark.usefixtures("short_suite_town")
def test_suite_town_prints_the_leaderboards_table_and_keeps_what_ended_nothing(
    tmp_path, monkeypatch, capsys
):
    (tmp_path / "toy_straight_driver.py").write_text(
        "import numpy as np\n"
        "class Driver:\n"
        "    def __init__(self, env): pass\n"
        "    def reset(self, seed): pass\n"
        "    def act(self, observation): return np.array([0.3, 0.0], np.float32)\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "out"
    arguments = ["run", "--suite", "town", "--traffic", "none", "--town", "Town02"]
    arguments += ["--agent", "expert", "toy_straight_driver:Driver", "--workers", "1"]
    assert main([*arguments, "--out", str(out)]) == 0
    header, _, expert, straight, *_ = capsys.readouterr().out.splitlines()
    written = (out / "table.md").read_text(encoding="utf-8")
    assert written.startswith("\n".join((header, "")))
    assert "Suite `town`, traffic `none`." in written
    assert "DS 2.1" in header
    cells = [cell.strip() for cell in expert.split("|")[1:-1]]
    assert cells[:7] == ["ground_truth", "expert", "Town02", "100.0", "100.0", "100.0", "1.000"]
    assert set(cells[7:]) == {"0"}
    cells = [cell.strip() for cell in straight.split("|")[1:-1]]
    assert 0.0 < float(cells[3]) < 100.0
    content = json.loads((out / "results.json").read_text(encoding="utf-8"))
    rows = [row for row in content["episodes"] if row["agent"] != "expert"]
    assert all(row["traffic"] == "none" for row in rows)
    # some episodes went on after their first infraction
    assert any(event["time_s"] < row["time_s"] - 1.0 for row in rows for event in row["events"])
    identity = json.loads((out / "run.json").read_text(encoding="utf-8"))["identity"]
    assert identity["traffic"] == "none"


def options_of(traffic: str | None) -> RunOptions:
    return RunOptions(
        suite="town",
        bev=("ground_truth",),
        agent=("expert",),
        town=("Town01",),
        seed=(0,),
        out=Path("runs"),
        workers=1,
        overwrite=False,
        video=False,
        traffic=traffic,
    )


def test_a_run_is_the_same_by_its_traffic_whether_asked_for_or_the_suites_own():
    assert options_of(None).identity == options_of("light").identity
    assert options_of(None).identity["traffic"] == "light"
    assert options_of("dense").identity != options_of("light").identity


def test_the_same_command_again_drives_nothing_and_another_one_is_refused(tmp_path, capsys):
    arguments = ["run", "--town", "Town02", "--out", str(tmp_path), "--workers", "1"]
    assert main(arguments) == 0
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "episodes").iterdir()}
    first = capsys.readouterr().out
    assert main(arguments) == 0
    assert capsys.readouterr().out == first
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "episodes").iterdir()} == kept
    assert main([*arguments, "--seed", "1"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*arguments, "--seed", "1", "--overwrite"]) == 0


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["run", "--suite", "nowhere", "--out", "x"], ["nowhere", "paper"]),
        (["run", "--suite", "town", "--traffic", "heavy", "--out", "x"], ["heavy", "dense"]),
        (["run", "--traffic", "light", "--out", "x"], ["--traffic light", "paper", "town"]),
        (["run", "--traffic", "none", "--out", "x"], ["--traffic none", "paper", "town"]),
        (["run", "--bev", "xray", "--out", "x"], ["xray", "ground_truth"]),
        (["run", "--agent", "chauffeur", "--out", "x"], ["chauffeur", "expert"]),
        (["run", "--agent", "no_such_module:f", "--out", "x"], ["no_such_module"]),
        (["run", "--town", "Town99", "--out", "x"], ["Town99", "Town01"]),
        (["run", "--seed", "-1", "--out", "x"], ["-1"]),
        (["run", "--seed", "one", "--out", "x"], ["one"]),
        (["run", "--workers", "0", "--out", "x"], ["0"]),
        (["run"], ["--out"]),
        (["speed", "--rounds", "0"], ["--rounds"]),
        (["fly"], ["fly", "run", "speed"]),
        ([], ["COMMAND"]),
    ],
)
def test_a_mistake_exits_with_2_and_one_line_that_names_it(
    arguments, names, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code
    assert status == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert all(name in lines[0] for name in names)
    assert not list(tmp_path.iterdir())


def test_a_failing_agent_is_reported_and_exits_with_1(tmp_path, monkeypatch, capsys):
    (tmp_path / "toy_failing_driver.py").write_text(
        "class Driver:\n"
        "    def __init__(self, env): pass\n"
        "    def reset(self, seed): pass\n"
        "    def act(self, observation): raise RuntimeError('lost the keys')\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "out"
    arguments = ["run", "--agent", "toy_failing_driver:Driver", "--town", "Town02"]
    assert main([*arguments, "--out", str(out), "--workers", "1"]) == 1
    printed = capsys.readouterr()
    assert "0/5" in printed.out
    assert "lost the keys" in printed.err
    content = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert all("lost the keys" in row["error"] for row in content["episodes"])
    assert content["scores"][0]["clean"] == 0


def test_a_run_is_not_resumed_with_an_agent_whose_file_has_changed(tmp_path, monkeypatch, capsys):
    driver = tmp_path / "toy_changing_driver.py"
    driver.write_text("from agents import Expert as Driver\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ["run", "--agent", "toy_changing_driver:Driver", "--town", "Town02"]
    arguments += ["--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(arguments) == 0
    assert main(arguments) == 0
    driver.write_text("from agents import Expert as Driver  # changed\n", encoding="utf-8")
    assert main(arguments) == 2
    assert "hashes" in capsys.readouterr().err
    content = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert len(content["provenance"]["hashes"]["toy_changing_driver:Driver"]) == 64


def test_an_agent_that_cannot_be_made_is_a_mistake_in_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "toy_broken_driver.py").write_text("def make(env): 1 / 0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["run", "--agent", "toy_broken_driver:make", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "toy_broken_driver:make" in line
    assert "ZeroDivisionError" in line
    assert not (tmp_path / "out").exists()


def test_an_error_of_ours_is_not_passed_off_as_a_mistake_of_the_user(tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise ValueError("a bug in drawing")

    monkeypatch.setattr("benchmarks.run_command.draw_trajectories", fail)
    with pytest.raises(ValueError, match="a bug in drawing"):
        main(["run", "--town", "Town02", "--out", str(tmp_path), "--workers", "1"])


@pytest.mark.parametrize("verb", ["run", "speed"])
def test_help_explains_every_option(verb, capsys):
    with pytest.raises(SystemExit) as stop:
        main([verb, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert "default" in text
    assert len(text.splitlines()) > 10


def short_suite(monkeypatch, name: str, **changes) -> None:
    """A suite whose drives end after two seconds."""
    suite = SUITES[name]
    conditions = replace(suite.conditions, time_limit_s=2.0)
    monkeypatch.setitem(SUITES, name, replace(suite, conditions=conditions, **changes))


def table_cells(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def test_suite_appearance_has_a_row_a_look(tmp_path, monkeypatch, capsys):
    looks = ("train", "hard:low_sun")
    short_suite(monkeypatch, "appearance", appearances=looks)
    arguments = ["run", "--suite", "appearance", "--town", "Town02", "--bev", "ipm"]
    assert main([*arguments, "--workers", "1", "--out", str(tmp_path)]) == 0
    header, _, _, *rows = table_cells(capsys.readouterr().out)
    assert header == ["BEV source", "Agent", "Look", "Town02 route (m)", "Infrac.", "Clean"]
    assert [row[:3] for row in rows] == [["ipm", "expert", look] for look in looks]
    content = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert [row["appearance"] for row in content["episodes"]] == [k for k in looks for _ in "12345"]
    assert [entry["appearance"] for entry in content["scores"]] == list(looks)
    seen = table_cells((tmp_path / "table.md").read_text(encoding="utf-8"))
    assert [row[:4] for row in seen[-2:]] == [["ipm", "expert", "Town02", look] for look in looks]
    # another sky, another BEV
    assert seen[-2][4:] != seen[-1][4:]


def test_suite_corruptions_has_a_row_an_error_model_and_a_figure(tmp_path, monkeypatch, capsys):
    short_suite(monkeypatch, "corruptions", doses=(0.5, 1.0))
    monkeypatch.setattr("benchmarks.suites.CORRUPTIONS", ("shift", "latency"))
    arguments = ["run", "--suite", "corruptions", "--town", "Town02", "--agent", "bc"]
    assert main([*arguments, "--workers", "1", "--out", str(tmp_path)]) == 0
    header, _, *rows = table_cells(capsys.readouterr().out)
    assert header[3:] == ["dose 0", "dose 0.5", "dose 1"]
    assert [row[2] for row in rows] == ["shift", "latency"]
    assert rows[0][3] == rows[1][3]
    content = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    drives = [(row["source"], row["error_model"], row["dose"]) for row in content["episodes"]]
    errors = [(model, dose) for model in ("shift", "latency") for dose in (0.5, 1.0)]
    expected = [("ground_truth", *error) for error in (("", None), *errors)]
    assert list(dict.fromkeys(drives)) == expected
    with Image.open(tmp_path / "dose_response.png") as image:
        assert "corruptions" in json.loads(image.text["provenance"])["command"]
    assert main(["report", str(tmp_path), "--cards", "0"]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<polyline") == 4


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--suite", "corruptions", "--bev", "ipm~shift=0.1"], ["ipm~shift=0.1", "one source"]),
        (["--ray-address", "auto"], ["--ray-address auto", "--executor ray"]),
        (["--executor", "threads"], ["threads", "processes", "ray"]),
    ],
)
def test_what_a_suite_or_executor_cannot_do_is_told_in_one_line(arguments, names, tmp_path, capsys):
    with contextlib.suppress(SystemExit):
        assert main(["run", *arguments, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert all(name in line for name in names)
    assert not (tmp_path / "out").exists()
