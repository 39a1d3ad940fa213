"""Predictors that come with the package."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch

import perception
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import CHANNELS
from bev_driving_env.sources.registry import bev_source_names, source_file
from perception import shipped
from perception.metrics import channel_iou
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
        text = path.with_suffix(".md").read_text(encoding="utf-8")
        assert card["git_commit"][:12] in text
        assert f"`{card['command']}`" in text


def test_all_weights_together_stay_small():
    packages = Path(perception.__file__).parents[1]
    weights = [*packages.glob("perception/weights/*"), *packages.glob("agents/weights/*")]
    assert {path.stem for path in weights if path.suffix == ".safetensors"} >= set(
        perception.SHIPPED
    )
    assert sum(path.stat().st_size for path in weights) < 40_000_000


@pytest.mark.parametrize("name", perception.SHIPPED)
def test_each_shows_the_policy_its_channels(name):
    with BEVTownEnv("Town02", bev_source=name, appearance="test") as env:
        observation, _ = env.reset(seed=0, options={"episode": 1})
        truth = env.ground_truth_bev()
    found = channel_iou(observation["bev"], truth)
    assert found[:2].min() > 0.3  # even without cameras the map says where road and route are
    predicted = shipped_channels(name)
    missing = [k for k, channel in enumerate(CHANNELS) if channel not in predicted]
    assert not observation["bev"][missing].any()


def shipped_channels(name):
    return load_predictor(shipped.shipped_path(name)).channels


def test_names_are_known_without_pytorch():
    code = "import sys, perception; perception.SOURCES; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
