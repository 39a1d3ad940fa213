"""The recipes of trained weights run, from nothing to predictors, and run again to no effect."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import perception
from perception.shipped import shipped_path
from perception.weights import predictor_card

RECIPES = Path(__file__).parents[2] / "recipes"
SHORT = ["--steps", "2", "--batch-size", "2", "--validate-every", "2", "--threads", "1"]
SHORT += ["--validation-samples", "2", "--workers", "0", "--device", "cpu", "--precision", "fp32"]
SHORT += ["--until", "2"]
BEGINNINGS = {"cvt_start", "cvt_short", "cvt_half", "ipm_start", "ipm_half"}
"""Predictors that others go on from, and that are not shipped."""


def run(recipe, folder, *options):
    """Run a recipe in a folder of its own, with the commands that belong to this Python."""
    commands = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    arguments = ["bash", str(RECIPES / recipe), *SHORT, *options]
    environment = {**os.environ, "PATH": commands}
    subprocess.run(arguments, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)


@pytest.mark.slow
def test_the_recipe_makes_every_predictor_that_is_shipped(tmp_path):
    run("predictors.sh", tmp_path)
    made = {file.parent.name: file for file in tmp_path.glob("runs/*/predictor.safetensors")}
    assert set(made) == {*perception.SHIPPED, *BEGINNINGS}
    before = {name: file.stat().st_mtime_ns for name, file in made.items()}
    for name in perception.SHIPPED:
        ours, theirs = predictor_card(shipped_path(name)), predictor_card(made[name])
        same = ("preset", "data", "loss", "looks", "flips", "weighting", "weighting_settings")
        assert [ours[key] for key in same] == [theirs[key] for key in same], name
    run("predictors.sh", tmp_path)
    assert {name: predictor_card(file)["steps"] for name, file in made.items()} == dict.fromkeys(
        before, 2
    )


@pytest.mark.slow
def test_the_recipe_of_the_published_network_runs(tmp_path):
    run("cvt_kde_paper.sh", tmp_path)
    card = predictor_card(tmp_path / "runs" / "cvt_kde_paper" / "predictor.safetensors")
    assert (card["preset"], card["weighting"], card["steps"]) == ("paper", "kde", 2)
