"""``EfficientNetB4``: sizes, names and arithmetic of the published network."""

import re

import pytest
import torch
from safetensors.torch import save_file
from torch.nn import functional

from perception.models.efficientnet import EfficientNetB4, load_published

# kernel, stride, expansion, widths in and out; from the published table of B4
BLOCKS = [
    (3, 1, 1, 48, 24), (3, 1, 1, 24, 24),
    (3, 2, 6, 24, 32), (3, 1, 6, 32, 32), (3, 1, 6, 32, 32), (3, 1, 6, 32, 32),
    (5, 2, 6, 32, 56), (5, 1, 6, 56, 56), (5, 1, 6, 56, 56), (5, 1, 6, 56, 56),
    (3, 2, 6, 56, 112),
]  # fmt: skip


def published():
    """A state dict with names and shapes as ``efficientnet_pytorch`` has them."""
    torch.manual_seed(0)
    weights = {}

    def norm(name, width):
        weights[f"{name}.weight"] = 1.0 + 0.1 * torch.randn(width)
        weights[f"{name}.bias"] = 0.1 * torch.randn(width)
        weights[f"{name}.running_mean"] = 0.1 * torch.randn(width)
        weights[f"{name}.running_var"] = 0.5 + torch.rand(width)
        weights[f"{name}.num_batches_tracked"] = torch.tensor(7)

    weights["_conv_stem.weight"] = 0.2 * torch.randn(48, 3, 3, 3)
    norm("_bn0", 48)
    for i, (kernel, _, expand, before, after) in enumerate(BLOCKS):
        block, wide, thin = f"_blocks.{i}", before * expand, before // 4
        if expand > 1:
            weights[f"{block}._expand_conv.weight"] = 0.2 * torch.randn(wide, before, 1, 1)
            norm(f"{block}._bn0", wide)
        weights[f"{block}._depthwise_conv.weight"] = 0.2 * torch.randn(wide, 1, kernel, kernel)
        norm(f"{block}._bn1", wide)
        weights[f"{block}._se_reduce.weight"] = 0.1 * torch.randn(thin, wide, 1, 1)
        weights[f"{block}._se_reduce.bias"] = 0.1 * torch.randn(thin)
        weights[f"{block}._se_expand.weight"] = 0.1 * torch.randn(wide, thin, 1, 1)
        weights[f"{block}._se_expand.bias"] = 0.1 * torch.randn(wide)
        weights[f"{block}._project_conv.weight"] = 0.1 * torch.randn(after, wide, 1, 1)
        norm(f"{block}._bn2", after)
    weights["_blocks.11._expand_conv.weight"] = torch.zeros(672, 112, 1, 1)
    weights["_conv_head.weight"] = torch.zeros(1792, 448, 1, 1)
    weights["_fc.bias"] = torch.zeros(1000)
    return weights


