"""Starting a training from a predictor."""

import hashlib
from dataclasses import replace

import pytest
import torch

from perception.models.cvt_config import FAST
from perception.models.presets import ModelSpec
from perception.starting import distinct_frames, output_layers, predecessors, start_from
from perception.training import Trainer, TrainingConfig
from perception.weights import Predictor, WeightsError, save_predictor

CONFIG = TrainingConfig(steps=4, batch_size=2)


@pytest.fixture
def saved(tiny_spec, tmp_path):
    """Writes a predictor of a spec; returns its network and its file."""

    def save(spec=tiny_spec):
        torch.manual_seed(7)
        model, channels = spec.build(), spec.config.channels
        card = {"command": "bev-perception train", "samples": 80, "machine": "toy"}
        predictor = Predictor(spec, model, (0.5,) * len(channels), spec.camera_size, card)
        save_predictor(predictor, tmp_path / "old.safetensors")
        return model, tmp_path / "old.safetensors"

    return save


def test_training_starts_with_the_predictors_weights(saved, tiny_spec):
    model, path = saved()
    start = start_from(path, tiny_spec)
    trained = Trainer(CONFIG, tiny_spec, start=start).module.state_dict()
    for name, value in model.state_dict().items():
        torch.testing.assert_close(trained[name], value, rtol=1e-3, atol=1e-6)  # stored in fp16
    assert start.digest == hashlib.sha256(path.read_bytes()).hexdigest()
    assert start.card == {"command": "bev-perception train", "samples": 80}


def test_the_card_tells_of_all_that_came_before(tiny_spec, tmp_path):
    told: dict = {}
    for samples in (10, 20, 30):
        card = {"samples": samples, "machine": "toy", **told}
        predictor = Predictor(tiny_spec, tiny_spec.build(), (0.5,) * 6, tiny_spec.camera_size, card)
        save_predictor(predictor, tmp_path / "old.safetensors")
        start = start_from(tmp_path / "old.safetensors", tiny_spec)
        told = {"started_from": {"sha256": start.digest, **start.card}}
    assert [each["samples"] for each in predecessors(told)] == [30, 20, 10]


def test_other_frames_come_than_those_before(tiny_spec, tmp_path):
    def file(card):
        predictor = Predictor(tiny_spec, tiny_spec.build(), (0.5,) * 6, tiny_spec.camera_size, card)
        save_predictor(predictor, tmp_path / "old.safetensors")
        return tmp_path / "old.safetensors"

    start = start_from(file({"samples": 10, "started_from": {"samples": 5}}), tiny_spec)
    assert start.frames == 15
    assert Trainer(CONFIG, tiny_spec, start=start).batches_before == 8  # of 2
    assert Trainer(CONFIG, tiny_spec).batches_before == 0
    unknown = start_from(file({"machine": "toy"}), tiny_spec)
    assert Trainer(CONFIG, tiny_spec, start=unknown).batches_before == 0


def test_frames_that_came_again_count_once():
    def card(data, samples, before=None, **more):
        return {"data": [data], "seeds": [0], "samples": samples, "started_from": before, **more}

    smooth = card("smooth", 30)
    assert distinct_frames(smooth) == 30
    assert distinct_frames(card("a", 50, card("a", 20, smooth))) == 30 + 50
    assert distinct_frames(card("a", 20, card("a", 50, smooth))) == 30 + 50
    assert distinct_frames(card("a", 20, card("a", 50, smooth), first_frame=80)) == 30 + 50 + 20
    assert distinct_frames(card("a", 20, card("a", 50), first_frame=40)) == 60
    assert distinct_frames({**card("a", 20, card("a", 50)), "seeds": [1]}) == 70


@pytest.mark.parametrize("channels", [("road", "lane"), ("lights",)])
def test_for_other_channels_the_output_layer_starts_anew(saved, tiny_spec, channels):
    model, path = saved()
    spec = tiny_spec.with_channels(channels)
    fresh = Trainer(CONFIG, spec).module.state_dict()
    started = Trainer(CONFIG, spec, start=start_from(path, spec)).module.state_dict()
    for name, value in model.state_dict().items():
        if name.startswith("unet.head"):
            assert torch.equal(started[name], fresh[name])
        else:
            torch.testing.assert_close(started[name], value, rtol=1e-3, atol=1e-6)


def test_channels_in_another_order_are_other_channels(saved, tiny_spec):
    _, path = saved()
    spec = tiny_spec.with_channels(tiny_spec.config.channels[::-1])
    assert "unet.head.weight" not in start_from(path, spec).weights


def test_the_output_layer_of_a_cross_view_transformer_is_its_head():
    assert output_layers(ModelSpec("cvt", FAST)) == {"decoder.head.0.weight", "decoder.head.0.bias"}


def test_a_network_of_another_preset_is_an_error_that_says_how_it_differs(saved, tiny_spec):
    _, path = saved()
    with pytest.raises(ValueError, match="architecture 'bev_unet', not 'cvt'"):
        start_from(path, ModelSpec("cvt", FAST))
    wider = replace(tiny_spec, config=replace(tiny_spec.config, widths=(8, 8)))
    with pytest.raises(ValueError, match=r"widths \[4, 4\] instead of \[8, 8\]"):
        start_from(path, wider)


def test_what_is_no_predictor_is_an_error(tiny_spec, tmp_path):
    with pytest.raises(FileNotFoundError):
        start_from(tmp_path / "none.safetensors", tiny_spec)
    (tmp_path / "text.safetensors").write_text("no weights", encoding="utf-8")
    with pytest.raises(WeightsError):
        start_from(tmp_path / "text.safetensors", tiny_spec)
