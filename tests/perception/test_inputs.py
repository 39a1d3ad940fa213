"""What networks are given, and its mirror image."""

import numpy as np
import pytest
import torch

from bev_driving_env.cameras.rig import SURROUND, Camera, CameraRig, project
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.sources.ipm_ground import GroundView
from bev_driving_env.sources.protocol import SensorFrame
from perception.inputs import (
    NEEDS,
    SURROUND_ORDER,
    FrameInputs,
    collated,
    mirror_order,
    mirrored,
)

SMALL = BEVGeometry(size=96, px_per_m=2.5, ego_row=76)
# nothing about this camera is symmetric
ODD = Camera("odd", x_m=0.7, y_m=0.4, yaw_deg=25.0, pitch_deg=12.0, roll_deg=6.0, fov_deg=80.0)


def frame_of(rig, seed=0, geometry=SMALL):
    rng = np.random.default_rng(seed)
    route_map = rng.integers(256, size=(geometry.size, geometry.size), dtype=np.uint8)
    images = rng.integers(1, 256, size=rig.shape, dtype=np.uint8)
    measured = np.zeros(3, np.float32)
    return SensorFrame(images, rig.intrinsics(), rig.extrinsics(), route_map, measured)


def test_a_network_gets_what_it_needs_and_nothing_else():
    frame = frame_of(CameraRig())
    for needs in ({"route_map"}, {"images", "extrinsics"}, set(NEEDS)):
        assert set(FrameInputs(needs, SMALL)(frame)) == needs
    inputs = FrameInputs(NEEDS, SMALL)(frame)
    for name in ("images", "intrinsics", "extrinsics", "route_map"):
        assert inputs[name] is getattr(frame, name)
    assert not FrameInputs({"route_map"}).looks


@pytest.mark.parametrize("needs", [{"route_map", "depth"}, set()])
def test_what_nobody_has_is_refused(needs):
    with pytest.raises(ValueError, match="one or more of images, intrinsics, extrinsics"):
        FrameInputs(needs)


def test_the_ground_is_that_of_the_rig_at_hand():
    inputs = FrameInputs({"ground"}, SMALL)
    for rig in (CameraRig(), CameraRig(SURROUND[:1]), CameraRig(size=(56, 120)), CameraRig()):
        frame = frame_of(rig)
        view = GroundView(SMALL, frame.intrinsics, frame.extrinsics, rig.size)
        np.testing.assert_array_equal(inputs(frame)["ground"], view.project(frame.images))


def test_a_point_shows_in_the_mirrored_pixel():
    rig = CameraRig((ODD,), (90, 160))
    frame = frame_of(rig)
    inputs = {name: getattr(frame, name) for name in ("images", "intrinsics", "extrinsics")}
    inputs["intrinsics"] = inputs["intrinsics"] + np.float32([[[0, 3, 7], [0, 0, -2], [0, 0, 0]]])
    made, _ = mirrored(inputs, np.zeros((6, 96, 96), np.uint8), order=(0,))
    points = np.random.default_rng(1).uniform([4, -3, 0], [20, 8, 2], (50, 3))
    before, depth = project(inputs["intrinsics"][0], inputs["extrinsics"][0], points)
    after, depth_after = project(
        made["intrinsics"][0], made["extrinsics"][0], points * [1.0, -1.0, 1.0]
    )
    np.testing.assert_allclose(after[:, 0], 159.0 - before[:, 0], atol=1e-3)
    np.testing.assert_allclose(after[:, 1], before[:, 1], atol=1e-3)
    np.testing.assert_allclose(depth_after, depth, atol=1e-5)
    rotation = made["extrinsics"][0, :3, :3]
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_array_equal(made["images"][0, :, 159 - 31], frame.images[0, :, 31])


def test_a_symmetric_rig_stays_as_it_is():
    frame = frame_of(CameraRig())
    inputs = FrameInputs(NEEDS, SMALL)(frame)
    made, _ = mirrored(inputs, np.zeros((6, 96, 96), np.uint8))
    np.testing.assert_allclose(made["extrinsics"], frame.extrinsics, atol=1e-6)
    np.testing.assert_array_equal(made["intrinsics"], frame.intrinsics)
    np.testing.assert_array_equal(made["images"][1], frame.images[2][:, ::-1])
    assert [made[name].dtype for name in made] == [inputs[name].dtype for name in made]


