"""Predictors that come with the package."""

import subprocess
import sys

import pytest
import torch

import perception
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.sources.registry import bev_source_names, source_file
from perception import shipped
from perception.weights import Predictor, load_predictor, predictor_card, save_predictor


def test_a_name_makes_the_source_of_its_weights(tiny_spec, tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    monkeypatch.setitem(perception.SOURCES, "tiny_one", "perception.shipped:tiny_one")
    torch.manual_seed(0)
    predictor = Predictor(tiny_spec, tiny_spec.build(), (0.5,) * 6, (112, 240), {"steps": 1})
    save_predictor(predictor, shipped.shipped_path("tiny_one"))
    assert "tiny_one" in bev_source_names()
    assert shipped.tiny_one().predictor.card == {"steps": 1}
    assert source_file("tiny_one") == shipped.shipped_path("tiny_one")
    with BEVTownEnv("Town02", bev_source="tiny_one") as env:
        assert env.reset(seed=0)[0]["bev"].shape == (6, 192, 192)


def test_nothing_else_comes_with_it():
    with pytest.raises(AttributeError, match="no attribute 'cvt_9000'"):
        _ = shipped.cvt_9000


def test_each_can_be_loaded_and_has_a_card_that_says_where_it_came_from():
    for name in perception.SHIPPED:
        path = shipped.shipped_path(name)
        assert path.stat().st_size < 8_000_000
        card = predictor_card(path)
        assert {"command", "git_commit", "data", "steps", "hours", "machine"} <= set(card)
        assert load_predictor(path).card == card


def test_names_are_known_without_pytorch():
    code = "import sys, perception; perception.SOURCES; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
