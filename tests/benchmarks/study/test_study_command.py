"""``bev-bench study`` from the command line, on one short route and few frames."""

import csv
import functools
import importlib.util
import json
import re
import shlex
from pathlib import Path

import pytest
from PIL import Image

from benchmarks import runner, study_command
from benchmarks.cli import build_parser, main
from benchmarks.study.frames import collect_logs
from benchmarks.study.variants import KINDS, default_variants

DOCS = Path(__file__).parents[3] / "docs"
VARIANTS = ["ground_truth", "ground_truth~straightening=1@route", "ground_truth~latency=*@route"]


@pytest.fixture
def short_study(monkeypatch):
    """One town, and logs of four seconds."""
    short = functools.partial(collect_logs, time_limit_s=4.0)
    monkeypatch.setattr(study_command, "TOWNS", ("Town02",))
    monkeypatch.setattr(study_command, "collect_logs", short)


def arguments(out, *more):
    return [
        *("study", "--variants", *VARIANTS, "--routes", "1", "--samples", "6", "--seed", "4"),
        *("--workers", "1", "--out", str(out), *more),
    ]


def read_csv(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


@pytest.mark.slow
@pytest.mark.usefixtures("short_study")
def test_a_study_writes_tables_and_figure_and_resumes(tmp_path, monkeypatch, capsys):
    assert main(arguments(tmp_path)) == 0
    printed = capsys.readouterr().out
    text = (tmp_path / "study.md").read_text(encoding="utf-8")
    assert text in printed
    for title in ("Conclusion", "Metrics", "Within kinds", "Equal mean IoU"):
        assert f"## {title}" in text
    rows = {row["variant"]: row for row in read_csv(tmp_path / "study.csv")}
    assert len(rows) == 4
    truth = rows["ground_truth"]
    assert float(truth["mean_iou"]) == float(truth["clean_share"]) == 1.0
    straight = rows["ground_truth~straightening=1@route"]
    assert float(straight["iou_road"]) == 1.0
    assert float(straight["iou_route"]) < 1.0
    assert float(straight["divergence"]) >= 0.0
    assert 0.0 < float(straight["online_iou_route"]) < 1.0
    with Image.open(tmp_path / "study.png") as image:
        assert json.loads(image.text["provenance"])["seeds"] == [4]
        assert image.width > image.height > 600
    kept = read_csv(tmp_path / "study.csv")
    (lost,) = (tmp_path / "episodes").glob("*straightening*.json")
    lost.unlink()
    driven = []
    real = runner.drive
    monkeypatch.setattr(runner, "drive", lambda job, *keep: driven.append(job) or real(job, *keep))
    assert main(arguments(tmp_path)) == 0
    assert [job.bev for job in driven] == ["ground_truth~straightening=1@route"]
    assert read_csv(tmp_path / "study.csv") == kept
    assert main(arguments(tmp_path, "--agent", "bc_town")) == 2
    assert "holds a run with agent 'bc', this one has 'bc_town'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--routes", "0"], "--routes must be"),
        (["--routes", "101"], "'test' routes of at most 300 m, 51 were asked for"),
        (["--samples", "0"], "--samples must be"),
        (["--seed", "-1"], "--seed must be at least 0, got -1"),
        (["--variants", "cvt_kd"], "--variants 'cvt_kd' matches none"),
        (["--variants", "blind"], "at least 3 variants, got 1"),
        (["--checkpoints", "nowhere.safetensors"], "there is no such file"),
        (["--agent", "nobody"], "nobody"),
    ],
)
def test_mistakes_are_told_in_one_line_and_nothing_is_written(more, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(arguments(out, *more)) == 2
    lines = capsys.readouterr().err.splitlines()
    told = [line for line in lines if not line.startswith("BEVTown: compiling")]
    assert len(told) == 1
    assert message in told[0]
    assert not out.exists()


def test_the_page_shows_a_command_that_parses_and_counts_the_variants_rightly():
    page = (DOCS / "study.md").read_text("utf-8")
    (line,) = re.findall(r"^bev-bench (study .*)$", page, flags=re.MULTILINE)
    options = build_parser().parse_args(shlex.split(line))
    assert (options.routes, options.samples, options.agent) == (20, 300, "bc")
    variants = default_variants()
    assert f"the same of {len(variants)}:" in page
    for kind in KINDS[:-1]:
        count = sum(variant.kind == kind for variant in variants)
        assert re.search(rf"^\| {kind} +\| +{count} \|", page, flags=re.MULTILINE), kind


def test_the_page_is_filled_between_its_marks_and_again():
    spec = importlib.util.spec_from_file_location("fill_study", DOCS / "fill_study.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    page = (DOCS / "study.md").read_text("utf-8")
    once = script.filled(page, "# Title\n\nSome variants.\n\n## Conclusion\n\nSo.\n")
    assert "Some variants.\n\n### Conclusion\n\nSo.\n" in once
    assert "Pending" not in once
    assert once.startswith(page[: page.index("<!--")])
    assert script.filled(once, "# Title\n\nSome variants.\n\n## Conclusion\n\nSo.\n") == once
