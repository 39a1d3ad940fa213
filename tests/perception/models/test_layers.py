"""Parts of the U-Nets."""

import pytest
import torch
from torch.nn import functional

from bev_driving_env.frames import BEVGeometry
from perception.models.layers import (
    BASE_RATES,
    ResidualBlock,
    UNet,
    UNetConfig,
    Upsampling,
    places,
    shuffled,
    shuffled_planes,
    unshuffled,
)

TINY = UNetConfig(bev_size=16, widths=(4, 6, 8), encoder_blocks=(0, 1, 1), decoder_blocks=(0, 1))


def reordered(x):
    """Features of ``pixel_shuffle``'s order of those that lie cell by cell."""
    batch, features, height, width = x.shape
    cells = x.reshape(batch, 4, features // 4, height, width)
    return cells.transpose(1, 2).reshape(batch, features, height, width)


def test_shuffles_are_pixel_shuffles_of_reordered_features():
    x = torch.randn(2, 12, 5, 7)
    wanted = functional.pixel_shuffle(reordered(x), 2)
    assert torch.equal(shuffled_planes(x), wanted)
    assert torch.equal(shuffled(x.permute(0, 2, 3, 1)), wanted)
    assert shuffled_planes(x).is_contiguous()
    assert shuffled(x.permute(0, 2, 3, 1)).is_contiguous(memory_format=torch.channels_last)


def test_unshuffling_is_undone_by_shuffling():
    image = torch.randint(256, (2, 8, 12, 5), dtype=torch.uint8)
    planes = unshuffled(image)
    assert planes.shape == (2, 20, 4, 6)
    assert planes.is_contiguous(memory_format=torch.channels_last)
    assert torch.equal(shuffled_planes(planes), image.permute(0, 3, 1, 2))


def test_a_residual_block_starts_as_the_identity_and_learns():
    block = ResidualBlock(6)
    x = torch.rand(2, 6, 5, 5)
    assert torch.equal(block(x), x)
    block(x).square().sum().backward()
    assert block.second.weight.grad.any()


def test_upsampling_makes_four_cells_of_each_on_its_own():
    up = Upsampling(3, 5)
    x = torch.randn(1, 3, 4, 4)
    changed = x.clone()
    changed[0, :, 1, 2] += 1.0
    moved = (up(x) != up(changed)).any(dim=1)[0]
    assert up(x).shape == (1, 5, 8, 8)
    assert moved.nonzero().tolist() == [[2, 4], [2, 5], [3, 4], [3, 5]]


def test_places_tell_forward_and_left_of_the_car():
    planes = places(192)[0]
    geometry = BEVGeometry()
    assert planes.shape == (4, 96, 96)
    for row, column in ((0, 0), (75, 47), (95, 60)):
        # the centre of a cell of two by two pixels
        x, y = geometry.ego_from_pixel([2 * column + 0.5, 2 * row + 0.5]) / 19.2
        wanted = torch.tensor([x, y, abs(y), (x * x + y * y) ** 0.5])
        torch.testing.assert_close(planes[:, row, column], wanted.float())


def test_a_new_net_predicts_the_channels_base_rates():
    torch.manual_seed(0)
    net = UNet(3, UNetConfig(channels=("lane", "road")))
    found = net(torch.rand(2, 3, 96, 96)).sigmoid().mean(dim=(0, 2, 3))
    for name, rate in zip(("lane", "road"), found.tolist(), strict=True):
        assert rate == pytest.approx(BASE_RATES[name], rel=0.2)


def test_every_parameter_learns_and_places_are_no_weights():
    torch.manual_seed(0)
    net = UNet(3, TINY)
    for parameter in net.parameters():  # blocks start as identities, whose inner halves wait
        torch.nn.init.normal_(parameter, std=0.3)
    net(torch.rand(1, 3, 8, 8)).square().mean().backward()
    assert all(parameter.grad.any() for parameter in net.parameters())
    assert "cells" not in net.state_dict()


def test_cells_know_their_places_only_if_told():
    torch.manual_seed(0)
    for told in (True, False):
        config = UNetConfig(bev_size=64, widths=(4, 4), encoder_blocks=(0, 0),
                            decoder_blocks=(0,), places=told)  # fmt: skip
        logits = UNet(1, config)(torch.zeros(1, 1, 32, 32))[0, 0]
        inner = logits[16:48, 16:48:2]  # the border is felt by its padding
        assert bool((inner[::2] - inner[0]).abs().max() > 1e-4) is told


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": ("road", "trees")}, "channels must be different ones of road"),
        ({"channels": ("road", "road")}, "channels must be different"),
        ({"channels": ()}, "at least one"),
        ({"widths": (8, 0)}, "widths must be positive ints"),
        ({"decoder_blocks": (1, 1, 1, 1, 1)}, "decoder_blocks must be 4 ints"),
        ({"encoder_blocks": (1, 1)}, "encoder_blocks must be 5 ints"),
        ({"bev_size": 100}, "multiple of 32 for 5 widths, got 100"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        UNetConfig(**changes)
