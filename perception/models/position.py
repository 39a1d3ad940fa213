"""Camera-aware positional embedding: where pixels and BEV cells are, as unit vectors.

Zhou and Kraehenbuehl, "Cross-View Transformers", CVPR 2022, section 3.1. A pixel is embedded by
the point at depth 1 on its ray, a BEV cell by its place on the ground, both minus the camera's
centre, in one of three ways:

* ``independent``: three linear maps with unrelated random starts, as published. Training has to
  find out which pixel looks at which cell.
* ``tied``: the same maps and as free to train, but started as one and the same map, so that pixel
  and cell have the same embedding where the one looks at the other.
* ``fourier``: cosines and sines of multiples of the viewing direction's azimuth and elevation
  before a linear map, which resolves far ground that a linear map of the direction blurs.

Frames: ego x forward, y left, z up; image columns u and rows v; extrinsics are camera_from_ego.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from bev_driving_env.frames import BEVGeometry

GRIDS = ("endpoints", "centres")
Z_STRETCH = 4.0
"""The tied map stretches heights: cameras at 2 m see far ground under nearly equal angles."""
TIED_SCALE = 10.0
"""Normalisation takes it out again, but optimisers' steps count for less."""
AZIMUTHS = (1, 2, 4, 8, 16)
ELEVATIONS = (1, 2, 4, 8, 16, 32)
FOURIER = 2 * (len(AZIMUTHS) + len(ELEVATIONS))


def grid_points(cells: tuple[int, int], size: tuple[int, int], grids: str) -> Tensor:
    """Pixel coordinates (rows * columns, 2) as (u, v) of a grid laid over an image.

    Args:
        cells: Rows and columns of the grid.
        size: Height and width of the image.
        grids: ``"endpoints"`` spreads them from 0 to the full width and height, both included, as
            published; ``"centres"`` puts each in the middle of the pixels that it stands for.

    >>> grid_points((1, 3), (8, 24), "endpoints")[:, 0].tolist()
    [0.0, 12.0, 24.0]
    >>> grid_points((1, 3), (8, 24), "centres")[:, 0].tolist()
    [3.5, 11.5, 19.5]
    """
    axes = []
    for count, side in zip(cells, size, strict=True):
        if grids == "endpoints":
            axes.append(torch.linspace(0.0, 1.0, count, dtype=torch.float64) * side)
        else:
            axes.append((torch.arange(count, dtype=torch.float64) + 0.5) * (side / count) - 0.5)
    v, u = torch.meshgrid(*axes, indexing="ij")
    return torch.stack([u, v], -1).reshape(-1, 2).float()


def bev_cells(geometry: BEVGeometry, cells: int, grids: str) -> Tensor:
    """Ego-frame places (cells * cells, 2) in metres of a coarse grid over the BEV."""
    pixels = grid_points((cells, cells), (geometry.size, geometry.size), grids)
    return torch.from_numpy(geometry.ego_from_pixel(pixels.numpy()).astype(np.float32))


def unproject(pixels: Tensor, intrinsics: Tensor, ego_from_camera: Tensor) -> Tensor:
    """Ego-frame points at depth 1 on the rays of pixels.

    Args:
        pixels: (K, 2) as (u, v).
        intrinsics: (..., 3, 3).
        ego_from_camera: (..., 4, 4).

    Returns:
        (..., K, 4), homogeneous.
    """
    rays = torch.nn.functional.pad(pixels, (0, 1), value=1.0)  # (K, 3)
    points = rays @ torch.linalg.inv(intrinsics).transpose(-1, -2)  # (..., K, 3)
    points = torch.nn.functional.pad(points, (0, 1), value=1.0)
    return points @ ego_from_camera.transpose(-1, -2)


