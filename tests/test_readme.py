"""The Python blocks and ``bev-bench`` lines of the README and the docs run as written."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.cli import build_parser

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCS = "\n".join(page.read_text(encoding="utf-8") for page in sorted(ROOT.glob("docs/*.md")))
PAGES = README + DOCS
BLOCKS = re.findall(r"```python\n(.*?)```", PAGES, flags=re.DOTALL)
BASH = "\n".join(re.findall(r"```bash\n(.*?)```", PAGES, flags=re.DOTALL))
TRAFFIC = re.findall(r"^(bev-bench traffic .*)$", BASH, flags=re.MULTILINE)
COMMANDS = re.findall(r"^(bev-bench run .*)$", BASH, flags=re.MULTILINE)
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
# of the README's lines, those that make demo runs
DEMO = [c for c in COMMANDS if c.endswith(" --out runs/demo")]
PICTURES = sorted({f"docs/{name}" for name in re.findall(r"(pictures/[^)]*)\)", PAGES)})
MODULES = {match[1]: block for block in BLOCKS if (match := re.match(r"# (\w+\.py)\n", block))}
"""Blocks that say which file they are, by its name."""
TARGETS = re.findall(r"`?make ([a-z]+)", README)


def run(arguments: list[str], folder: Path) -> str:
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


SLOW_BLOCKS = ("draw_routes(",)


def numbered_block(number: int) -> object:
    long = any(part in BLOCKS[number] for part in SLOW_BLOCKS)
    return pytest.param(number, marks=[pytest.mark.slow] if long else [])


@pytest.mark.parametrize("number", [numbered_block(k) for k in range(len(BLOCKS))])
def test_python_block_runs_as_written(number, tmp_path):
    run([sys.executable, "-c", BLOCKS[number]], tmp_path)


def write_modules(folder: Path) -> None:
    for name, block in MODULES.items():
        (folder / name).write_text(block, encoding="utf-8")


LONG = (
    "--suite town",
    "--suite routes",
    "--bev ipm_unet_kde",
    "examples.my_predictor",
    "--agent runs/bc",
    "--agent bc ",
    "--agent my_agent:make bc",
    "grove:Grove",
)
"""What takes long in a line, and is tested elsewhere on less."""


def line_of_bash(command: str) -> object:
    marks = [pytest.mark.slow] if any(part in command for part in LONG) else []
    return pytest.param(command, marks=marks)


@pytest.mark.parametrize("command", [line_of_bash(c) for c in COMMANDS if c not in DEMO])
def test_benchmark_line_runs_as_written(command, tmp_path):
    write_modules(tmp_path)
    if "grove:" in command:
        assert "'test': 50" in run([sys.executable, "grove.py"], tmp_path)
    weights = tmp_path / "runs/bc/policy.safetensors"
    weights.parent.mkdir(parents=True)
    shutil.copyfile(ROOT / "agents/weights/bc.safetensors", weights)
    # predictors on a hundred routes take half an hour
    shorter = command.replace("--suite routes --bev", "--suite paper --bev")
    program, *arguments = shlex.split(shorter)
    assert program == "bev-bench"
    printed = run([sys.executable, "-m", "benchmarks.cli", *arguments], tmp_path)
    town = arguments[arguments.index("--town") + 1] if "--town" in arguments else "Town01"
    doses = "--suite corruptions" in command
    header = "| Error model " if doses else f"{town} route (m)"
    assert header in printed or f"| {town} |" in printed
    out = tmp_path / arguments[arguments.index("--out") + 1]
    assert (out / f"map_{town.rpartition(':')[2]}.png").exists()
    assert any(out.glob("videos/*.mp4")) == ("--video" in arguments)
    assert (out / "dose_response.png").exists() == doses


@pytest.mark.parametrize("command", re.findall(r"^(bev-bench .*)$", BASH, flags=re.MULTILINE))
def test_benchmark_line_is_understood(command):
    build_parser().parse_args(shlex.split(command, comments=True)[1:])


def test_the_agent_of_the_guide_drives_town01_cleanly_as_the_guide_says(tmp_path):
    write_modules(tmp_path)
    drive = """
