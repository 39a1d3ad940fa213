"""Samples from logs: what is in them."""

import numpy as np
import pytest
import torch

from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.randomisation import randomised_look
from bev_driving_env.cameras.rig import CameraRig
from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.order import open_logs
from bev_driving_env.sources.ipm_ground import GroundView
from perception.inputs import mirrored
from perception.samples import BEVSamples, packed, unpacked

NEEDS = frozenset({"ground", "route_map"})


@pytest.fixture(scope="module")
def logs(log_folder):
    return open_logs([log_folder])


@pytest.fixture(scope="module")
def samples(logs):
    return BEVSamples(logs, "train", NEEDS, looks="random")


def test_packing_is_undone():
    bev = np.random.default_rng(0).choice([0, 255], (6, 32, 24)).astype(np.uint8)
    assert packed(bev).shape == (6, 32, 3)
    assert torch.equal(unpacked(torch.from_numpy(packed(bev))), torch.from_numpy(bev))
    with pytest.raises(ValueError, match="multiple of 8 px, got 20"):
        packed(bev[..., :20])


def test_a_sample_holds_the_truth_and_what_the_drive_looked_like(logs):
    log = logs[0]
    samples = BEVSamples(logs, "train", {"images", "ground", "route_map"})
    sample = samples[(7, 99, False)]
    index = int(log.indices("train")[7])
    np.testing.assert_array_equal(unpacked(torch.from_numpy(sample.bits)).numpy(), log.bev(index))
    np.testing.assert_array_equal(sample.inputs["images"], log.images(index))
    np.testing.assert_array_equal(sample.inputs["route_map"], log.route_map(index))
    rig = CameraRig()
    view = GroundView(log.geometry, rig.intrinsics(), rig.extrinsics(), rig.size)
    np.testing.assert_array_equal(sample.inputs["ground"], view.project(log.images(index)))
    assert samples.locate(7) == (log, index)
    np.testing.assert_array_equal(samples.actions(), log.actions(log.indices("train")))


def test_a_look_of_its_own_changes_the_images_and_nothing_else(logs, samples):
    plain = BEVSamples(logs, "train", {"images"}, looks="log")
    random = BEVSamples(logs, "train", {"images"}, looks="random")
    index = int(logs[0].indices("train")[3])
    wanted = logs[0].images(index, look=draw_look("train", 41))
    np.testing.assert_array_equal(random[(3, 41, False)].inputs["images"], wanted)
    assert (random[(3, 42, False)].inputs["images"] != wanted).mean() > 0.5
    assert (plain[(3, 41, False)].inputs["images"] != wanted).mean() > 0.5
    a, b = samples[(3, 41, False)], samples[(3, 42, False)]
    np.testing.assert_array_equal(a.bits, b.bits)
    np.testing.assert_array_equal(a.inputs["route_map"], b.inputs["route_map"])


def test_a_wild_look_is_drawn_from_the_same_seed(logs):
    wild = BEVSamples(logs, "train", {"images"}, looks="wild")
    index = int(logs[0].indices("train")[3])
    wanted = logs[0].images(index, look=randomised_look(41))
    np.testing.assert_array_equal(wild[(3, 41, False)].inputs["images"], wanted)


def test_a_flipped_sample_is_the_mirror_image(samples):
    plain, flipped = samples[(5, 1, False)], samples[(5, 1, True)]
    bev = unpacked(torch.from_numpy(plain.bits)).numpy()
    inputs, turned = mirrored(plain.inputs, bev)
    np.testing.assert_array_equal(flipped.bits, packed(turned))
    for name in NEEDS:
        np.testing.assert_array_equal(flipped.inputs[name], inputs[name])
    assert (flipped.bits != plain.bits).any()


def test_a_network_that_sees_the_map_alone_makes_nobody_look(logs, monkeypatch):
    def refuse(*_):
        raise AssertionError("the cameras were rendered")

    monkeypatch.setattr(logs[0], "images", refuse)
    sample = BEVSamples(logs, "val", {"route_map"}, looks="random")[(0, 1, True)]
    assert set(sample.inputs) == {"route_map"}
    with pytest.raises(AssertionError, match="rendered"):
        BEVSamples(logs, "val", {"ground"})[(0, 1, True)]


def test_other_cameras_can_be_asked_for(logs):
    samples = BEVSamples(logs, "val", {"images"}, rig=CameraRig(size=(56, 120)))
    assert samples[(0, 0, True)].inputs["images"].shape == (4, 56, 120, 3)


def test_several_logs_make_one_set(logs):
    one, two = BEVSamples(logs, "train", NEEDS), BEVSamples([*logs, *logs], "train", NEEDS)
    assert len(two) == 2 * len(one) == len(two.actions())
    assert two.locate(len(one) + 4) == one.locate(4)


def test_no_network_is_trained_on_looks_for_testing(log_folder, monkeypatch):
    logs = open_logs([log_folder])
    for held_out in ("test", "hard", "test:clear", "hard:night"):
        changed = {**logs[0].header.settings, "appearance": held_out}
        monkeypatch.setitem(vars(logs[0].header), "settings", changed)
        logs[0].__dict__.pop("camera_settings", None)
        with pytest.raises(ValueError, match=f"{held_out}.*kept for testing"):
            BEVSamples(logs, "train", NEEDS)
        assert len(BEVSamples(logs, "val", NEEDS)) == 30
        random = BEVSamples(logs, "train", {"images"}, looks="random")
        wanted = open_logs([log_folder])[0].images(30, look=draw_look("train", 8))
        np.testing.assert_array_equal(random[(0, 8, False)].inputs["images"], wanted)


def test_what_makes_no_sense_is_refused(logs):
    with pytest.raises(ValueError, match="looks must be one of log, random, wild, got 'any'"):
        BEVSamples(logs, "train", NEEDS, looks="any")
    with pytest.raises(LogError, match="no sample of split 'train'"):
        BEVSamples([], "train", NEEDS)
