"""``joint_attention``: the fused kernel, merged, against one softmax written out in loops."""

import pytest
import torch

from perception.models import joint_attention as module
from perception.models.joint_attention import is_fused, joint_attention, joint_weights

SCALE = 0.3


def make(cameras, dtype=torch.float32, batch=2, heads=3, queries=5, keys=7, dim=8):
    torch.manual_seed(cameras)
    parts = []
    for length in (queries, keys, keys):
        # as a linear layer makes them, tokens before heads
        tokens = torch.randn(batch, cameras, length, heads, dim, dtype=dtype)
        parts.append(tokens.transpose(2, 3).detach().requires_grad_())
    return parts


def one_softmax(query, key, value):
    """In double precision, sample by sample, head by head and query by query."""
    query, key, value = (part.double() for part in (query, key, value))
    batch, cameras, heads, queries, dim = query.shape
    rows = []
    for b in range(batch):
        for h in range(heads):
            for q in range(queries):
                logits = [key[b, n, h] @ query[b, n, h, q] * SCALE for n in range(cameras)]
                grown = torch.cat(logits).exp()
                rows.append(grown / grown.sum() @ value[b, :, h].reshape(-1, dim))
    return torch.stack(rows).reshape(batch, heads, queries, dim)


@pytest.mark.parametrize("cameras", [1, 2, 6])
@pytest.mark.parametrize("fused", [True, False])
def test_outputs_and_gradients_are_those_of_one_softmax_over_all_cameras(
    cameras, fused, monkeypatch
):
    if not fused:
        monkeypatch.setattr(module, "_FORWARD", None)
    parts = make(cameras)
    assert is_fused(parts[0]) is fused
    out = joint_attention(*parts, SCALE)
    expected = one_softmax(*parts)
    torch.testing.assert_close(out.double(), expected, rtol=0, atol=1e-5)

    direction = torch.randn_like(out)
    gradients = torch.autograd.grad(out, parts, direction)
    wanted = torch.autograd.grad(expected, parts, direction.double())
    for gradient, reference in zip(gradients, wanted, strict=True):
        torch.testing.assert_close(gradient, reference, rtol=0, atol=1e-5)


def test_large_logits_do_not_overflow():
    query, key, value = make(3)
    with torch.no_grad():
        out = joint_attention(query * 100.0, key * 100.0, value, SCALE)
    assert torch.isfinite(out).all()


def test_nothing_is_kept_for_a_backward_that_will_not_come():
    with torch.no_grad():
        assert joint_attention(*make(2), SCALE).grad_fn is None


def test_bfloat16_stays_bfloat16_and_close():
    parts = [part.detach().bfloat16().requires_grad_() for part in make(4)]
    out = joint_attention(*parts, SCALE)
    assert out.dtype == torch.bfloat16
    torch.testing.assert_close(out.double(), one_softmax(*parts), rtol=0, atol=0.03)
    out.sum().backward()
    assert all(part.grad.dtype == torch.bfloat16 for part in parts)


def test_weights_of_all_cameras_sum_to_one():
    query, key, _ = make(4)
    weights = joint_weights(query, key, SCALE)
    assert weights.shape == (2, 3, 5, 4 * 7)
    torch.testing.assert_close(weights.sum(-1), torch.ones(2, 3, 5))
