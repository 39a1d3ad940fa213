"""Attention of one query grid per camera over the keys of all cameras, under one softmax.

Cross-view attention has logits ``q_n . k_n`` with a query of its own for every camera n, but
normalises over the keys of all cameras together, which no call of
``scaled_dot_product_attention`` does. The fused kernel runs per camera instead, and the outputs
are merged by their log-sum-exps. The same kernel's backward needs nothing but the *global* output
and log-sum-exp to give the gradients of the joint softmax, since the weights it recomputes are
``exp(logit - logsumexp)``.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

_FORWARD = getattr(torch.ops.aten, "_scaled_dot_product_flash_attention_for_cpu", None)
_BACKWARD = getattr(torch.ops.aten, "_scaled_dot_product_flash_attention_for_cpu_backward", None)


def joint_attention(query: Tensor, key: Tensor, value: Tensor, scale: float = 1.0) -> Tensor:
    """Attend from per-camera queries to the keys of all cameras with one softmax.

    Args:
        query: (B, N, H, Q, D), a query per camera.
        key: (B, N, H, K, D).
        value: (B, N, H, K, D).
        scale: Factor of the logits.

    Returns:
        (B, H, Q, D), ``sum_nk softmax_nk(scale * query_n . key_nk) value_nk``.
    """
    if not is_fused(query):
        return plain_joint_attention(query, key, value, scale)
    if torch.is_grad_enabled() and any(part.requires_grad for part in (query, key, value)):
        out: Tensor = _FusedJointAttention.apply(query, key, value, scale)  # type: ignore[no-untyped-call]
        return out
    return _fused(query, key, value, scale)[0]


def is_fused(query: Tensor) -> bool:
    """Whether there is a fused kernel for such tensors; other devices use the plain softmax."""
    return query.device.type == "cpu" and _FORWARD is not None and _BACKWARD is not None


def plain_joint_attention(query: Tensor, key: Tensor, value: Tensor, scale: float) -> Tensor:
    """:func:`joint_attention` with the weights written out, on any device."""
    weights = joint_weights(query, key, scale).to(value.dtype)  # (B, H, Q, N * K)
    return weights @ value.transpose(1, 2).flatten(2, 3)


def joint_weights(query: Tensor, key: Tensor, scale: float = 1.0) -> Tensor:
    """Weights (B, H, Q, N * K) of :func:`joint_attention`; each row sums to 1."""
    logits = query @ key.transpose(-1, -2) * scale  # (B, N, H, Q, K)
    return logits.permute(0, 2, 3, 1, 4).flatten(3).softmax(-1)


def _fused(query: Tensor, key: Tensor, value: Tensor, scale: float) -> tuple[Tensor, Tensor]:
    """Output (B, H, Q, D) and its log-sum-exp (B, H, Q)."""
    batch, cameras = query.shape[:2]
    # cameras are entries of the batch to the kernel
    outputs, logsumexps = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu(
        query.flatten(0, 1), key.flatten(0, 1), value.flatten(0, 1), scale=scale
    )
    if cameras == 1:
        return outputs, logsumexps
    logsumexps = logsumexps.unflatten(0, (batch, cameras))  # (B, N, H, Q)
    shares = logsumexps.softmax(1).unsqueeze(-1)
    merged = (outputs.unflatten(0, (batch, cameras)) * shares).sum(1)
    return merged.to(value.dtype), logsumexps.logsumexp(1)


class _FusedJointAttention(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, query: Tensor, key: Tensor, value: Tensor, scale: float) -> Tensor:
        out, logsumexp = _fused(query, key, value, scale)
        ctx.save_for_backward(query, key, value, out, logsumexp)
        ctx.scale = scale
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        query, key, value, out, logsumexp = ctx.saved_tensors
        shape = query.shape[:2]

        def for_each_camera(part: Tensor) -> Tensor:
            return part.unsqueeze(1).expand(-1, shape[1], *part.shape[1:]).flatten(0, 1)

        gradients = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu_backward(
            for_each_camera(grads[0].to(out.dtype)),
            query.flatten(0, 1),
            key.flatten(0, 1),
            value.flatten(0, 1),
            for_each_camera(out),
            for_each_camera(logsumexp),
            0.0,
            False,
            scale=ctx.scale,
        )
        of_query, of_key, of_value = (part.unflatten(0, shape) for part in gradients)
        return of_query, of_key, of_value, None
