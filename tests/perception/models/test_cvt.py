"""``CrossViewTransformer``: its formulas, sizes, options and errors."""

import json
import re
from dataclasses import replace

import pytest
import torch
from torch.nn import functional

from bev_driving_env.cameras.rig import SURROUND, Camera, CameraRig
from bev_driving_env.frames import CHANNELS, BEVGeometry
from perception.models.cvt import CrossViewTransformer
from perception.models.cvt_config import FAST, PAPER, CVTConfig

RIG = (*SURROUND, Camera("wide", z_m=1.5, yaw_deg=40.0, fov_deg=120.0), Camera("up", pitch_deg=-5))
SMALL = CVTConfig(
    image_size=(16, 32),
    channels=("road", "lane"),
    geometry=BEVGeometry(size=32, px_per_m=1.0, ego_row=24),
    trunk="small",
    trunk_widths=(6, 8, 10),
    trunk_blocks=(0, 1, 1),
    scales=(4, 8),
    route_map="none",
    dim=16,
    heads=2,
)
SMALL_FAST = replace(
    SMALL,
    scales=(8, 4),
    dim=48,
    positions="fourier",
    grids="centres",
    route_map="bev",
    decoder="light",
)


def make_inputs(config, cameras=4, batch=2):
    generator = torch.Generator().manual_seed(cameras)
    rig = CameraRig(RIG[:cameras], config.image_size)
    side = config.geometry.size
    poses = torch.from_numpy(rig.extrinsics()).repeat(batch, 1, 1, 1)
    poses[:, :, :3, 3] += 0.1 * torch.randn(batch, cameras, 3, generator=generator)
    shapes = {
        "images": (batch, cameras, *config.image_size, 3),
        "route_map": (batch, side, side),
        "ground": (batch, side, side, 3),
    }
    rasters = {
        name: torch.randint(0, 256, shape, generator=generator, dtype=torch.uint8)
        for name, shape in shapes.items()
    }
    intrinsics = torch.from_numpy(rig.intrinsics()).repeat(batch, 1, 1, 1)
    intrinsics[:, :, :2, :2] *= 1.0 + 0.1 * torch.rand(batch, cameras, 1, 1, generator=generator)
    return {**rasters, "intrinsics": intrinsics, "extrinsics": poses}


def make_model(config, seed=0):
    """A model in evaluation mode whose batch normalisation has something to do."""
    torch.manual_seed(seed)
    model = CrossViewTransformer(config).eval()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(0.0, 0.2)
            module.running_var.uniform_(0.5, 1.5)
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.normal_(module.bias, 0.0, 0.2)
    return model