import sys
from pathlib import Path
from benchmarks.drive import drive
from benchmarks.suites import SUITES, jobs_of
sys.path.append(".")
jobs = jobs_of(SUITES["paper"], ["Town01", "Town02"], ["ground_truth"], ["my_agent:make"], [0])
print([drive(job).clean for job in jobs].count(True))
"""
    assert run([sys.executable, "-c", drive], tmp_path).strip() == "9"


@pytest.mark.slow
def test_the_metric_of_the_guide_reads_what_a_run_wrote(tmp_path):
    write_modules(tmp_path)
    line = next(command for command in COMMANDS if command.endswith("--out runs/ipm"))
    run([sys.executable, "-m", "benchmarks.cli", *shlex.split(line)[1:]], tmp_path)
    printed = run([sys.executable, "my_metric.py", "runs/ipm"], tmp_path)
    assert re.search(r"^ipm, Town02 \d: [a-z_]+, route IoU 0\.\d\d", printed, flags=re.MULTILINE)


SHORTER = {
    "collect": ["--collections", "1", "--routes", "0", "4", "--time-limit", "3"],
    "train": ["--dagger", "0", "--steps", "2", "--batch-size", "4"],
    "info": [],
    "export": [],
    "ppo": [
        *("--steps", "16", "--worlds", "2", "--horizon", "8", "--batch-size", "8"),
        *("--epochs", "1", "--validate-every", "16", "--validation-routes", "1"),
    ],
}
"""What makes a line of ``bev-agents`` quick; the last of two equal options counts."""


def test_agents_lines_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    lines = re.findall(r"^bev-agents (.*)$", BASH, flags=re.MULTILINE)
    assert {shlex.split(line)[0] for line in lines} == set(SHORTER)
    for line in lines:
        arguments = shlex.split(line, comments=True)
        run([sys.executable, "-m", "agents.cli", *arguments, *SHORTER[arguments[0]]], tmp_path)
    assert (tmp_path / "runs/bc/policy.safetensors").exists()
    assert (tmp_path / "datasets/bevtown/town01-v0/data/metadata.json").exists()


PERCEPTION_SHORTER = {
    "train": ["--steps", "2", "--batch-size", "2", "--validation-samples", "2", "--workers", "0"],
    "evaluate": ["--samples", "4", "--workers", "1"],
}
"""What makes a line of ``bev-perception`` quick."""


@pytest.mark.slow
def test_perception_lines_run_one_after_the_other(tmp_path):
    (page,) = ROOT.glob("docs/predictors.md")
    collect, *lines = re.findall(r"```bash\n(.*?)```", page.read_text("utf-8"), re.DOTALL)[
        0
    ].splitlines()
    program, *arguments = shlex.split(collect)
    assert program == "bev-agents"
    run([sys.executable, "-m", "agents.cli", *arguments, *SHORTER["collect"]], tmp_path)
    assert [shlex.split(line)[:2] for line in lines] == [
        ["bev-perception", "train"],
        ["bev-perception", "evaluate"],
    ]
    for line in lines:
        verb, *arguments = shlex.split(line)[1:]
        shorter = PERCEPTION_SHORTER[verb]
        run([sys.executable, "-m", "perception.cli", verb, *arguments, *shorter], tmp_path)
    assert "| ipm" in (tmp_path / "runs/eval/evaluation.md").read_text("utf-8")


@pytest.mark.parametrize("command", TRAFFIC)
def test_traffic_line_runs_as_written(command, tmp_path):
    # of the many seeds one will do
    arguments = shlex.split(command.partition(" --seed")[0])[1:]
    assert "Town02" in run([sys.executable, "-m", "benchmarks.cli", *arguments], tmp_path)


@pytest.mark.parametrize("command", DEMO)
def test_make_demo_drives_what_the_readme_says_and_reports_it(command):
    assert command.replace("runs/demo", "$(OUT)") in MAKEFILE
    assert "bev-bench report runs/demo" in BASH
    assert "bev-bench report $(OUT)" in MAKEFILE


def test_there_is_something_to_run():
    assert len(BLOCKS) >= 10
    assert len(COMMANDS) >= 5


@pytest.mark.slow
def test_a_failing_predictor_is_attributed_and_reported_as_the_readme_says(tmp_path):
    lines = re.findall(r"^bev-bench (.*) --out runs/attribution$", README, flags=re.MULTILINE)
    (attribute,) = (shlex.split(line) for line in lines)
    (report,) = re.findall(r"^bev-bench (report .* --attribution .*)$", README, flags=re.MULTILINE)
    program = [sys.executable, "-m", "benchmarks.cli"]
    printed = run([*program, *attribute, "--out", "runs/attribution"], tmp_path)
    assert "# When failed drives were lost" in printed
    run([*program, "run", *attribute[1:], "--agent", "bc", "--out", "runs/demo"], tmp_path)
    run([*program, *shlex.split(report), "--cards", "1"], tmp_path)
    page = (tmp_path / "runs/demo/report.html").read_text(encoding="utf-8")
    assert "Which channel cost the metres" in page


@pytest.mark.slow
def test_the_study_runs_as_the_readme_says_on_less(tmp_path):
    (line,) = re.findall(r"^bev-bench (study .*)$", README, flags=re.MULTILINE)
    less = ["--routes", "2", "--samples", "4", "--variants", "ground_truth~shift=*@route", "blind"]
    printed = run([sys.executable, "-m", "benchmarks.cli", *shlex.split(line), *less], tmp_path)
    assert "# Which metric foretells driving?" in printed
    assert (tmp_path / "runs/study/study.png").exists()


@pytest.mark.parametrize("target", sorted(set(TARGETS)))
def test_every_make_target_of_the_readme_exists(target):
    assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE)


@pytest.mark.parametrize("picture", PICTURES)
def test_every_picture_exists_and_is_small(picture):
    limit = 150_000 if picture.endswith(".jpg") else 60_000  # photographs need more than maps
    assert 1_000 < (ROOT / picture).stat().st_size < limit