def same(x, weight, stride, trained_at, groups=1):
    """TensorFlow's convolution that keeps the side, padded as for the side it was trained at."""
    kernel = weight.shape[-1]
    total = max((-(-trained_at // stride) - 1) * stride + kernel - trained_at, 0)
    before = total // 2
    padded = functional.pad(x, (before, total - before) * 2)
    return functional.conv2d(padded, weight, None, stride, groups=groups)


def transcribed(weights, images):
    """Outputs of stem and blocks, in double precision."""
    weights = {name: value.double() for name, value in weights.items()}

    def norm(name, x):
        mean, var, scale, shift = (
            weights[f"{name}.{part}"][:, None, None]
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / (var + 1e-3).sqrt() * scale + shift

    def swish(x):
        return x * torch.sigmoid(x)

    side = 380
    x = swish(norm("_bn0", same(images.double(), weights["_conv_stem.weight"], 2, side)))
    side, outputs = 190, []
    for i, (_, stride, expand, before, after) in enumerate(BLOCKS):
        block = f"_blocks.{i}"
        y = x
        if expand > 1:
            expanded = torch.einsum(
                "bchw,oc->bohw", y, weights[f"{block}._expand_conv.weight"][..., 0, 0]
            )
            y = swish(norm(f"{block}._bn0", expanded))
        depthwise = weights[f"{block}._depthwise_conv.weight"]
        y = swish(norm(f"{block}._bn1", same(y, depthwise, stride, side, groups=len(depthwise))))
        side = -(-side // stride)
        pooled = y.mean((2, 3))
        squeezed = swish(
            pooled @ weights[f"{block}._se_reduce.weight"][..., 0, 0].T
            + weights[f"{block}._se_reduce.bias"]
        )
        excited = (
            squeezed @ weights[f"{block}._se_expand.weight"][..., 0, 0].T
            + weights[f"{block}._se_expand.bias"]
        )
        y = y * torch.sigmoid(excited)[:, :, None, None]
        y = norm(
            f"{block}._bn2",
            torch.einsum("bchw,oc->bohw", y, weights[f"{block}._project_conv.weight"][..., 0, 0]),
        )
        x = x + y if stride == 1 and before == after else y
        outputs.append(x)
    return outputs


def test_features_have_the_sizes_of_the_first_block_of_each_stride():
    trunk = EfficientNetB4((2, 4, 8, 16)).eval()
    with torch.no_grad():
        features = trunk(torch.zeros(1, 3, 224, 480))
    assert [tuple(feature.shape[1:]) for feature in features] == [
        (48, 112, 240), (32, 56, 120), (56, 28, 60), (112, 14, 30)
    ]  # fmt: skip
    assert trunk.widths == (48, 32, 56, 112)


def test_it_holds_no_more_than_it_runs():
    assert sum(p.numel() for p in EfficientNetB4((4, 16)).parameters()) == 340_160
    assert len(EfficientNetB4((4,))._blocks) == 3


def test_it_computes_what_the_formulas_say():
    weights = published()
    trunk = EfficientNetB4((4, 8, 16)).eval()
    trunk.load_state_dict({name: weights[name] for name in trunk.state_dict()})
    images = torch.randn(2, 3, 64, 96)
    with torch.no_grad():
        features = trunk(images)
    outputs = transcribed(weights, images)
    for feature, block in zip(features, (2, 6, 10), strict=True):
        expected = outputs[block]
        torch.testing.assert_close(
            feature.double(), expected, rtol=0, atol=1e-5 * float(expected.abs().max())
        )


def test_blocks_are_skipped_at_random_in_training_only():
    torch.manual_seed(0)
    trunk = EfficientNetB4((8,))
    images = torch.randn(1, 3, 32, 32)
    for module in trunk.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.eval()
    with torch.no_grad():
        trained = {float(trunk(images)[0].sum()) for _ in range(60)}
        trunk.eval()
        evaluated = {float(trunk(images)[0].sum()) for _ in range(3)}
    assert len(trained) > 1
    assert len(evaluated) == 1


@pytest.mark.parametrize("ending", [".pth", ".safetensors"])
def test_published_weights_load_by_name_and_the_rest_is_ignored(tmp_path, ending):
    weights = published()
    del weights["_bn0.num_batches_tracked"]
    path = tmp_path / f"b4{ending}"
    (save_file if ending == ".safetensors" else torch.save)(weights, path)
    trunk = EfficientNetB4((4, 16))
    load_published(trunk, path)
    loaded = trunk.state_dict()
    assert set(loaded) - set(weights) == {"_bn0.num_batches_tracked"}
    assert all(torch.equal(loaded[name], weights[name]) for name in set(loaded) & set(weights))


def test_a_missing_weight_is_an_error_that_names_it(tmp_path):
    weights = published()
    del weights["_blocks.3._depthwise_conv.weight"]
    torch.save(weights, tmp_path / "b4.pth")
    with pytest.raises(ValueError, match=re.escape("lacks _blocks.3._depthwise_conv.weight")):
        load_published(EfficientNetB4(), tmp_path / "b4.pth")


def test_weights_of_another_width_are_an_error_that_shows_both(tmp_path):
    weights = published()
    weights["_conv_stem.weight"] = torch.zeros(32, 3, 3, 3)
    torch.save(weights, tmp_path / "b0.pth")
    with pytest.raises(ValueError, match=r"\(32, 3, 3, 3\).*\(48, 3, 3, 3\)"):
        load_published(EfficientNetB4(), tmp_path / "b0.pth")


class Foreign:
    """Something that a pickle could run."""


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.safetensors", b"x" * 40), ("a.pth", b"no pickle"), ("b.pth", Foreign()), ("c.pth", [1])],
)
def test_a_file_without_weights_is_one_clear_error(tmp_path, name, content):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        load_published(EfficientNetB4((4,)), path)


def test_no_file_is_an_error():
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load_published(EfficientNetB4((4,)), "nowhere.pth")