class Transcription:
    """The published formulas in double precision, one sample, camera and head at a time."""

    def __init__(self, weights, config):
        self.weights = {name: value.double() for name, value in weights.items()}
        self.config = config

    def __call__(self, inputs):
        return torch.stack([self.sample(inputs, b) for b in range(len(inputs["images"]))])

    def linear(self, name, x):
        y = x @ self.weights[f"{name}.weight"].T
        return y + self.weights[f"{name}.bias"] if f"{name}.bias" in self.weights else y

    def conv(self, name, x, stride=1, padding=0):
        bias = self.weights.get(f"{name}.bias")
        return functional.conv2d(x, self.weights[f"{name}.weight"], bias, stride, padding)

    def batch_norm(self, name, x):
        mean, var, scale, shift = (
            self.weights[f"{name}.{part}"][:, None, None]
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / torch.sqrt(var + 1e-5) * scale + shift

    def layer_norm(self, name, x):
        centred = x - x.mean(-1, keepdim=True)
        normed = centred / torch.sqrt((centred**2).mean(-1, keepdim=True) + 1e-5)
        return normed * self.weights[f"{name}.weight"] + self.weights[f"{name}.bias"]

    def sample(self, inputs, b):
        cameras = inputs["images"].shape[1]
        features = [self.trunk(inputs["images"][b, n].double()) for n in range(cameras)]
        intrinsics = [inputs["intrinsics"][b, n].double() for n in range(cameras)]
        poses = [inputs["extrinsics"][b, n].double().inverse() for n in range(cameras)]
        state = self.weights["prior"]  # (C, h, w)
        for number in range(len(self.config.scales)):
            seen = [feature[number] for feature in features]
            state = self.cross_view(f"cross_views.{number}", state, seen, intrinsics, poses)
            for layer in range(self.config.bottlenecks):
                state = self.bottleneck(f"refinements.{number}.{layer}.residual", state)
        return self.decoder(state)

    def trunk(self, image):
        mean = torch.tensor([0.485, 0.456, 0.406]).double()
        std = torch.tensor([0.229, 0.224, 0.225]).double()
        x = ((image / 255.0 - mean) / std).permute(2, 0, 1)[None]
        features = []
        for stage, blocks in enumerate(self.config.trunk_blocks):
            x = self.conv(f"trunk.stages.{stage}.0.0", x, 2, 1).relu()
            for block in range(1, blocks + 1):
                name = f"trunk.stages.{stage}.{block}"
                inner = self.conv(f"{name}.first", x, 1, 1).relu()
                x = (x + self.conv(f"{name}.second", inner, 1, 1)).relu()
            features.append(x)
        return [features[{2: 0, 4: 1, 8: 2}[scale]] for scale in self.config.scales]

    def cross_view(self, name, state, features, intrinsics, poses):
        dim, h, w = state.shape
        heads = self.config.heads
        geometry = self.config.geometry
        x = state.reshape(dim, h * w).T  # (Q, C)

        s, size = geometry.px_per_m, geometry.size
        cells = torch.stack(
            [
                torch.tensor(
                    [
                        (geometry.ego_row - size * row / (h - 1)) / s,
                        (size / 2 - size * column / (w - 1)) / s,
                    ]
                ).double()
                for row in range(h)
                for column in range(w)
            ]
        )
        queries, keys, values = [], [], []
        for feature, intrinsic, pose in zip(features, intrinsics, poses, strict=True):
            centre = self.linear(f"{name}.position.cam_embed", pose[:, 3])
            rows, columns = feature.shape[-2:]
            height, width = self.config.image_size
            deltas = []
            for row in range(rows):
                for column in range(columns):
                    u, v = width * column / (columns - 1), height * row / (rows - 1)
                    ray = intrinsic.inverse() @ torch.tensor([u, v, 1.0]).double()
                    point = pose @ torch.cat([ray, torch.ones(1).double()])
                    delta = self.linear(f"{name}.position.img_embed", point) - centre
                    deltas.append(delta / (delta.norm() + 1e-7))
            asked = self.linear(f"{name}.position.bev_embed", cells) - centre
            asked = asked / (asked.norm(dim=1, keepdim=True) + 1e-7)
            key, value = (
                self.conv(f"{name}.{kind}.2", self.batch_norm(f"{name}.{kind}.0", feature).relu())
                .reshape(dim, -1)
                .T
                for kind in ("key_feature", "value_feature")
            )
            queries.append(self.projected(f"{name}.to_q", asked + x))
            keys.append(self.projected(f"{name}.to_k", torch.stack(deltas) + key))
            values.append(self.projected(f"{name}.to_v", value))
        outputs = []
        for head in range(heads):
            part = slice(head * dim // heads, (head + 1) * dim // heads)
            logits = [
                torch.einsum("qd,kd->qk", query[:, part], key[:, part]) * (dim // heads) ** -0.5
                for query, key in zip(queries, keys, strict=True)
            ]
            attention = torch.cat(logits, 1).exp()
            attention = attention / attention.sum(1, keepdim=True)
            outputs.append(attention @ torch.cat([value[:, part] for value in values]))
        z = self.linear(f"{name}.proj", torch.cat(outputs, 1)) + x
        z = self.layer_norm(f"{name}.prenorm", z)
        hidden = self.linear(f"{name}.mlp.0", z)
        hidden = hidden * 0.5 * (1.0 + torch.erf(hidden / 2.0**0.5))
        z = self.layer_norm(f"{name}.postnorm", z + self.linear(f"{name}.mlp.2", hidden))
        return z.T.reshape(dim, h, w)

    def projected(self, name, x):
        return self.linear(f"{name}.1", self.layer_norm(f"{name}.0", x))

    def bottleneck(self, name, state):
        x = state[None]
        y = self.batch_norm(f"{name}.1", self.conv(f"{name}.0", x)).relu()
        y = self.batch_norm(f"{name}.4", self.conv(f"{name}.3", y, padding=1)).relu()
        return (x + self.batch_norm(f"{name}.7", self.conv(f"{name}.6", y))).relu()[0]

    def decoder(self, state):
        y = x = state[None]
        for layer in range(3):
            name = f"decoder.layers.{layer}"
            y = functional.interpolate(y, scale_factor=2, mode="bilinear", align_corners=True)
            y = self.batch_norm(f"{name}.conv.2", self.conv(f"{name}.conv.1", y, padding=1)).relu()
            y = self.batch_norm(f"{name}.conv.5", self.conv(f"{name}.conv.4", y))
            factor = 2 ** (layer + 1)
            skip = self.conv(f"{name}.up", x)
            y = (y + skip.repeat_interleave(factor, 2).repeat_interleave(factor, 3)).relu()
        y = self.batch_norm("decoder.head.1", self.conv("decoder.head.0", y, padding=1)).relu()
        return self.conv("decoder.head.3", y)[0]


@pytest.mark.parametrize("cameras", range(1, 7))
def test_it_computes_what_the_published_formulas_say(cameras):
    model = make_model(SMALL)
    inputs = make_inputs(SMALL, cameras)
    with torch.no_grad():
        logits = model(inputs)
        expected = Transcription(model.state_dict(), SMALL)(inputs)
    assert expected.std() > 0.1  # or nothing would be compared
    torch.testing.assert_close(logits.double(), expected, rtol=0, atol=1e-5)


def test_the_published_network_on_our_bev_has_1_07_million_parameters():
    count = sum(p.numel() for p in CrossViewTransformer(PAPER).parameters())
    assert count == pytest.approx(1.07e6, rel=0.02)
    assert count == 1_074_182


def test_the_fast_network_stays_small():
    assert sum(p.numel() for p in CrossViewTransformer(FAST).parameters()) <= 2_200_000


@pytest.mark.parametrize("config", [PAPER, FAST], ids=["paper", "fast"])
def test_presets_turn_four_images_and_a_route_map_into_six_channels(config):
    model = make_model(config)
    assert model.needs == {"images", "intrinsics", "extrinsics", "route_map"}
    with torch.inference_mode():
        logits = model(make_inputs(config, batch=1))
    assert logits.shape == (1, 6, 192, 192)
    assert model.channels == CHANNELS


VARIANTS = {
    "upstream": SMALL,
    "camera": replace(SMALL, route_map="camera"),
    "bev": replace(SMALL, route_map="bev", ground_skip=True),
    "tied": replace(SMALL, positions="tied", decoder="light"),
    "fast": SMALL_FAST,
    "fast with ground": replace(SMALL_FAST, ground_skip=True),
    "ground alone": replace(SMALL_FAST, ground_skip=True, route_map="none"),
    "efficientnet": replace(SMALL, trunk="efficientnet_b4", image_size=(32, 64), scales=(4, 16)),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_gradients_reach_every_parameter(name):
    torch.manual_seed(0)
    model = CrossViewTransformer(VARIANTS[name])
    logits = model(make_inputs(VARIANTS[name]))
    assert logits.shape == (2, 2, 32, 32)
    (logits * torch.randn_like(logits)).sum().backward()
    still = [n for n, p in model.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0]
    assert still == []


@pytest.mark.parametrize("name", VARIANTS)
def test_every_input_that_it_needs_and_no_other_changes_the_output(name):
    model = make_model(VARIANTS[name])
    inputs = make_inputs(VARIANTS[name])
    with torch.no_grad():
        before = model(inputs)
        for given in inputs:
            flipped = {**inputs, given: inputs[given].flip(0)}
            assert torch.equal(model(flipped), before) is (given not in model.needs)


@pytest.mark.parametrize("config", [SMALL, SMALL_FAST], ids=["upstream", "fast"])
def test_the_order_of_cameras_does_not_matter(config):
    model = make_model(config)
    inputs = make_inputs(config)
    order = torch.tensor([2, 0, 3, 1])
    shuffled = dict(inputs)
    for name in ("images", "intrinsics", "extrinsics"):
        shuffled[name] = inputs[name][:, order]
    with torch.no_grad():
        torch.testing.assert_close(model(shuffled), model(inputs), rtol=0, atol=1e-5)


def test_the_fake_camera_is_one_more_image_with_the_last_cameras_intrinsics():
    model = make_model(replace(SMALL, route_map="camera"))
    plain = make_model(SMALL)
    plain.load_state_dict(model.state_dict())
    inputs = make_inputs(SMALL, cameras=3)
    inputs["route_map"][:] = 77  # however it is resized
    painted = torch.full((2, 1, *SMALL.image_size, 3), 77, dtype=torch.uint8)
    down = torch.tensor([[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 20], [0, 0, 0, 1.0]])
    four = {
        "images": torch.cat([inputs["images"], painted], 1),
        "intrinsics": inputs["intrinsics"][:, [0, 1, 2, 2]],
        "extrinsics": torch.cat([inputs["extrinsics"], down.expand(2, 1, 4, 4)], 1),
    }
    with torch.no_grad():
        torch.testing.assert_close(model(inputs), plain(four), rtol=0, atol=1e-6)


def test_samples_of_a_batch_do_not_mix():
    model = make_model(SMALL_FAST)
    inputs = make_inputs(SMALL_FAST, batch=3)
    with torch.no_grad():
        together = model(inputs)
        alone = model({name: value[1:2] for name, value in inputs.items()})
    torch.testing.assert_close(together[1:2], alone, rtol=0, atol=1e-5)


@pytest.mark.parametrize("route_map", ["bev", "camera"])
def test_a_rig_that_all_samples_share_may_be_given_once(route_map):
    config = replace(SMALL_FAST, route_map=route_map)
    model, inputs = make_model(config), make_inputs(config, batch=3)
    once = {name: inputs[name][:1] for name in ("intrinsics", "extrinsics")}
    repeated = {name: value.expand(3, -1, -1, -1) for name, value in once.items()}
    with torch.no_grad():
        torch.testing.assert_close(model({**inputs, **once}), model({**inputs, **repeated}))


def test_bfloat16_autocast_stays_close():
    model = make_model(SMALL_FAST)
    inputs = make_inputs(SMALL_FAST)
    with torch.no_grad():
        exact = model(inputs)
        with torch.autocast("cpu", torch.bfloat16):
            rough = model(inputs)
    assert (rough.float() - exact).abs().max() < 0.05 * exact.abs().max()


def test_images_of_another_size_are_an_error_that_names_both():
    inputs = make_inputs(replace(SMALL, image_size=(24, 32)))
    with pytest.raises(ValueError, match=re.escape("(2, 4, 24, 32, 3)") + ".*16 x 32"):
        make_model(SMALL)(inputs)


def test_poses_of_fewer_cameras_than_images_are_an_error():
    inputs = make_inputs(SMALL)
    inputs["extrinsics"] = inputs["extrinsics"][:, :3]
    with pytest.raises(ValueError, match=r"extrinsics is \(2, 3, 4, 4\)"):
        make_model(SMALL)(inputs)


def test_a_missing_input_is_named():
    inputs = make_inputs(SMALL_FAST)
    del inputs["route_map"]
    with pytest.raises(ValueError, match="route_map is missing"):
        make_model(SMALL_FAST)(inputs)


@pytest.mark.parametrize("config", [PAPER, FAST, SMALL])
def test_configurations_survive_json(config):
    assert CVTConfig.from_json(json.loads(json.dumps(config.as_json()))) == config


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"positions": "learned"}, "positions must be one of .*'learned'"),
        ({"route_map": True}, "route_map must be one of .*True"),
        ({"channels": ("road", "river")}, "channels .*river"),
        ({"channels": ()}, "at least one"),
        ({"scales": (4, 32)}, r"scales .*\(4, 32\)"),
        ({"scales": ()}, "scales"),
        ({"image_size": (100, 240)}, r"multiples of .* 16, got \(100, 240\)"),
        ({"dim": 130}, "dim must be a multiple"),
        ({"dim": 64, "positions": "fourier"}, "at least 23 channels per head"),
        ({"heads": 0}, "heads must be an int >= 1, got 0"),
        ({"trunk_blocks": (1,)}, "as many as trunk_widths"),
        ({"trunk_widths": (24, 0, 96, 128)}, "trunk_widths must be positive"),
        ({"trunk_blocks": (0, 1, 1, -1)}, "trunk_blocks must be ints from 0"),
        ({"geometry": BEVGeometry(size=200, ego_row=100)}, "multiple of 16, got 200"),
    ],
)
def test_a_bad_configuration_is_an_error_that_shows_the_value(fields, message):
    with pytest.raises(ValueError, match=message):
        replace(PAPER, **fields)
