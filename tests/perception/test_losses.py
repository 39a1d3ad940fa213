"""The loss of BEVs: the kernel, PyTorch's operations and finite differences agree."""

import numpy as np
import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits

from perception.losses import bev_loss

MIXED = ("bce", "bce_dice", "bce_dice")


def toy_batch(dtype=torch.float32, shape=(4, 3, 11, 13), scale=4.0, seed=0):
    generator = torch.Generator().manual_seed(seed)
    logits = (torch.randn(shape, generator=generator) * scale).to(dtype)
    target = (torch.rand(shape, generator=generator) < 0.3).to(torch.uint8) * 255
    target[0, 1] = 0  # one plane without anything
    return logits.requires_grad_(), target


def weights(seed=1):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(4, generator=generator) + 0.2, torch.tensor([1.0, 0.0, 2.5])


def loss_and_gradient(logits, *arguments, **options):
    logits = logits.detach().clone().requires_grad_()
    loss, channels = bev_loss(logits, *arguments, **options)
    loss.backward()
    return loss.item(), channels, logits.grad


def test_without_weights_it_is_the_mean_bce():
    logits, target = toy_batch()
    loss, channels, gradient = loss_and_gradient(logits, target)
    expected = binary_cross_entropy_with_logits(logits, target / 255.0, reduction="none")
    assert loss == pytest.approx(expected.mean().item(), rel=1e-6)
    torch.testing.assert_close(channels, expected.mean((0, 2, 3)))
    torch.testing.assert_close(gradient, torch.autograd.grad(expected.mean(), logits)[0])
    assert not channels.requires_grad


def test_the_weighted_loss_is_the_papers_equation():
    logits, target = toy_batch()
    of_samples = weights()[0]
    loss, _, gradient = loss_and_gradient(logits, target, of_samples)
    per_sample = binary_cross_entropy_with_logits(logits, target / 255.0, reduction="none")
    expected = (of_samples * per_sample.mean((1, 2, 3))).mean()
    assert loss == pytest.approx(expected.item(), rel=1e-6)
    torch.testing.assert_close(gradient, torch.autograd.grad(expected, logits)[0])


@pytest.mark.parametrize("kinds", ["bce", "bce_dice", MIXED])
@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_the_kernel_equals_pytorch_in_float64(kinds, scale):
    logits, target = toy_batch(scale=scale)
    options = {"kinds": kinds, "dice_weight": 0.7}
    loss, channels, gradient = loss_and_gradient(logits, target, *weights(), **options)
    exact, exact_channels, slope = loss_and_gradient(logits.double(), target, *weights(), **options)
    assert loss == pytest.approx(exact, rel=1e-6)
    torch.testing.assert_close(channels.double(), exact_channels, rtol=1e-6, atol=1e-7)
    torch.testing.assert_close(gradient.double(), slope, rtol=0, atol=1e-6 * slope.abs().max())
    assert (gradient[:, 1] == 0.0).all()  # its channel weighs 0
    assert gradient[:, 2].abs().max() > 0.0


@pytest.mark.parametrize("kinds", ["bce", MIXED])
def test_the_gradient_is_the_slope_of_the_loss(kinds):
    logits, target = toy_batch(torch.float64, (4, 3, 2, 3), scale=2.0)
    of_samples, of_channels = (it.double() for it in weights())
    assert torch.autograd.gradcheck(
        lambda x: bev_loss(x, target, of_samples, of_channels, kinds)[0], (logits,)
    )


@pytest.mark.parametrize("kinds", ["bce", "bce_dice"])
def test_the_kernels_gradient_is_the_slope_of_the_kernels_loss(kinds):
    logits, target = toy_batch(shape=(4, 3, 2, 3), scale=2.0)
    gradient = loss_and_gradient(logits, target, *weights(), kinds=kinds)[2]
    step, values = 0.02, logits.detach()
    for index in ((0, 0, 0, 0), (1, 2, 1, 2), (3, 2, 0, 1), (2, 0, 1, 1)):
        ends = []
        for sign in (1.0, -1.0):
            moved = values.clone()
            moved[index] += sign * step
            ends.append(bev_loss(moved, target, *weights(), kinds=kinds)[0].item())
        slope = (ends[0] - ends[1]) / (2.0 * step)
        assert gradient[index].item() == pytest.approx(slope, rel=1e-3, abs=3e-5)


def test_dice_is_its_closed_form():
    logits = torch.tensor([0.0, 0.0, 0.0, 0.0]).reshape(1, 1, 2, 2)
    target = torch.tensor([255, 0, 0, 0], dtype=torch.uint8).reshape(1, 1, 2, 2)
    for dtype in (torch.float32, torch.float64):  # the kernel and PyTorch
        loss, _ = bev_loss(logits.to(dtype), target, kinds="bce_dice", dice_weight=2.0)
        dice = 1.0 - (2.0 * 0.5 + 1.0) / (2.0 + 1.0 + 1.0)
        assert loss.item() == pytest.approx(np.log(2.0) + 2.0 * dice, rel=1e-6)


