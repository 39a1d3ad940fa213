"""Networks by name, and specs as JSON."""

import json

import pytest

from bev_driving_env.frames import CHANNELS
from perception.models.bev_unet import BEVUNet, BEVUNetConfig
from perception.models.image_unet import ImageUNetConfig
from perception.models.presets import PRESETS, ModelSpec, build_model, model_spec


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_survives_json(name):
    spec = PRESETS[name]
    assert ModelSpec.from_json(json.loads(json.dumps(spec.as_json()))) == spec


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_predict_fewer_channels(name):
    spec = PRESETS[name].with_channels(("lane", "road"))
    assert spec.config.channels == ("lane", "road")
    assert spec.with_channels(PRESETS[name].config.channels) == PRESETS[name]


@pytest.mark.parametrize(
    ("name", "needs", "channels"),
    [
        ("ipm_unet", {"ground", "route_map"}, CHANNELS),
        ("blind", {"route_map"}, CHANNELS[:3]),
        ("unet", {"images", "route_map"}, CHANNELS),
    ],
)
def test_a_preset_says_what_it_sees_and_predicts(name, needs, channels):
    model = build_model(name)
    assert model.needs == needs
    assert model.channels == channels


def test_images_are_of_the_size_that_the_network_wants():
    assert PRESETS["paper"].camera_size == (224, 480)
    assert PRESETS["fast"].camera_size == PRESETS["ipm_unet"].camera_size == (112, 240)


def test_a_spec_builds_itself(tiny_spec):
    assert model_spec(tiny_spec) is tiny_spec
    assert type(build_model(tiny_spec)) is BEVUNet


def test_what_there_is_not_is_named():
    with pytest.raises(ValueError, match=r"unknown preset 'huge'; presets are: fast, paper, unet"):
        build_model("huge")
    with pytest.raises(ValueError, match=r"architecture must be one of .*, got 'gan'"):
        ModelSpec("gan", BEVUNetConfig())
    with pytest.raises(ValueError, match="'bev_unet' takes a BEVUNetConfig, got ImageUNetConfig"):
        ModelSpec("bev_unet", ImageUNetConfig())
    with pytest.raises(ValueError, match="unknown architecture 'gan'"):
        ModelSpec.from_json({"architecture": "gan", "config": {}})
