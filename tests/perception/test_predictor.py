"""A trained network as a BEV source."""

import dataclasses
import pickle

import numpy as np
import pytest
import torch

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.frames import CHANNELS
from bev_driving_env.logs.order import open_logs
from bev_driving_env.sources.protocol import BatchedBEVSource, BEVSource, BEVSourceError
from bev_driving_env.vector_env import BEVTownVectorEnv
from perception.models.image_unet import ImageUNetConfig
from perception.models.presets import ModelSpec
from perception.predictor import CHUNK, ModelSource
from perception.samples import BEVSamples
from perception.weights import Predictor, WeightsError, save_predictor

THRESHOLDS = (0.3, 0.07, 0.03, 0.01, 0.007, 0.003)


@pytest.fixture(scope="module")
def predictor(tiny_spec):
    torch.manual_seed(5)
    model = tiny_spec.build()
    torch.nn.init.normal_(model.unet.head.weight, std=0.3)
    return Predictor(tiny_spec, model.eval(), THRESHOLDS, (112, 240), {})


@pytest.fixture(scope="module")
def frames(log_folder):
    (log,) = open_logs([log_folder])
    return [log.sensor_frame(index) for index in range(0, 3 * (CHUNK + 1), 3)]


def test_probabilities_are_those_of_the_network(predictor, frames, log_folder):
    source = ModelSource(predictor, "probabilities", "fp32")
    assert isinstance(source, BEVSource)
    assert isinstance(source, BatchedBEVSource)
    assert source.channels == CHANNELS
    bev = source(frames[1])
    sample = BEVSamples(open_logs([log_folder]), "all", predictor.model.needs)[(3, 0, False)]
    inputs = {name: torch.from_numpy(values)[None] for name, values in sample.inputs.items()}
    with torch.no_grad():
        wanted = torch.sigmoid(predictor.model(inputs))[0].numpy()
    assert bev.dtype == np.uint8
    assert np.abs(bev / 255.0 - wanted).max() <= 0.51 / 255.0
    assert len(np.unique(bev)) > 20


def test_masks_are_where_a_channel_reaches_its_threshold(predictor, frames):
    bev = ModelSource(predictor, "probabilities")(frames[0])
    masks = ModelSource(predictor)(frames[0])
    wanted = bev / 255.0 >= np.array(THRESHOLDS)[:, None, None]
    np.testing.assert_array_equal(masks, wanted * np.uint8(255))
    assert all(0 < plane.mean() < 255 for plane in masks[:3])


@pytest.mark.parametrize("level", range(1, 20))
def test_a_probability_on_the_threshold_is_occupied_whatever_the_rounding(level, predictor):
    thresholds = (level / 20.0,) * 6
    source = ModelSource(dataclasses.replace(predictor, thresholds=thresholds))
    least = -(-level * 255 // 20)  # in whole numbers, rounded up
    source.probabilities = lambda frames: np.full((1, 6, 2, 2), least, np.uint8)
    assert source.predict_batch([None]).min() == 255
    source.probabilities = lambda frames: np.full((1, 6, 2, 2), least - 1, np.uint8)
    assert source.predict_batch([None]).max() == 0


def test_a_batch_gives_what_single_frames_give(predictor, frames):
    source = ModelSource(predictor, "probabilities", "fp32")
    batch = source.predict_batch(frames)
    assert batch.shape == (CHUNK + 1, 6, 192, 192)
    singles = np.stack([source(frame) for frame in frames])
    # other sizes may be summed in another order: at most one 255th
    assert np.abs(batch.astype(int) - singles).max() <= 1
    assert (batch != singles).mean() < 1e-3


def test_nothing_is_remembered(predictor, frames):
    source = ModelSource(predictor, "probabilities", "fp32")
    first = source(frames[0])
    source(frames[5])
    source.reset()
    np.testing.assert_array_equal(source(frames[0]), first)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(source))(frames[0]), first)