def test_the_mirrored_ground_is_what_the_mirrored_images_show():
    rig = CameraRig()
    frame = frame_of(rig)
    smooth = np.add.outer(2 * np.arange(112), np.arange(240)) // 4
    images = np.stack([np.roll(smooth, 40 * k, axis=1) for k in range(4)]).astype(np.uint8) + 1
    images = np.repeat(images[..., None], 3, axis=-1)
    view = GroundView(SMALL, frame.intrinsics, frame.extrinsics, rig.size)
    ground = view.project(images)
    made, _ = mirrored({"images": images, "ground": ground}, np.zeros((6, 96, 96), np.uint8))
    shown = view.project(made["images"])
    differ = np.abs(shown.astype(int) - made["ground"].astype(int)).max(axis=-1) > 2
    # where two cameras see a cell equally well, either is asked
    assert differ[:, 1:].mean() < 0.01
    assert (made["ground"][:, 0] == made["ground"][:, 1]).all()


def test_the_car_and_every_cell_keep_their_distance_in_the_mirror():
    rng = np.random.default_rng(0)
    route_map = rng.integers(256, size=(96, 96), dtype=np.uint8)
    target = rng.integers(256, size=(6, 96, 96), dtype=np.uint8)
    made, turned = mirrored({"route_map": route_map}, target)
    left = SMALL.ego_from_pixel(np.stack([np.arange(96), np.zeros(96)], axis=-1))[:, 1]
    for column in range(1, 96):
        other = int(np.flatnonzero(left == -left[column])[0])
        np.testing.assert_array_equal(made["route_map"][:, column], route_map[:, other])
        np.testing.assert_array_equal(turned[..., column], target[..., other])
    again, back = mirrored(made, turned)
    np.testing.assert_array_equal(again["route_map"][:, 1:], route_map[:, 1:])
    np.testing.assert_array_equal(back[..., 1:], target[..., 1:])


def test_only_cameras_of_a_symmetric_rig_change_places():
    assert mirror_order(CameraRig().extrinsics()) == SURROUND_ORDER
    turned = (SURROUND[3], SURROUND[2], SURROUND[0], SURROUND[1])
    assert mirror_order(CameraRig(turned).extrinsics()) == (0, 3, 2, 1)
    assert mirror_order(CameraRig((*SURROUND, ODD)).extrinsics()) == (0, 1, 2, 3, 4)
    assert mirror_order(CameraRig(SURROUND[:2]).extrinsics()) == (0, 1)


def test_intrinsics_need_the_width_of_the_images():
    with pytest.raises(ValueError, match="without images"):
        mirrored({"intrinsics": CameraRig().intrinsics()}, np.zeros((6, 96, 96), np.uint8))


def test_samples_are_collated_in_their_order_and_copied():
    frames = [frame_of(CameraRig(size=(16, 24)), seed) for seed in range(3)]
    samples = [FrameInputs(NEEDS, SMALL)(frame) for frame in frames]
    batch = collated(samples)
    assert batch["images"].shape == (3, 4, 16, 24, 3)
    assert batch["intrinsics"].dtype == torch.float32
    assert batch["ground"].dtype == torch.uint8
    frames[1].route_map[:] = 0
    assert batch["route_map"][1].any()
    np.testing.assert_array_equal(batch["route_map"][2].numpy(), frames[2].route_map)


def test_what_all_samples_share_of_a_rig_is_there_once():
    frames = [frame_of(CameraRig(size=(16, 24)), seed) for seed in range(3)]
    samples = [FrameInputs(NEEDS, SMALL)(frame) for frame in frames]
    batch = collated(samples)
    np.testing.assert_array_equal(batch["intrinsics"].numpy(), frames[0].intrinsics[None])
    samples[2]["extrinsics"] = samples[2]["extrinsics"] + np.float32(0.1)
    batch = collated(samples)
    assert (batch["intrinsics"].shape, batch["extrinsics"].shape) == ((1, 4, 3, 3), (3, 4, 4, 4))
    np.testing.assert_array_equal(batch["extrinsics"][2].numpy(), samples[2]["extrinsics"])
