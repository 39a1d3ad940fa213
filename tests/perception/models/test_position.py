"""Positional embeddings: grids, rays, and starts that are tied to the geometry."""

import numpy as np
import pytest
import torch

from bev_driving_env.cameras.rig import SURROUND, CameraRig, ground_points, project
from bev_driving_env.frames import BEVGeometry
from perception.models.position import (
    FourierPosition,
    LinearPosition,
    bev_cells,
    direction_code,
    grid_points,
    orthonormal_heads,
    unproject,
)

RIG = CameraRig(SURROUND, (112, 240))
INTRINSICS = torch.from_numpy(RIG.intrinsics()).double()
EXTRINSICS = torch.from_numpy(RIG.extrinsics()).double()


def test_the_published_view_matrix_puts_the_ego_and_the_cells_where_our_geometry_does():
    h = w = 192
    scale, offset = w / 38.4, 56 / 192
    view = np.array([[0, -scale, w / 2], [-scale, 0, h * offset + h / 2], [0, 0, 1]])
    assert view @ [0, 0, 1] == pytest.approx([96, 152, 1])

    u, v = np.meshgrid(np.linspace(0, 1, 24) * w, np.linspace(0, 1, 24) * h)
    places = np.linalg.inv(view) @ np.stack([u, v, np.ones_like(u)]).reshape(3, -1)
    cells = bev_cells(BEVGeometry(), 24, "endpoints")
    np.testing.assert_allclose(cells.numpy(), places[:2].T, atol=1e-5)


def test_grids_of_the_image_plane_include_both_ends():
    grid = grid_points((14, 30), (112, 240), "endpoints").reshape(14, 30, 2)
    assert grid[0, 0].tolist() == [0.0, 0.0]
    assert grid[-1, -1].tolist() == [240.0, 112.0]
    assert grid[3, 7].tolist() == pytest.approx([7 / 29 * 240, 3 / 13 * 112])


def test_grids_of_centres_are_means_of_the_pixels_they_stand_for():
    pixels = torch.arange(32.0)
    grid = grid_points((4, 4), (32, 32), "centres").reshape(4, 4, 2)
    torch.testing.assert_close(grid[0, :, 0], pixels.reshape(4, 8).mean(1))
    torch.testing.assert_close(grid[:, 0, 1], pixels.reshape(4, 8).mean(1))


def test_points_of_pixels_lie_at_depth_1_on_their_rays():
    pixels = grid_points((5, 7), RIG.size, "endpoints").double()
    points = unproject(pixels, INTRINSICS, torch.linalg.inv(EXTRINSICS))  # (4, 35, 4)
    for number in range(4):
        seen, depth = project(INTRINSICS[number], EXTRINSICS[number], points[number, :, :3].numpy())
        np.testing.assert_allclose(seen, pixels.numpy(), atol=1e-9)
        np.testing.assert_allclose(depth, 1.0, atol=1e-12)
        np.testing.assert_allclose(points[number, :, 3], 1.0)


def ground_pairs(number):
    """Pixels of a camera that see the ground, and the places that they see."""
    pixels = grid_points((9, 11), RIG.size, "centres").numpy().astype(np.float64)
    places = ground_points(INTRINSICS[number], EXTRINSICS[number], pixels)[:, :2]
    near = np.isfinite(places).all(1) & (np.hypot(*places.T) < 40.0)
    assert near.sum() > 20
    return torch.from_numpy(pixels[near]), torch.from_numpy(places[near])


def cosines(position, number):
    """Of embeddings of pixels and of the very places that they see."""
    pixels, places = ground_pairs(number)
    ego_from_camera = torch.linalg.inv(EXTRINSICS[number])[None, None]
    points = unproject(pixels, INTRINSICS[number][None, None], ego_from_camera)
    with torch.no_grad():
        of_pixels, of_cells = position.double()(points, ego_from_camera[..., 3], places)
    torch.testing.assert_close(of_pixels.norm(dim=-1), torch.ones(1, 1, len(pixels)).double())
    return (of_pixels * of_cells).sum(-1)[0, 0]


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize(
    "position", [LinearPosition(2, 32, tied=True), FourierPosition(2, 32)], ids=["tied", "fourier"]
)
def test_tied_a_cell_has_the_embedding_of_the_pixel_that_sees_it(position, number):
    torch.testing.assert_close(
        cosines(position, number).min(), torch.tensor(1.0).double(), rtol=0, atol=1e-6
    )


def test_independent_embeddings_know_nothing_of_each_other():
    torch.manual_seed(0)
    assert cosines(LinearPosition(2, 32, tied=False), 0).max() < 0.9


def test_tied_maps_are_parameters_of_their_own():
    position = LinearPosition(1, 8, tied=True)
    with torch.no_grad():
        position.img_embed.weight.zero_()
    assert position.cam_embed.weight.abs().min() > 0.0
    assert sum(p.numel() for p in position.parameters()) == 8 * (4 + 4 + 2 + 1)


def test_maps_of_heads_keep_products_and_have_no_mean():
    torch.manual_seed(0)
    for block in orthonormal_heads(22, 3, 32).split(32):
        torch.testing.assert_close(block.T @ block, torch.eye(22), rtol=0, atol=1e-5)
        torch.testing.assert_close(block.sum(0), torch.zeros(22), rtol=0, atol=1e-5)


def test_codes_multiply_to_cosines_of_multiples_of_the_angles_between():
    azimuths, elevations = np.array([0.3, -2.0]), np.array([-0.4, 0.1])
    directions = np.stack(
        [
            np.cos(elevations) * np.cos(azimuths),
            np.cos(elevations) * np.sin(azimuths),
            np.sin(elevations),
        ],
        -1,
    )
    one, other = direction_code(torch.from_numpy(5.0 * directions))
    expected = sum(np.cos(m * 2.3) for m in (1, 2, 4, 8, 16))
    expected += sum(np.cos(m * 0.5) for m in (1, 2, 4, 8, 16, 32))
    assert float(one @ other) == pytest.approx(expected)
    assert len(one) == 22