def direction_code(directions: Tensor) -> Tensor:
    """Fourier code (..., 22) of ego-frame directions (..., 3) of any length.

    The scalar product of two codes is a sum of cosines of multiples of their differences in
    azimuth and elevation, so its exponential is a product of kernels in either.
    """
    x, y, z = directions.unbind(-1)
    azimuth = torch.atan2(y, x).unsqueeze(-1)
    elevation = torch.atan2(z, torch.hypot(x, y)).unsqueeze(-1)
    angles = torch.cat(
        [azimuth * azimuth.new_tensor(AZIMUTHS), elevation * elevation.new_tensor(ELEVATIONS)], -1
    )
    return torch.cat([angles.cos(), angles.sin()], -1)


def orthonormal_heads(inputs: int, heads: int, head_dim: int) -> Tensor:
    """A random map (heads * head_dim, inputs) whose block per head keeps scalar products.

    Columns of each block are orthonormal and of zero mean, so layer normalisation, which takes
    the mean away, leaves them alone.
    """
    blocks = []
    for _ in range(heads):
        block = torch.randn(head_dim, inputs, dtype=torch.float64)
        blocks.append(torch.linalg.qr(block - block.mean(0)).Q)
    return torch.cat(blocks).float()


class LinearPosition(nn.Module):
    """Linear maps of points, cells and the camera's centre, as published.

    Args:
        heads: Heads of the attention.
        head_dim: Channels of each.
        tied: Whether the maps start as one.
    """

    def __init__(self, heads: int, head_dim: int, *, tied: bool) -> None:
        super().__init__()
        dim = heads * head_dim
        self.bev_embed = nn.Linear(2, dim)
        self.img_embed = nn.Linear(4, dim, bias=False)
        self.cam_embed = nn.Linear(4, dim, bias=False)
        if tied:
            stretch = torch.tensor([1.0, 1.0, Z_STRETCH]) * TIED_SCALE
            block = orthonormal_heads(3, heads, head_dim) * stretch
            with torch.no_grad():
                shift = self.bev_embed.bias
                for embed in (self.img_embed, self.cam_embed):
                    embed.weight.copy_(torch.cat([block, shift[:, None]], 1))
                self.bev_embed.weight.copy_(block[:, :2])

    def forward(self, points: Tensor, centres: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """Embeddings of pixels and cells.

        Args:
            points: (B, N, K, 4) on the pixels' rays, ego frame.
            centres: (B, N, 4) of the cameras.
            cells: (Q, 2) on the ground.

        Returns:
            Unit vectors of pixels (B, N, K, C), and of cells as seen by each camera (B, N, Q, C).
        """
        centre = self.cam_embed(centres).unsqueeze(2)  # (B, N, 1, C)
        return unit(self.img_embed(points) - centre), unit(self.bev_embed(cells) - centre)


class FourierPosition(nn.Module):
    """Linear maps of the Fourier code of viewing directions, started as one map.

    Args:
        heads: Heads of the attention.
        head_dim: Channels of each, more than the code's 22.
    """

    def __init__(self, heads: int, head_dim: int) -> None:
        super().__init__()
        dim = heads * head_dim
        block = TIED_SCALE * orthonormal_heads(FOURIER, heads, head_dim)
        self.bev_embed = nn.Linear(FOURIER, dim, bias=False)
        self.img_embed = nn.Linear(FOURIER, dim, bias=False)
        with torch.no_grad():
            self.bev_embed.weight.copy_(block)
            self.img_embed.weight.copy_(block)

    def forward(self, points: Tensor, centres: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
        """As :meth:`LinearPosition.forward`."""
        centre = centres[..., None, :3]  # (B, N, 1, 3)
        ground = torch.nn.functional.pad(cells, (0, 1))  # (Q, 3)
        of_pixels = self.img_embed(direction_code(points[..., :3] - centre))
        return unit(of_pixels), unit(self.bev_embed(direction_code(ground - centre)))


def unit(vectors: Tensor) -> Tensor:
    """Vectors over their length; the zero vector stays."""
    return vectors / (vectors.norm(dim=-1, keepdim=True) + 1e-7)
