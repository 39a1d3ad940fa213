"""The loss of BEV segmentation: binary cross-entropy (BCE), per channel with or without Dice.

The paper's objective is the mean over samples of ``w_i l_i``, where ``l_i`` is the BCE averaged
over channels and pixels and ``w_i`` the sample's KDE weight (``bev_driving_env.training.kde``).
Channel weights and Dice come on top; with weights of 1 and ``"bce"`` alone it is the paper's.

On the CPU loss and gradient come from one pass of a kernel over logits and uint8 targets (in
PyTorch's own operations this takes a tenth of a small network's training step); elsewhere, and
for float64, from PyTorch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812 (PyTorch's own idiom)
from torch import Tensor

from .loss_kernel import bce_dice_planes
from .training_config import LOSSES

KINDS = LOSSES


def bev_loss(
    logits: Tensor,
    target: Tensor,
    sample_weights: Tensor | None = None,
    channel_weights: Tensor | None = None,
    kinds: str | Sequence[str] = "bce",
    dice_weight: float = 1.0,
) -> tuple[Tensor, Tensor]:
    """Weighted loss of a batch, and the plain loss of each channel.

    The loss of sample i in channel c is the mean BCE over pixels. For ``"bce_dice"``,
    ``dice_weight * (1 - (2 sum(p t) + 1) / (sum(p) + sum(t) + 1))`` is added, with probabilities p
    and target t in {0, 1}; not where the target holds nothing: there Dice would only want p to
    vanish, with a gradient far above that of BCE, which wants it, too. The batch's loss is the
    mean over samples and channels of weight times loss.

    Args:
        logits: (B, C, H, W) float; half precisions are widened to float32.
        target: (B, C, H, W) uint8: 0, or 255 where occupied.
        sample_weights: (B,), or (B, C) to weigh each channel's by something else; None: ones.
        channel_weights: (C,); None: ones. They are not normalised: 0 leaves a channel out, 2
            doubles its gradient.
        kinds: One of ``KINDS``, or one for each channel.
        dice_weight: What Dice counts beside BCE.

    Returns:
        The loss (scalar) and the unweighted means of the channels' losses (C,), detached; both
        float32 (float64 if the logits are).

    Raises:
        ValueError: Shapes that do not fit, another dtype, an unknown kind, or, on the CPU, masks
            that hold anything but 0 and 255.

    >>> logits, target = torch.zeros(2, 1, 4, 4), torch.zeros(2, 1, 4, 4, dtype=torch.uint8)
    >>> loss, channels = bev_loss(logits, target, sample_weights=torch.tensor([1.0, 3.0]))
    >>> round(loss.item(), 4), channels  # log(2), twice and once
    (1.3863, tensor([0.6931]))
    """
    _check_planes(logits, target)
    channels = logits.shape[1]
    weights = _weights(logits, sample_weights, channel_weights)  # (B, C)
    dice = _dice_weights(kinds, channels, dice_weight)  # (C,)
    if logits.device.type == "cpu" and logits.dtype != torch.float64:
        loss, planes = _KernelLoss.apply(logits, target, weights, dice)  # type: ignore[no-untyped-call]
    else:
        planes = _torch_planes(logits, target, dice)
        loss = (planes * weights).mean()
    return loss, planes.detach().mean(dim=0)


class _KernelLoss(torch.autograd.Function):
    """Loss () and planes' losses (B, C) with the gradient of the loss made on the way."""

    @staticmethod
    def forward(
        ctx: Any, logits: Tensor, target: Tensor, weights: Tensor, dice: Sequence[float]
    ) -> tuple[Tensor, Tensor]:
        batch, channels, height, width = logits.shape
        flat = (batch * channels, height * width)
        values = logits.detach().to(torch.float32, memory_format=torch.contiguous_format)
        wanted = ctx.needs_input_grad[0]
        gradient = torch.empty(flat if wanted else (0, 0), dtype=torch.float32)
        losses = np.empty(flat[0])
        scale = (weights / (batch * channels)).reshape(-1)
        clean = bce_dice_planes(
            values.view(flat).numpy(),
            target.contiguous().view(flat).numpy(),
            scale.numpy(),
            np.tile(np.asarray(dice, np.float32), batch),
            gradient.numpy(),
            losses,
        )
        if not clean:
            raise ValueError(_MASKS)
        if wanted:
            ctx.save_for_backward(gradient.view(logits.shape).to(logits.dtype))
        planes = torch.from_numpy(losses)
        loss = (planes * scale).sum().float()
        planes = planes.float().view(batch, channels)
        ctx.mark_non_differentiable(planes)
        return loss, planes

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(
        ctx: Any, loss_gradient: Tensor, _planes_gradient: Tensor
    ) -> tuple[Tensor | None, None, None, None]:
        (gradient,) = ctx.saved_tensors
        factor = loss_gradient.item()
        return gradient if factor == 1.0 else gradient * factor, None, None, None


