from __future__ import annotations

import json

import pytest

from benchmarks import speed, speed_policy, speed_predictors
from benchmarks.cli import main
from benchmarks.speed import Figure
from benchmarks.speed_command import as_table


def test_further_worlds_take_less_than_two_megabytes_beside_their_observation():
    assert 10_000 < speed.bytes_per_world(8) < 2_000_000


def test_the_table_marks_missed_targets_and_only_those():
    table = as_table(
        [
            Figure("fast", 120.0, "x", "at least 50", True),
            Figure("slow", 3.0, "x", "at least 50", False),
            Figure("rate", 1234.5, "steps/s"),
        ]
    )
    fast, slow, rate = table.splitlines()[2:]
    assert "missed" not in fast
    assert "at least 50 (missed)" in slow
    assert "1,234 steps/s" in rate


@pytest.mark.usefixtures("short_logs")
def test_speed_measures_everything_and_writes_it_with_provenance(tmp_path, monkeypatch, capsys):
    # a fresh compilation takes ten seconds and is what `make speed` is for
    monkeypatch.setattr(
        speed, "measure_first_use", lambda: {"cold": 10.0, "warm": 1.0, "import": 0.2}
    )
    monkeypatch.setattr(speed_policy, "WORLDS", 2)
    monkeypatch.setattr(speed_policy, "BATCH", 2)
    monkeypatch.setattr(speed_predictors, "WORLDS", 2)
    monkeypatch.setattr(speed_predictors, "preset_ms", lambda *_: 900.0)
    out = tmp_path / "speed.json"
    assert main(["speed", "--rounds", "1", "--seconds", "0.01", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    content = json.loads(out.read_text(encoding="utf-8"))
    values = {entry["name"]: entry["value"] for entry in content["figures"]}
    assert all(value > 0.0 for value in values.values())
    assert all(name in printed for name in values)
    single = values["BEVTown01-v0, ground-truth BEV, one env"]
    highway = values["highway-env intersection-v2, 192 x 192 gray"]
    assert abs(values["one env / intersection-v2"] / (single / highway) - 1.0) < 1e-6
    for measured in ("collecting", "four cameras at 112 x 240", "bc, one observation", "cvt_kde"):
        assert any(measured in name for name in values)
    assert content["provenance"]["command"].startswith("bev-bench speed")


def test_first_use_reports_compilation_once_and_less_time_after(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "FIRST_USE", "print(0.1, 2.0)")
    assert speed.measure_first_use(1) == {"cold": 2.0, "warm": 2.0, "import": 0.1}
