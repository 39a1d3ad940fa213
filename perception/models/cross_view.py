"""Cross-view attention: BEV cells ask the pixels of all cameras.

Zhou and Kraehenbuehl, "Cross-View Transformers", CVPR 2022; details as in the published code,
``bradyz/cross_view_transformers``. The parts that are not theirs are temperature and gates, which
the tied embeddings of :mod:`perception.models.position` need to start as a geometric kernel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from .joint_attention import joint_attention, joint_weights
from .position import FourierPosition, LinearPosition, grid_points, unproject

Embeddings = tuple[Tensor, Tensor]

QUERY_GATE, KEY_GATE = 0.0074, 0.018
"""How much of the BEV state and of the image feature the tied embeddings start with; more would
drown positions, whose vectors have length 1."""
TEMPERATURE_TIED, TEMPERATURE_FOURIER = 60.0, 20.0


def start_temperature(positions: str, stride: int) -> float:
    """Factor on the cosine of query and key at the start.

    Weights should spread over a few keys: they interpolate, and have gradients. Linear positions
    need more where keys are denser, 96 at stride 8.
    """
    if positions == "fourier":
        return TEMPERATURE_FOURIER
    return TEMPERATURE_TIED * (16.0 / stride) ** math.log2(96.0 / 60.0)


class _Kept(NamedTuple):
    """Embeddings, and what they follow from; weights are held so that no other has their id."""

    key: object
    weights: tuple[nn.Parameter, ...]
    embeddings: Embeddings


class CrossView(nn.Module):
    """Cross-view attention at one scale of the images' features.

    Args:
        feature_size: Height and width of the features.
        feature_width: Their channels.
        image_size: Height and width of the images.
        cells: Ego-frame places (Q, 2) of the BEV state's cells, row by row.
        heads: Heads of the attention.
        head_dim: Channels of each; the BEV state has ``heads * head_dim``.
        positions: ``"independent"``, ``"tied"`` or ``"fourier"``.
        grids: Where in the image the pixels of a feature are, see ``position.grid_points``.
    """

    pixels: Tensor
    cells: Tensor

    def __init__(
        self,
        feature_size: tuple[int, int],
        feature_width: int,
        image_size: tuple[int, int],
        cells: Tensor,
        *,
        heads: int,
        head_dim: int,
        positions: str,
        grids: str,
    ) -> None:
        super().__init__()
        dim = heads * head_dim
        self.heads, self.head_dim = heads, head_dim
        self.scale = head_dim**-0.5
        # follow from the configuration, so they are no part of the weights
        self.register_buffer(
            "pixels", grid_points(feature_size, image_size, grids), persistent=False
        )
        self.register_buffer("cells", cells, persistent=False)
        self._kept: _Kept | None = None
        self.position: LinearPosition | FourierPosition
        if positions == "fourier":
            self.position = FourierPosition(heads, head_dim)
        else:
            self.position = LinearPosition(heads, head_dim, tied=positions == "tied")
        self.key_feature = _projection(feature_width, dim)
        self.value_feature = _projection(feature_width, dim)
        self.to_q, self.to_k, self.to_v = (
            nn.Sequential(nn.LayerNorm(dim), nn.Linear(dim, dim)) for _ in range(3)
        )
        self.proj = nn.Linear(dim, dim)
        self.prenorm = nn.LayerNorm(dim)
        self.mlp = nn.Sequential(nn.Linear(dim, 2 * dim), nn.GELU(), nn.Linear(2 * dim, dim))
        self.postnorm = nn.LayerNorm(dim)
        self.geometric = positions != "independent"
        if self.geometric:
            stride = image_size[0] // feature_size[0]
            warmth = math.log(start_temperature(positions, stride))
            self.log_temperature = nn.Parameter(torch.full((heads,), warmth))
            self.log_query_gate = nn.Parameter(torch.tensor(math.log(QUERY_GATE)))
            self.log_key_gate = nn.Parameter(torch.tensor(math.log(KEY_GATE)))
            for projection in (self.to_q, self.to_k):
                nn.init.eye_(projection[1].weight)  # type: ignore[arg-type]
                nn.init.zeros_(projection[1].bias)  # type: ignore[arg-type]

    def forward(
        self, state: Tensor, feature: Tensor, intrinsics: Tensor, ego_from_camera: Tensor
    ) -> Tensor:
        """Refine the BEV state by what the cameras show.

        Args:
            state: (B, C, S, S).
            feature: (B * N, F, h, w).
            intrinsics: (B, N, 3, 3), or (1, ...) if all samples share them.
            ego_from_camera: (B, N, 4, 4), or (1, ...).

        Returns:
            (B, C, S, S).
        """
        tokens = state.flatten(2).transpose(1, 2)  # (B, Q, C)
        query, key = self.queries_and_keys(tokens, feature, intrinsics, ego_from_camera)
        value = self._split(self.to_v(_tokens(self.value_feature(feature), len(state))))
        seen = joint_attention(query, key, value, self.scale)  # (B, H, Q, D)
        tokens = tokens + self.proj(seen.transpose(1, 2).flatten(2))
        tokens = self.prenorm(tokens)
        tokens = self.postnorm(tokens + self.mlp(tokens))
        return tokens.transpose(1, 2).reshape(state.shape)

    def weights(
        self, state: Tensor, feature: Tensor, intrinsics: Tensor, ego_from_camera: Tensor
    ) -> Tensor:
        """Weights (B, H, Q, N, h * w) of the attention that :meth:`forward` pays."""
        tokens = state.flatten(2).transpose(1, 2)
        query, key = self.queries_and_keys(tokens, feature, intrinsics, ego_from_camera)
        weights = joint_weights(query, key, self.scale)
        return weights.reshape(*weights.shape[:3], intrinsics.shape[1], -1)

    def queries_and_keys(
        self, tokens: Tensor, feature: Tensor, intrinsics: Tensor, ego_from_camera: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Queries (B, N, H, Q, D) and keys (B, N, H, K, D); ``scale`` times products are logits."""
        of_pixels, of_cells = self._kept_positions(intrinsics, ego_from_camera)
        state = tokens.unsqueeze(1)  # (B, 1, Q, C)
        content = _tokens(self.key_feature(feature), len(tokens))  # (B, N, K, C)
        if self.geometric:
            state = state * self.log_query_gate.exp()
            content = content * self.log_key_gate.exp()
        key = self._split(self.to_k(of_pixels + content))
        return self._split(self._query(of_cells + state)), key

    def _kept_positions(self, intrinsics: Tensor, ego_from_camera: Tensor) -> Embeddings:
        """``_positions``; those of the last rig are kept while nothing is learned."""
        if not torch.is_inference_mode_enabled() or self.position.bev_embed.weight.is_inference():
            return self._positions(intrinsics, ego_from_camera)
        # weights may be loaded or moved between two calls
        weights = tuple(self.position.parameters())
        states = [(id(weight), weight._version, weight.dtype) for weight in weights]
        rig = [tensor.numpy(force=True).tobytes() for tensor in (intrinsics, ego_from_camera)]
        key = (states, rig, intrinsics.shape, self.cells.device)
        if self._kept is None or self._kept.key != key:
            embeddings = self._positions(intrinsics, ego_from_camera)
            self._kept = _Kept(key, weights, embeddings)
        return self._kept.embeddings

    def _positions(self, intrinsics: Tensor, ego_from_camera: Tensor) -> Embeddings:
        """Embeddings of pixels (B, N, K, C) and of cells (B, N, Q, C)."""
        # bfloat16 would lose the pixel among its neighbours
        with torch.autocast(self.cells.device.type, enabled=False):
            return self.position(
                unproject(self.pixels, intrinsics, ego_from_camera),
                ego_from_camera[..., 3],
                self.cells,
            )

    def _query(self, cells: Tensor) -> Tensor:
        """Queries (B, N, Q, C), as warm as the temperature says."""
        if not self.geometric:
            return self.to_q(cells)
        norm, linear = self.to_q
        # layer normalisation gives each head a squared length of head_dim; the logits' scale
        # takes out one root of it. Scaling weights is cheaper than scaling queries.
        warmth = self.log_temperature.exp() * self.scale
        rows = warmth.repeat_interleave(self.head_dim)  # (C,)
        weight, bias = linear.weight * rows[:, None], linear.bias * rows
        return nn.functional.linear(norm(cells), weight, bias)

    def _split(self, tokens: Tensor) -> Tensor:
        """(B, N, L, C) to (B, N, H, L, D)."""
        heads = tokens.reshape(*tokens.shape[:-1], self.heads, self.head_dim)
        return heads.transpose(2, 3)


class Bottleneck(nn.Module):
    """ResNet bottleneck: 1x1, 3x3 and 1x1 convolutions beside a skip.

    Args:
        width: Channels in and out; a quarter of them in between.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        narrow = width // 4
        self.residual = nn.Sequential(
            nn.Conv2d(width, narrow, 1, bias=False),
            nn.BatchNorm2d(narrow),
            nn.ReLU(),
            nn.Conv2d(narrow, narrow, 3, padding=1, bias=False),
            nn.BatchNorm2d(narrow),
            nn.ReLU(),
            nn.Conv2d(narrow, width, 1, bias=False),
            nn.BatchNorm2d(width),
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, width, H, W) to the same shape."""
        return nn.functional.relu(x + self.residual(x))


def _projection(width_in: int, width_out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.BatchNorm2d(width_in), nn.ReLU(), nn.Conv2d(width_in, width_out, 1, bias=False)
    )


def _tokens(feature: Tensor, batch: int) -> Tensor:
    """(B * N, C, h, w) to (B, N, h * w, C)."""
    tokens = feature.flatten(2).transpose(1, 2)
    return tokens.reshape(batch, -1, *tokens.shape[1:])
