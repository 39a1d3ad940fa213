from __future__ import annotations

import csv
import json
import re
import shutil

import pytest

from benchmarks.cli import main
from benchmarks.report import replay
from benchmarks.report_command import Findings, findings_sections, read_run
from benchmarks.suites import Conditions

SHIFTED = "ground_truth~shift=0.3"
NOTE = {"command": "bev-perception evaluate", "date_utc": "2026-01-01", "git_commit": None}


@pytest.fixture
def folder(run_folder, tmp_path):
    """A copy of a run, with the replays that others of this file have made."""
    return shutil.copytree(run_folder, tmp_path / "run")


def report(folder, *more: str) -> int:
    return main(["report", str(folder), "--workers", "1", *more])


def test_page_markdown_and_csv_tell_of_the_same_run(run_folder, capsys):
    assert report(run_folder) == 0
    assert "report.html" in capsys.readouterr().out
    page, text = ((run_folder / f"report.{end}").read_text("utf-8") for end in ("html", "md"))
    results, _ = read_run(run_folder)
    failures = sum(len(result.events) > 0 for result in results)
    assert failures == 10
    assert page.count('class="film"') == 10
    assert "10 of 10 infractions" in page
    assert "another course" not in page
    # the shifted BEV was looked at on the way, the truth was not
    for name in ("How far each got", "Where they drove", "What the policy saw on the way"):
        assert name in page
        assert name in text
    with (run_folder / "report.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    driven = sum(result.driven_m for result in results if result.job.bev == SHIFTED)
    (metres,) = (
        float(row["value"]) for row in rows if (row["row"], row["column"]) == (SHIFTED, "Route (m)")
    )
    assert metres == pytest.approx(driven)
    assert f"{driven:.0f}" in text
    assert "![" in text
    assert (run_folder / "map_Town02.png").exists()


def test_the_page_names_no_other_place_and_forbids_them(run_folder):
    assert report(run_folder) == 0
    page = (run_folder / "report.html").read_text(encoding="utf-8")
    addresses = re.findall(r'(?:href|src)="([^"]*)"', page)
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert "default-src 'none'" in page.replace("&#x27;", "'")


def test_replays_are_kept_so_that_a_second_report_drives_nothing(folder, monkeypatch, capsys):
    assert report(folder) == 0
    first = (folder / "report.html").read_bytes()

    def never(job):
        raise AssertionError("driven again")

    monkeypatch.setattr(replay, "last_seconds", never)
    assert report(folder, "--out", str(folder / "again.html")) == 0
    assert (folder / "again.html").read_bytes() == first
    assert (folder / "again.md").exists()
    assert "driven again" not in capsys.readouterr().err


def test_fewer_cards_are_spread_over_the_drivers(folder):
    assert report(folder, "--cards", "4") == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "4 of 10 infractions" in page
    by_driver = page.split("<details")[1:3]
    assert [part.count("<article") for part in by_driver] == [2, 2]


def test_open_loop_and_attribution_have_sections_if_they_are_given(folder, tmp_path):
    row = {"log": "d", "town": "Town02", "split": "all", "appearance": "test", "source": "cvt"}
    row |= {"change": "none", "place": "all", "band": "all", "channel": "road"}
    row |= {"frames": 7, "iou": 0.456}
    (tmp_path / "evaluation.json").write_text(
        json.dumps({"provenance": NOTE, "iou": [row]}), encoding="utf-8"
    )
    job = {"bev": "cvt", "agent": "bc", "town": "Town02", "index": 0}
    found = {"provenance": NOTE, "rescues": []}
    found["attributions"] = [{"job": job, "cost_m": {"route": 77.0}}]
    (tmp_path / "attribution.json").write_text(json.dumps(found), encoding="utf-8")
    where = str(tmp_path)
    assert report(folder, "--cards", "0", "--perception", where, "--attribution", where) == 0
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert "What they see on drive logs" in text
    assert "0.456" in text
    assert "Which channel cost the metres" in text
    assert "77" in text
    assert "How they failed" not in (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--cards", "-1"], ["--cards", "-1"]),
        (["--workers", "0"], ["--workers", "0"]),
        (["--out", "report.pdf"], [".html", "report.pdf"]),
        (["--perception", "nowhere"], ["nowhere", "evaluation.json", "does not exist"]),
        (["--attribution", "nowhere"], ["nowhere", "attribution.json", "does not exist"]),
    ],
)
def test_a_mistake_is_told_in_one_line_and_nothing_is_written(folder, capsys, arguments, words):
    before = sorted(path.name for path in folder.iterdir())
    assert report(folder, *arguments) == 2
    told = capsys.readouterr().err.strip()
    assert len(told.splitlines()) == 1
    assert all(word in told for word in words)
    assert sorted(path.name for path in folder.iterdir()) == before


def test_drives_that_go_on_after_infractions_have_the_leaderboards_table(make_result):
    def names(conditions: Conditions) -> list[str]:
        routes, *_ = findings_sections(Findings([make_result(conditions=conditions)], {}))
        return [block.name for block in routes.blocks]

    assert names(Conditions()) == ["route completion"]
    assert names(Conditions(terminate_on=("blocked",))) == ["route completion", "leaderboard"]


def test_a_folder_without_a_finished_run_is_told(tmp_path, capsys):
    assert report(tmp_path) == 2
    assert "results.json does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["{", "[1]", "{}", '{"episodes": [{}], "provenance": {}}'])
def test_damaged_results_are_told(tmp_path, capsys, content):
    (tmp_path / "results.json").write_text(content, encoding="utf-8")
    assert report(tmp_path) == 2
    assert str(tmp_path) in capsys.readouterr().err


def test_another_file_in_place_of_an_evaluation_is_told(folder, tmp_path, capsys):
    (tmp_path / "evaluation.json").write_text('{"provenance": {}}', encoding="utf-8")
    assert report(folder, "--cards", "0", "--perception", str(tmp_path)) == 2
    assert "--perception" in capsys.readouterr().err


def test_drives_that_cannot_be_repeated_have_cards_without_pictures(folder, monkeypatch, capsys):
    shutil.rmtree(folder / "cards", ignore_errors=True)

    def gone(job):
        raise ValueError("no weights here")

    monkeypatch.setattr(replay, "last_seconds", gone)
    assert report(folder, "--cards", "2") == 0
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("could not be repeated (ValueError: no weights here)") == 2
    assert "no weights here" in capsys.readouterr().err
