"""The U-Net over the BEV grid."""

import pytest
import torch

from bev_driving_env.frames import CHANNELS
from perception.models.bev_unet import BEVUNet, BEVUNetConfig


def inputs(batch=1, size=192):
    generator = torch.Generator().manual_seed(0)
    ground = torch.randint(1, 256, (batch, size, size, 3), dtype=torch.uint8, generator=generator)
    ground[:, size // 2 : size // 2 + 8, 8:16] = 0
    route = torch.randint(256, (batch, size, size), dtype=torch.uint8, generator=generator)
    return {"ground": ground, "route_map": route}


def awake(model):
    """Blocks start as identities; this one's do something."""
    torch.manual_seed(1)
    for name, parameter in model.named_parameters():
        if name.endswith("second.weight"):
            torch.nn.init.normal_(parameter, std=0.05)
    torch.nn.init.normal_(model.unet.head.weight, std=0.1)
    return model.eval()


@pytest.mark.parametrize("ground", [True, False])
def test_it_says_what_it_needs_and_answers_with_logits(ground):
    model = BEVUNet(BEVUNetConfig(ground=ground))
    assert model.needs == ({"ground", "route_map"} if ground else {"route_map"})
    assert model.channels == CHANNELS
    given = {name: values for name, values in inputs(2).items() if name in model.needs}
    logits = model(given)
    assert logits.shape == (2, 6, 192, 192)
    assert logits.dtype == torch.float32
    assert sum(parameter.numel() for parameter in model.parameters()) <= 2_300_000


def test_a_sample_does_not_depend_on_its_batch():
    model = awake(BEVUNet()).double()
    given = inputs(3)
    one = {name: values[1:2] for name, values in given.items()}
    with torch.inference_mode():
        torch.testing.assert_close(model(given)[1:2], model(one), atol=1e-5, rtol=1e-5)


def test_the_far_corners_see_each_other():
    model = awake(BEVUNet())
    given = inputs()
    ground = given["ground"].float().requires_grad_()
    model.double()
    logits = model({"ground": ground.double(), "route_map": given["route_map"]})
    logits[0, 1, 191, 191].backward()
    assert ground.grad[0, :8, :8].any()


def test_unseen_ground_is_told_from_black_ground():
    model = awake(BEVUNet())
    given = inputs()
    grounds = (given["ground"], given["ground"].clamp_min(1), given["ground"].clamp_min(2))
    with torch.inference_mode():
        unseen, black, nearly_black = (model({**given, "ground": ground}) for ground in grounds)
    patch = (..., slice(96, 104), slice(8, 16))
    step = (nearly_black - black)[patch].abs().mean()
    assert (black - unseen)[patch].abs().mean() > 10 * step


def test_it_runs_in_bfloat16_and_nearly_agrees():
    model = awake(BEVUNet())
    with torch.inference_mode():
        exact = model(inputs())
        with torch.autocast("cpu", torch.bfloat16):
            rough = model(inputs())
    assert rough.dtype == torch.float32
    assert (rough - exact).abs().mean() < 0.05 * exact.std() + 0.05


def test_it_learns_where_the_route_is_from_the_map():
    torch.manual_seed(0)
    config = BEVUNetConfig(
        channels=("route",), bev_size=32, widths=(8, 16, 16), encoder_blocks=(0, 1, 1),
        decoder_blocks=(0, 1), ground=False,
    )  # fmt: skip
    model = BEVUNet(config)
    optimiser = torch.optim.AdamW(model.parameters(), 3e-3)
    for _ in range(60):
        columns = torch.randint(32, (8, 1, 1))
        # the target is four cells to the left of the mark
        mark = (torch.arange(32) - columns).abs() < 3
        target = (torch.arange(32) - columns + 4).abs() < 3
        logits = model({"route_map": mark.expand(8, 32, 32).to(torch.uint8) * 255})
        loss = torch.nn.functional.binary_cross_entropy_with_logits(
            logits[:, 0], target.expand(8, 32, 32).float()
        )
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert loss < 0.1