_MASKS = "target must hold 0 and 255 only; multiply masks of 0 and 1 by 255"


def _torch_planes(logits: Tensor, target: Tensor, dice: Sequence[float]) -> Tensor:
    """Losses (B, C) in PyTorch's operations, on any device."""
    if target.device.type == "cpu" and bool(((target != 0) & (target != 255)).any()):
        raise ValueError(_MASKS)  # elsewhere looking at it would stop the device's queue
    values = logits if logits.dtype == torch.float64 else logits.float()
    occupied = (target > 127).to(values.dtype)
    losses = F.binary_cross_entropy_with_logits(values, occupied, reduction="none").mean((2, 3))
    chosen = [channel for channel, weight in enumerate(dice) if weight != 0.0]
    if not chosen:
        return losses
    probability, mask = torch.sigmoid(values[:, chosen]), occupied[:, chosen]
    pixels = mask.sum(dim=(2, 3))
    overlap = (probability * mask).sum(dim=(2, 3))
    terms = 1.0 - (2.0 * overlap + 1.0) / (probability.sum(dim=(2, 3)) + pixels + 1.0)
    factors = losses.new_tensor([dice[channel] for channel in chosen])
    index = torch.tensor(chosen, device=losses.device)
    return losses.index_add(1, index, torch.where(pixels > 0, factors * terms, 0.0))


def _check_planes(logits: Tensor, target: Tensor) -> None:
    if logits.ndim != 4 or logits.shape != target.shape or not logits.numel():
        raise ValueError(
            "logits and target must have one shape (B, C, H, W), "
            f"got {tuple(logits.shape)} and {tuple(target.shape)}"
        )
    if not logits.is_floating_point() or target.dtype != torch.uint8:
        raise ValueError(
            f"logits must be floating point and target uint8, got {logits.dtype} and {target.dtype}"
        )
    if logits.device != target.device:
        raise ValueError(f"logits are on {logits.device}, target is on {target.device}")


def _weights(
    logits: Tensor, sample_weights: Tensor | None, channel_weights: Tensor | None
) -> Tensor:
    """Weights (B, C) of all planes, on the device of the logits."""
    batch, channels = logits.shape[:2]
    dtype = torch.float64 if logits.dtype == torch.float64 else torch.float32
    weights = torch.ones(batch, channels, dtype=dtype, device=logits.device)
    if sample_weights is not None:
        if sample_weights.shape not in ((batch,), (batch, channels)):
            raise ValueError(
                f"sample_weights must have shape ({batch},) or ({batch}, {channels}), "
                f"got {tuple(sample_weights.shape)}"
            )
        weights = weights * sample_weights.to(weights).reshape(batch, -1)
    if channel_weights is not None:
        if channel_weights.shape != (channels,):
            raise ValueError(
                f"channel_weights must have shape ({channels},), got {tuple(channel_weights.shape)}"
            )
        weights = weights * channel_weights.to(weights)
    return weights.detach()


def _dice_weights(kinds: str | Sequence[str], channels: int, weight: float) -> tuple[float, ...]:
    """What Dice counts in each channel."""
    each = (kinds,) * channels if isinstance(kinds, str) else tuple(kinds)
    if len(each) != channels or not set(each) <= set(KINDS):
        raise ValueError(
            f"kinds must be {' or '.join(KINDS)}, or one of them for each of {channels} channels, "
            f"got {kinds!r}"
        )
    return tuple(weight if kind == "bce_dice" else 0.0 for kind in each)
