"""Predictors on disk."""

import dataclasses
import json
import struct

import pytest
import torch
from safetensors.torch import save_file

from perception import weights
from perception.weights import (
    KIND,
    Predictor,
    WeightsError,
    load_predictor,
    predictor_card,
    save_predictor,
)

THRESHOLDS = (0.5, 0.45, 0.4, 0.35, 0.3, 0.25)
CARD = {"steps": 4, "iou": {"lights": None}}


@pytest.fixture
def predictor(tiny_spec):
    torch.manual_seed(3)
    return Predictor(tiny_spec, tiny_spec.build(), THRESHOLDS, (112, 240), CARD)


@pytest.fixture
def path(predictor, tmp_path):
    save_predictor(predictor, tmp_path / "a.safetensors")
    return tmp_path / "a.safetensors"


def test_what_is_written_is_read_again(predictor, path):
    read = load_predictor(path)
    assert read.spec == predictor.spec
    assert read.thresholds == THRESHOLDS
    assert read.camera_size == (112, 240)
    assert read.card == CARD == predictor_card(path)
    assert read.channels == predictor.spec.config.channels
    assert not read.model.training
    for name, value in predictor.model.state_dict().items():
        assert torch.equal(read.model.state_dict()[name], value.half().float()), name


@pytest.mark.parametrize("thresholds", [(0.5,), (0.5,) * 5 + (0.0,), (0.5,) * 5 + (1.0,)])
def test_there_is_one_threshold_a_channel(thresholds, predictor):
    with pytest.raises(ValueError, match="thresholds must be 6 numbers between 0 and 1"):
        dataclasses.replace(predictor, thresholds=thresholds)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no file .*nothing\.safetensors"):
        load_predictor(tmp_path / "nothing.safetensors")


def test_a_damaged_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(WeightsError, match="is damaged or no safetensors file"):
        load_predictor(path)


def test_a_foreign_file_is_refused_by_what_it_is(tmp_path):
    foreign, policy = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    save_file({"weight": torch.zeros(1)}, foreign)
    save_file({"weight": torch.zeros(1)}, policy, {"bevtown_policy": "{}"})
    with pytest.raises(WeightsError, match="was not written by BEVTown"):
        load_predictor(foreign)
    with pytest.raises(WeightsError, match="holds a bevtown_policy"):
        load_predictor(policy)


def test_a_newer_version_asks_for_an_update(predictor, tmp_path, monkeypatch):
    monkeypatch.setattr(weights, "VERSION", 99)
    save_predictor(predictor, tmp_path / "new.safetensors")
    monkeypatch.undo()
    with pytest.raises(WeightsError, match=r"version 99, this BEVTown reads up to 1: update"):
        load_predictor(tmp_path / "new.safetensors")


@pytest.mark.parametrize(
    "change",
    [
        {"thresholds": [0.5]},
        {"thresholds": None},
        {"camera_size": None},
        {"camera_size": [112]},
        {"spec": {"architecture": "gan", "config": {}}},
        {"card": None},
    ],
)
def test_a_header_that_does_not_fit_its_weights_is_refused(change, path):
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    fields = {**json.loads(header["__metadata__"][KIND]), **change}
    header["__metadata__"][KIND] = json.dumps(fields)
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + length :])
    with pytest.raises(WeightsError, match="does not hold the predictor that it describes"):
        load_predictor(path)


def test_other_sizes_than_the_spec_says_are_refused(predictor, tmp_path):
    wider = predictor.spec.with_channels(("road",))
    mixed = Predictor(wider, predictor.model, (0.5,), (112, 240), {})
    save_predictor(mixed, tmp_path / "mixed.safetensors")
    with pytest.raises(WeightsError, match="does not hold the predictor") as caught:
        load_predictor(tmp_path / "mixed.safetensors")
    assert "\n" not in str(caught.value)
