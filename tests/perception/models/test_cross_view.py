"""``CrossView``: what the attention looks at before any training."""

import numpy as np
import pytest
import torch

from bev_driving_env.cameras.rig import SURROUND, CameraRig, project
from bev_driving_env.frames import BEVGeometry
from perception.models.cross_view import Bottleneck, CrossView, start_temperature
from perception.models.position import bev_cells

RIG = CameraRig(SURROUND, (112, 240))
STRIDE, DIM = 8, 128
FEATURE = (112 // STRIDE, 240 // STRIDE)
CELLS = bev_cells(BEVGeometry(), 24, "centres")


def cross_view(positions, grids="centres"):
    torch.manual_seed(0)
    return CrossView(
        FEATURE,
        16,
        RIG.size,
        CELLS,
        heads=4,
        head_dim=DIM // 4,
        positions=positions,
        grids=grids,
    ).eval()


def given():
    """A random BEV state and features, and the nominal rig."""
    torch.manual_seed(1)
    state, feature = torch.randn(1, DIM, 24, 24), torch.randn(4, 16, *FEATURE)
    extrinsics = torch.from_numpy(RIG.extrinsics())[None]
    return state, feature, torch.from_numpy(RIG.intrinsics())[None], torch.linalg.inv(extrinsics)


def pixels_off(block):
    """How far, in feature pixels, each head's heaviest key is from where the cell is seen.

    Only cells that exactly one camera sees: there is one answer.
    """
    with torch.no_grad():
        weights = block.weights(*given())[0]  # (H, Q, N, K)
    heads = weights.flatten(2).argmax(-1).numpy()
    camera, key = np.divmod(heads, FEATURE[0] * FEATURE[1])  # (H, Q)
    looked_at = block.pixels.numpy()[key]
    ground = np.concatenate([CELLS.numpy(), np.zeros((len(CELLS), 1))], 1)
    seen = []
    for intrinsics, extrinsics in zip(RIG.intrinsics(), RIG.extrinsics(), strict=True):
        uv, _ = project(intrinsics, extrinsics, ground)
        inside = (uv >= 0.0).all(1) & (uv[:, 0] <= 239.0) & (uv[:, 1] <= 111.0)
        seen.append(np.where(inside[:, None], uv, np.nan))
    seen = np.stack(seen)  # (N, Q, 2)
    once = np.isfinite(seen[..., 0]).sum(0) == 1
    assert once.sum() > 200
    shown_by = np.isfinite(seen[..., 0]).argmax(0)
    where = np.take_along_axis(seen, shown_by[None, :, None], 0)[0]
    distance = np.linalg.norm(looked_at - where, axis=-1) / STRIDE
    distance[camera != shown_by] = np.inf
    return distance[:, once]


@pytest.mark.parametrize(("positions", "median_px"), [("tied", 1.5), ("fourier", 0.6)])
@pytest.mark.parametrize("grids", ["centres", "endpoints"])
def test_tied_a_cell_attends_to_the_pixel_that_sees_it(positions, median_px, grids):
    off = pixels_off(cross_view(positions, grids))
    assert np.median(off) < median_px
    assert (off < 3.0).mean() > 0.85


def test_independent_a_cell_attends_anywhere():
    assert np.median(pixels_off(cross_view("independent"))) > 5.0


def test_weights_are_those_that_the_output_is_made_with():
    block = cross_view("tied")
    with torch.no_grad():
        state, feature, intrinsics, pose = given()
        weights = block.weights(state, feature, intrinsics, pose)
        value = block.to_v(block.value_feature(feature).flatten(2).transpose(1, 2))  # (N, K, C)
        heads = value.unflatten(-1, (4, 32))
        seen = torch.einsum("bhqnk,nkhd->bqhd", weights, heads).flatten(2)
        tokens = state.flatten(2).transpose(1, 2) + block.proj(seen)
        tokens = block.prenorm(tokens)
        tokens = block.postnorm(tokens + block.mlp(tokens))
        out = block(state, feature, intrinsics, pose)
    torch.testing.assert_close(out.flatten(2).transpose(1, 2), tokens, rtol=0, atol=1e-5)


def test_denser_keys_start_sharper():
    assert start_temperature("tied", 16) == pytest.approx(60.0)
    assert start_temperature("tied", 8) == pytest.approx(96.0)
    assert start_temperature("fourier", 8) == start_temperature("fourier", 16)


def test_a_bottleneck_is_a_quarter_as_wide_inside():
    assert sum(p.numel() for p in Bottleneck(128).parameters()) * 2 == 35_584


@pytest.mark.parametrize("positions", ["independent", "fourier"])
@pytest.mark.parametrize("change", ["nothing", "weights", "rig"])
def test_positions_kept_between_frames_follow_weights_and_rig(positions, change):
    block = cross_view(positions)
    state, feature, intrinsics, pose = given()
    with torch.inference_mode():
        first = block(state, feature, intrinsics, pose)
    if change == "weights":
        torch.manual_seed(2)
        weights = {name: torch.randn_like(w) for name, w in block.position.state_dict().items()}
        block.position.load_state_dict(weights)
    elif change == "rig":
        pose = pose.clone()
        pose[0, 0, 2, 3] += 1.0
    with torch.inference_mode():
        again = block(state, feature, intrinsics, pose)
    with torch.no_grad():
        expected = block(state, feature, intrinsics, pose)  # works everything out anew
    torch.testing.assert_close(again, expected, rtol=0, atol=0)
    assert torch.equal(again, first) == (change == "nothing")


def test_training_works_positions_out_at_every_step():
    block = cross_view("fourier")
    with torch.inference_mode():
        block(*given())
    block(*given()).sum().backward()
    assert block.position.bev_embed.weight.grad.abs().sum() > 0.0
