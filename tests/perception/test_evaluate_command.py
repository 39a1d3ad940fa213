"""``bev-perception evaluate`` from the command line."""

import csv
import functools
import json
import shutil

import pytest

from perception import evaluation
from perception.cli import main
from perception.places import log_places

TOY = '''
import numpy as np

class Roads:
    """Predicts the road everywhere and nothing else."""
    channels = ("road",)
    def reset(self):
        pass
    def __call__(self, frame):
        return np.full((1, 192, 192), 255, np.uint8)

class Broken(Roads):
    def __call__(self, frame):
        raise KeyError("weights")
'''


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """A folder with a module of one's own."""
    (tmp_path / "toy_eval_sources.py").write_text(TOY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def evaluate(*arguments):
    return main(["evaluate", "--workers", "1", *map(str, arguments)])


def test_a_run_writes_tables_figures_and_pictures(log_folder, toy, capsys, monkeypatch):
    far_sighted = functools.partial(log_places, ahead_m=60.0)  # the drives are short
    monkeypatch.setattr(evaluation, "log_places", far_sighted)
    bev = ["ground_truth", "toy_eval_sources:Roads"]
    asked = ["--bev", *bev, "--data", log_folder, "--samples", 6, "--pictures", 1]
    assert evaluate(*asked, "--seed", 3, "--out", "eval") == 0
    text = (toy / "eval/evaluation.md").read_text()
    assert text.strip() in capsys.readouterr().out
    truth, roads = (
        next(line for line in text.splitlines() if line.startswith(f"| {name}")) for name in bev
    )
    assert truth.split("|")[2:6] == [" 1.000 ", " 1.000 ", " 1.000 ", "    1.000 "]
    cells = [cell.strip() for cell in roads.split("|")[2:-1]]
    assert 0.1 < float(cells[0]) < 0.9
    assert cells[1:] == ["-"] * 7

    with (toy / "eval/evaluation.csv").open() as file:
        table = list(csv.DictReader(file))
    (row,) = (
        row
        for row in table
        if (row["source"], row["place"], row["band"], row["channel"])
        == ("toy_eval_sources:Roads", "all", "all", "road")
    )
    assert f"{float(row['iou']):.3f}" == cells[0]
    assert (row["frames"], row["town"], row["appearance"]) == ("6", "Town02", "test")

    found = json.loads((toy / "eval/evaluation.json").read_text())
    note = found["provenance"]
    assert note["command"].startswith("bev-perception evaluate --workers 1 --bev ground_truth")
    assert note["seeds"] == [3]
    assert set(note["hashes"]) == {"toy_eval_sources:Roads", str(log_folder)}
    assert len(found["iou"]) == len(table)
    assert found["results"][1]["turns"] is None
    assert [len(result["frames"]) for result in found["results"]] == [6, 6]

    drawn = sorted(path.name for path in (toy / "eval").glob("pictures/*"))
    stem = str(log_folder).strip("/").replace("/", "_") + "_ground_truth"
    assert drawn == [f"{stem}_median_1.png", f"{stem}_worst_1.png"]


def test_leaks_add_a_row_for_each_change(log_folder, toy):
    asked = ["--bev", "ipm", "--data", log_folder, "--samples", 2, "--split", "train"]
    assert evaluate(*asked, "--leaks", "--out", "eval") == 0
    text = (toy / "eval/evaluation.md").read_text()
    table = text.split("\n\n")[4].splitlines()
    names = [line.split("|")[1].strip() for line in table[2:]]
    assert names[0] == "ipm"
    assert names[1:] == [
        "ipm, black cameras",
        "ipm, cameras of another place",
        "ipm, no route map",
        "ipm, route map of another place",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--bev", "imp"], "unknown bev_source 'imp'; available sources: "),
        (["--bev", "missing.safetensors"], "there is no such file"),
        (
            ["--bev", "toy_eval_sources:Broken"],
            "'toy_eval_sources:Broken' raised KeyError: 'weights'",
        ),
        (["--bev", "ipm", "--samples", "0"], "--samples must be"),
        (["--bev", "ipm", "--pictures", "-1"], "--pictures must be at least 0, got -1"),
    ],
)
def test_mistakes_are_told_in_one_line(log_folder, toy, capsys, arguments, message):
    assert evaluate(*arguments, "--data", log_folder, "--out", "eval") == 2
    (line,) = [
        line for line in capsys.readouterr().err.splitlines() if line.startswith("bev-perception")
    ]
    assert line.startswith("bev-perception evaluate: ")
    assert message in line
    assert not (toy / "eval").exists()


def test_a_broken_log_is_told_in_one_line(log_folder, toy, capsys):
    assert evaluate("--bev", "ipm", "--data", "nowhere") == 2
    assert "nowhere is not a drive log" in capsys.readouterr().err
    shutil.copytree(log_folder, toy / "damaged")
    for path in (toy / "damaged/episodes").glob("*actors.parquet"):
        path.write_bytes(path.read_bytes()[:1000])
    assert evaluate("--bev", "ipm", "--data", "damaged", "--samples", 4) == 2
    assert "actors.parquet" in capsys.readouterr().err.splitlines()[-1]