def test_where_the_target_is_empty_dice_is_left_out():
    logits, target = toy_batch()
    target[:] = 0
    for dtype in (torch.float32, torch.float64):
        plain = loss_and_gradient(logits.to(dtype), target)
        dice = loss_and_gradient(logits.to(dtype), target, kinds="bce_dice")
        assert plain[0] == dice[0]
        assert torch.equal(plain[2], dice[2])


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_is_computed_in_float32(dtype):
    logits, target = toy_batch(dtype)
    loss, channels, gradient = loss_and_gradient(logits, target, kinds=MIXED)
    wide, wide_channels, slope = loss_and_gradient(logits.float(), target, kinds=MIXED)
    assert loss == wide
    assert channels.dtype == torch.float32
    assert torch.equal(channels, wide_channels)
    assert torch.equal(gradient, slope.to(dtype))


def test_the_memory_layout_does_not_matter():
    logits, target = toy_batch()
    last = torch.channels_last
    plain = loss_and_gradient(logits, target, *weights(), kinds=MIXED)
    turned = loss_and_gradient(
        logits.contiguous(memory_format=last),
        target.contiguous(memory_format=last),
        *weights(),
        kinds=MIXED,
    )
    assert plain[0] == turned[0]
    assert torch.equal(plain[2], turned[2])


def test_each_channel_may_have_sample_weights_of_its_own():
    logits, target = toy_batch()
    of_samples, of_channels = weights()
    table = of_samples[:, None] * of_channels
    one = loss_and_gradient(logits, target, of_samples, of_channels)
    other = loss_and_gradient(logits, target, table)
    assert one[0] == pytest.approx(other[0], rel=1e-6)
    torch.testing.assert_close(one[2], other[2])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_extreme_logits_give_finite_losses(dtype):
    logits = torch.tensor([1e4, -1e4, 100.0, -100.0, 0.0, -88.5], dtype=dtype)
    logits = logits.reshape(1, 1, 1, 6).requires_grad_()
    target = torch.tensor([0, 255, 255, 0, 255, 0], dtype=torch.uint8).reshape(1, 1, 1, 6)
    loss, _ = bev_loss(logits, target)
    loss.backward()
    assert loss.item() == pytest.approx((2e4 + np.log(2.0)) / 6.0, rel=1e-6)
    expected = torch.tensor([1.0, -1.0, 0.0, 0.0, -0.5, 0.0], dtype=dtype) / 6.0
    torch.testing.assert_close(logits.grad.flatten(), expected)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("position", [0, 142])
def test_a_logit_that_is_nan_shows_in_the_loss(dtype, position):
    logits, target = toy_batch(dtype)
    with torch.no_grad():
        logits.view(-1)[position] = float("nan")
    loss, channels, gradient = loss_and_gradient(logits, target)
    assert np.isnan(loss)
    assert channels.isnan().tolist() == [True, False, False]
    assert gradient.view(-1)[position].isnan()


def test_the_gradient_is_scaled_by_what_follows_and_kept_for_a_second_pass():
    logits, target = toy_batch()
    once = loss_and_gradient(logits, target)[2]
    (0.25 * bev_loss(logits, target)[0]).backward()
    torch.testing.assert_close(logits.grad, 0.25 * once)
    logits.grad = None
    loss, _ = bev_loss(logits, target)
    loss.backward(retain_graph=True)
    loss.backward()
    torch.testing.assert_close(logits.grad, 2.0 * once)


def test_without_gradients_the_loss_is_the_same():
    logits, target = toy_batch()
    with torch.inference_mode():
        loss, channels = bev_loss(logits, target, *weights(), kinds=MIXED)
    expected, expected_channels, _ = loss_and_gradient(logits, target, *weights(), kinds=MIXED)
    assert loss.item() == expected
    assert torch.equal(channels, expected_channels)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (
            {"logits": torch.zeros(4, 3, 11, 12)},
            r"one shape .* \(4, 3, 11, 12\) and \(4, 3, 11, 13",
        ),
        ({"logits": torch.zeros(4, 3)}, "must have one shape"),
        ({"logits": torch.zeros(4, 3, 11, 13).int()}, "must be floating point .* torch.int32"),
        ({"target": torch.zeros(4, 3, 11, 13)}, "target uint8, .* torch.float32$"),
        ({"target": torch.ones(4, 3, 11, 13).byte()}, "0 and 255 only; multiply masks"),
        ({"sample_weights": torch.ones(3)}, r"shape \(4,\) or \(4, 3\), got \(3,\)"),
        ({"channel_weights": torch.ones(2)}, r"shape \(3,\), got \(2,\)"),
        ({"kinds": "focal"}, "kinds must be bce or bce_dice, .* got 'focal'"),
        ({"kinds": ("bce", "bce")}, "each of 3 channels"),
    ],
)
def test_what_does_not_fit_is_refused(change, named):
    logits, target = toy_batch()
    with pytest.raises(ValueError, match=named):
        bev_loss(**{"logits": logits, "target": target, **change})


def test_masks_of_zero_and_one_are_refused_in_float64_too():
    with pytest.raises(ValueError, match="0 and 255 only"):
        bev_loss(torch.zeros(1, 1, 1, 2).double(), torch.tensor([[[[0, 1]]]], dtype=torch.uint8))
