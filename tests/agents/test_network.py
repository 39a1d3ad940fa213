"""The policy network: its shape, what it looks at, how it starts."""

import json
import math

import pytest
import torch

from agents.network import (
    BetaActor,
    BetaHead,
    BEVEncoder,
    NetworkConfig,
    convolved_size,
    mlp,
    smallest_bev_size,
)


def actor(config, seed=0):
    torch.manual_seed(seed)
    hidden = mlp(256, (256, 256))
    return BetaActor(BEVEncoder(config), hidden, BetaHead(256, 2, config.concentration_floor))


def count(module):
    return sum(parameter.numel() for parameter in module.parameters())


def views(config, batch=2):
    torch.manual_seed(1)
    bev = torch.randint(0, 256, (batch, 6, config.bev_size, config.bev_size), dtype=torch.uint8)
    return bev, torch.tensor([[5.0, 0.4, -0.2]]).repeat(batch, 1)


def test_its_size_is_the_papers():
    # by hand: convolutions, measurements, fusion, head, and two layers to the concentrations
    convolutions = [(3, 8, 5), (8, 16, 5), (16, 32, 5), (32, 64, 3), (64, 128, 3), (128, 256, 3)]
    layers = [(3, 256), (256, 256), (1280, 512), (512, 256), (256, 256), (256, 256)]
    expected = sum(o * (i * k * k + 1) for i, o, k in convolutions)
    expected += sum(o * (i + 1) for i, o in [*layers, (256, 2), (256, 2)])
    assert count(actor(NetworkConfig())) == expected == 1_390_804


def test_six_channels_add_one_kernel_each():
    more = count(actor(NetworkConfig(channels=tuple(range(6))))) - count(actor(NetworkConfig()))
    assert more == 3 * 8 * 25


def test_a_bev_of_192_leaves_1024_features_to_fuse():
    assert convolved_size(192) == 2
    encoder = BEVEncoder(NetworkConfig())
    assert encoder.convolutions(torch.zeros(1, 3, 192, 192)).shape == (1, 1024)
    assert encoder(*views(encoder.config)).shape == (2, 256)


def test_the_smallest_bev_fits_and_one_pixel_less_does_not():
    size = smallest_bev_size()
    config = NetworkConfig(bev_size=size)
    alpha, beta = actor(config)(*views(config))
    assert alpha.shape == beta.shape == (2, 2)
    with pytest.raises(ValueError, match=f"at least {size} pixels.* got {size - 1}"):
        NetworkConfig(bev_size=size - 1)


def test_it_starts_as_the_reference_does():
    torch.manual_seed(0)
    encoder = BEVEncoder(NetworkConfig())
    first = encoder.convolutions[0]
    # Xavier's uniform bound for 75 inputs and 200 outputs per pixel, with ReLU's gain
    bound = math.sqrt(2.0) * math.sqrt(6.0 / (3 * 25 + 8 * 25))
    assert 0.95 * bound < first.weight.abs().max().item() <= bound
    for module in encoder.convolutions:
        if isinstance(module, torch.nn.Conv2d):
            assert (module.bias == 0.1).all()


def test_it_sees_the_chosen_channels_and_no_others():
    config = NetworkConfig(channels=(5, 1))
    network = actor(config)
    bev, measurements = views(config)
    before = torch.cat(network(bev, measurements))
    for channel in range(6):
        changed = bev.clone()
        changed[:, channel] = 255 - changed[:, channel]
        is_same = torch.equal(torch.cat(network(changed, measurements)), before)
        assert is_same == (channel not in config.channels)


def test_the_order_of_channels_is_that_of_the_configuration():
    forth, back = NetworkConfig(channels=(0, 3)), NetworkConfig(channels=(3, 0))
    bev, measurements = views(forth)
    swapped = bev.clone()
    swapped[:, [0, 3]] = bev[:, [3, 0]]
    torch.testing.assert_close(
        actor(forth)(bev, measurements)[0], actor(back)(swapped, measurements)[0]
    )


def test_it_sees_the_chosen_measurements_and_no_others():
    network = actor(NetworkConfig(measurements=(0,)))
    bev, measurements = views(network.encoder.config)
    before = network(bev, measurements)[0]
    changed = measurements + torch.tensor([0.0, 0.5, -0.5])
    assert torch.equal(network(bev, changed)[0], before)
    assert not torch.equal(network(bev, measurements + torch.tensor([1.0, 0.0, 0.0]))[0], before)


def test_speed_is_scaled_and_commands_are_not():
    plain, halved = (actor(NetworkConfig(speed_scale_mps=scale)) for scale in (1.0, 2.0))
    bev, measurements = views(plain.encoder.config)
    faster = measurements * torch.tensor([2.0, 1.0, 1.0])
    assert torch.equal(plain(bev, measurements)[0], halved(bev, faster)[0])


def test_bytes_and_floats_of_0_to_255_are_seen_alike():
    network = actor(NetworkConfig())
    bev, measurements = views(network.encoder.config)
    assert torch.equal(network(bev, measurements)[0], network(bev.float(), measurements)[0])


@pytest.mark.parametrize("floor", [1e-3, 1.0])
def test_concentrations_never_fall_below_their_floor(floor):
    head = BetaHead(1, 2, floor)
    alpha, beta = head(torch.tensor([[-1e9], [1e9], [0.0]]))
    assert torch.cat([alpha, beta]).min().item() == pytest.approx(floor)
    assert torch.isfinite(alpha).all()


def test_a_configuration_survives_json():
    config = NetworkConfig(channels=(4, 0), measurements=(0, 2), speed_scale_mps=9.0)
    assert NetworkConfig.from_json(json.loads(json.dumps(config.as_json()))) == config


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"channels": ()}, "channels .* at least one, got ()"),
        ({"channels": (0, 6)}, "from 0 to 5"),
        ({"channels": (0, 0)}, "different numbers"),
        ({"channels": (0.5,)}, "channels"),
        ({"measurements": (3,)}, "measurements .* from 0 to 2"),
        ({"speed_scale_mps": 0.0}, "speed_scale_mps must be positive"),
        ({"concentration_floor": math.nan}, "concentration_floor .* got nan"),
        ({"bev_size": 192.0}, "bev_size"),
    ],
)
def test_a_configuration_that_cannot_be_is_refused(fields, named):
    with pytest.raises(ValueError, match=named):
        NetworkConfig(**fields)