def test_half_precision_is_near(predictor, frames):
    half = ModelSource(predictor, "probabilities", "bf16")(frames[0])
    full = ModelSource(predictor, "probabilities", "fp32")(frames[0])
    assert 0 < np.abs(half.astype(int) - full).max() < 20


def test_what_makes_no_sense_is_refused(predictor):
    with pytest.raises(ValueError, match="output must be one of masks, probabilities, got 'both'"):
        ModelSource(predictor, "both")
    with pytest.raises(ValueError, match="precision must be one of auto, fp32, bf16, got 'fp8'"):
        ModelSource(predictor, precision="fp8")


def test_an_env_drives_on_it(predictor):
    source = ModelSource(predictor, precision="fp32")
    with BEVTownEnv("Town02", bev_source=source) as env:
        observation, _ = env.reset(seed=0)
        assert observation["bev"].shape == (6, 192, 192)
        assert set(np.unique(observation["bev"])) == {0, 255}
        before = observation["bev"].copy()
        for _ in range(3):
            observation, *_ = env.step(np.array([1.0, 0.0], np.float32))
        assert (observation["bev"] != before).any()


def test_a_file_is_a_source(predictor, tmp_path):
    path = tmp_path / "tiny.safetensors"
    save_predictor(predictor, path)
    with BEVTownEnv("Town02", bev_source=str(path)) as env:
        from_file = env.reset(seed=0)[0]["bev"]
    with BEVTownEnv("Town02", bev_source=ModelSource(path)) as env:
        np.testing.assert_array_equal(env.reset(seed=0)[0]["bev"], from_file)
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ValueError, match=r"tiny\.safetensors.* is damaged or no safetensors"):
        BEVTownEnv("Town02", bev_source=str(path))
    with pytest.raises(WeightsError):
        ModelSource(path)


def test_channels_that_it_does_not_predict_are_empty(predictor):
    spec = predictor.spec.with_channels(("lane", "road"))
    torch.manual_seed(0)
    few = Predictor(spec, spec.build().eval(), (0.001, 0.001), (112, 240), {})
    with BEVTownEnv("Town02", bev_source=ModelSource(few)) as env:
        bev = env.reset(seed=0)[0]["bev"]
    assert [bool(plane.any()) for plane in bev] == [True, False, True, False, False, False]


def test_images_of_another_size_are_refused_with_the_cure(predictor):
    with (
        BEVTownEnv("Town02", bev_source=ModelSource(predictor), camera_size=(56, 120)) as env,
        pytest.raises(BEVSourceError, match=r"112 x 240 px, got 56 x 120: set camera_size=\(112"),
    ):
        env.reset(seed=0)


def test_a_network_that_does_not_look_takes_any_images(tiny_spec):
    fields = {**tiny_spec.as_json()["config"], "ground": False}
    spec = ModelSpec.from_json({"architecture": "bev_unet", "config": fields})
    blind = Predictor(spec, spec.build().eval(), (0.5,) * 6, (112, 240), {})
    with BEVTownEnv("Town02", bev_source=ModelSource(blind), camera_size=(56, 120)) as env:
        env.reset(seed=0)


def test_worlds_of_a_vector_env_are_predicted_together(predictor, monkeypatch):
    source = ModelSource(predictor, "probabilities", "fp32")
    sizes = []
    plain = source.predict_batch

    def noted(frames):
        sizes.append(len(frames))
        return plain(frames)

    monkeypatch.setattr(source, "predict_batch", noted)
    envs = BEVTownVectorEnv(3, "Town02", bev_source=source)
    observations, _ = envs.reset(seed=0)
    assert sizes == [3]
    assert len({plane.tobytes() for plane in observations["bev"]}) > 1
    envs.close()


def test_four_cameras_are_not_three(frames):
    small = ImageUNetConfig(widths=(4, 4), encoder_blocks=(0, 0), decoder_blocks=(0,), cameras=3)
    spec = ModelSpec("image_unet", small)
    source = ModelSource(Predictor(spec, spec.build().eval(), (0.5,) * 6, (112, 240), {}))
    with pytest.raises(ValueError, match="made for 3 cameras, got 4"):
        source(frames[0])
