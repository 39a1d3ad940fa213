"""``save_source`` and ``ExportedSource``: a network in a file that needs none of its code."""

import copy
import json
import pickle
import subprocess
import sys
import warnings
import zipfile

import numpy as np
import pytest
import torch

import perception
from bev_driving_env.sources.checked import predict, predict_batch
from bev_driving_env.sources.protocol import BatchedBEVSource, BEVSourceError, SensorFrame
from bev_driving_env.sources.registry import make_bev_source
from perception.exported import ExportedSource, save_source

HEIGHT, WIDTH, SIZE = 6, 10, 16
SIZES = {"camera_size": (HEIGHT, WIDTH), "bev_size": SIZE}
SHAPES = ((1, 4, 3, HEIGHT, WIDTH), (1, 4, 3, 3), (1, 4, 4, 4), (1, 1, SIZE, SIZE), (1, 3))


class Sums(torch.nn.Module):
    """Linear in every input; batch normalisation and dropout tell training from evaluation."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.weigh = torch.nn.Conv2d(12, 2, 1)
        self.norm = torch.nn.BatchNorm2d(2)
        self.drop = torch.nn.Dropout(0.5)

    def forward(self, images, intrinsics, extrinsics, route_map, measurements):
        seen = self.drop(self.norm(self.weigh(images.flatten(1, 2))))
        seen = torch.nn.functional.interpolate(seen, size=(SIZE, SIZE))
        rest = intrinsics.sum() + 2.0 * extrinsics.sum() + measurements.sum()
        return seen + route_map + 0.01 * rest


class Probabilities(Sums):
    def forward(self, *inputs):
        return super().forward(*inputs).sigmoid()


class Inputs(torch.nn.Module):
    """Shows what it was given: a pixel of each image channel, then everything small."""

    def forward(self, images, intrinsics, extrinsics, route_map, measurements):
        rows = [
            images[0, :, :, 1, 2].flatten(),
            intrinsics.flatten()[:SIZE],
            extrinsics.flatten()[:SIZE],
            measurements.flatten(),
            route_map[0, 0, 3],
        ]
        rows = [torch.nn.functional.pad(row, (0, SIZE - row.shape[0])) for row in rows]
        plane = torch.nn.functional.pad(torch.stack(rows), (0, 0, 0, SIZE - len(rows)))
        return plane[None, None]


class Remembering(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.register_buffer("steps", torch.zeros(()))

    def forward(self, images, intrinsics, extrinsics, route_map, measurements):
        self.steps.add_(1.0)
        return route_map * self.steps


class Returning(torch.nn.Module):
    """Returns what a function makes of the route map."""

    def __init__(self, made):
        super().__init__()
        self.made = made

    def forward(self, images, intrinsics, extrinsics, route_map, measurements):
        return self.made(route_map)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    path = tmp_path_factory.mktemp("checkpoints") / "sums.pt2"
    save_source(Sums(), path, ("road", "lights"), "logits", **SIZES)
    return path


@pytest.fixture(scope="module")
def source(archive):
    return ExportedSource(archive)


def a_frame(seed=0, height=HEIGHT, width=WIDTH, size=SIZE):
    rng = np.random.default_rng(seed)
    return SensorFrame(
        rng.integers(0, 256, (4, height, width, 3), np.uint8),
        rng.random((4, 3, 3), np.float32),
        rng.random((4, 4, 4), np.float32),
        rng.integers(0, 256, (size, size), np.uint8),
        rng.random(3, np.float32),
    )


def tensors(frame):
    """The inputs of the network as its author would write them."""
    return (
        torch.tensor(frame.images).permute(0, 3, 1, 2)[None].float() / 255.0,
        torch.tensor(frame.intrinsics)[None],
        torch.tensor(frame.extrinsics)[None],
        torch.tensor(frame.route_map)[None, None].float() / 255.0,
        torch.tensor(frame.measurements)[None],
    )


def export_by_hand(path, module, shapes=SHAPES, metadata='{"channels": ["road"]}', **options):
    program = torch.export.export(module, tuple(map(torch.zeros, shapes)), **options)
    extra = {} if metadata is None else {"bevtown.json": metadata}
    torch.export.save(program, path, extra_files=extra)
    return path


def test_an_archive_predicts_what_its_network_does(source):
    frame = a_frame()
    with torch.no_grad():
        expected = Sums().eval()(*tensors(frame)).sigmoid()[0].numpy()
    planes = source(frame)
    assert planes.dtype == np.float32
    assert 0.01 < planes.std() < 0.5
    np.testing.assert_allclose(planes, expected, atol=1e-6)


def test_probabilities_are_returned_as_they_are_and_are_the_default(tmp_path):
    save_source(Probabilities(), tmp_path / "a.pt2", ["road", "lights"], **SIZES)
    frame = a_frame()
    with torch.no_grad():
        expected = Probabilities().eval()(*tensors(frame))[0].numpy()
    np.testing.assert_allclose(ExportedSource(tmp_path / "a.pt2")(frame), expected, atol=1e-6)


def test_the_network_is_given_every_input_in_its_units_and_layout(tmp_path):
    save_source(Inputs(), tmp_path / "a.pt2", ["road"], **SIZES)
    frame = a_frame()
    frame.images[0, 1, 2] = (0, 51, 255)
    frame.route_map[3, :2] = (255, 0)
    rows = ExportedSource(tmp_path / "a.pt2")(frame)[0]
    assert rows[0, :3].tolist() == pytest.approx([0.0, 0.2, 1.0])
    assert rows[0, :3].max() == 1.0
    np.testing.assert_allclose(rows[0, :12], frame.images[:, 1, 2].ravel() / 255.0, atol=1e-6)
    np.testing.assert_array_equal(rows[1], frame.intrinsics.ravel()[:SIZE])
    np.testing.assert_array_equal(rows[2], frame.extrinsics.ravel()[:SIZE])
    np.testing.assert_array_equal(rows[3, :3], frame.measurements)
    np.testing.assert_allclose(rows[4], frame.route_map[3] / 255.0, atol=1e-6)


def test_it_knows_its_channels_and_sizes(source, archive):
    assert source.channels == ("road", "lights")
    assert source.camera_size == (HEIGHT, WIDTH)
    assert source.bev_size == SIZE
    assert source.path == archive


def test_it_is_a_source_by_its_path(archive):
    assert type(make_bev_source(archive)) is type(make_bev_source(str(archive))) is ExportedSource
    assert type(perception.load_source(archive)) is ExportedSource


def test_a_batch_holds_the_same_bits_as_single_frames(source):
    assert isinstance(source, BatchedBEVSource)
    frames = [a_frame(seed) for seed in range(3)]
    singles = [predict("a", source, frame, SIZE) for frame in frames]
    np.testing.assert_array_equal(predict_batch("a", source, frames, SIZE), singles)
    assert (singles[0] != singles[1]).any()


def test_a_frame_is_left_as_it_was_and_may_be_read_only(source):
    frame, before = a_frame(), a_frame()
    for array in vars(frame).values():
        array.flags.writeable = False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        source(frame)
    for array, old in zip(vars(frame).values(), vars(before).values(), strict=True):
        np.testing.assert_array_equal(array, old)


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it))])
def test_a_copy_predicts_the_same(source, clone):
    np.testing.assert_array_equal(clone(source)(a_frame()), source(a_frame()))


def test_the_module_that_was_saved_stays_as_it_was(tmp_path):
    module = Sums()
    module.norm.eval()
    before = copy.deepcopy(module.state_dict())
    save_source(module, tmp_path / "a.pt2", ["road", "lights"], "logits", **SIZES)
    assert module.training
    assert not module.norm.training
    assert all(torch.equal(before[name], value) for name, value in module.state_dict().items())


def test_double_precision_is_brought_to_single(tmp_path):
    save_source(Probabilities().double(), tmp_path / "a.pt2", ["road", "lights"], **SIZES)
    assert ExportedSource(tmp_path / "a.pt2")(a_frame()).dtype == np.float32


def test_saving_and_loading_say_nothing_and_leave_one_file(tmp_path):
    program = (
        "import sys, torch; from perception.exported import *;"
        "module = torch.nn.Module();"
        "module.forward = lambda *inputs: inputs[3];"
        "path = sys.argv[1] + '/new/a.pt2'; save_source(module, path, ['road']); source = "
        "ExportedSource(path); print(source.camera_size, source.bev_size)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", program, str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    assert done.stdout.strip() == "(112, 240) 192"
    assert [each.name for each in (tmp_path / "new").iterdir()] == ["a.pt2"]


def test_the_same_network_gives_the_same_file(archive, tmp_path):
    save_source(Sums(), tmp_path / "b.pt2", ("road", "lights"), "logits", **SIZES)
    assert (tmp_path / "b.pt2").read_bytes() == archive.read_bytes()


def test_an_archive_exported_by_hand_is_read_too(tmp_path):
    path = export_by_hand(tmp_path / "a.pt2", Returning(lambda route_map: route_map * 0.5))
    frame = a_frame()
    source = ExportedSource(path)
    assert source.channels == ("road",)
    np.testing.assert_allclose(source(frame)[0], frame.route_map / 510.0, atol=1e-6)


@pytest.mark.parametrize(
    ("sizes", "named"),
    [
        ({"width": WIDTH + 1}, r"images of shape \(1, 4, 3, 6, 10\), got \(1, 4, 3, 6, 11\)"),
        ({"size": SIZE * 2}, r"route_map of shape \(1, 1, 16, 16\), got \(1, 1, 32, 32\)"),
    ],
)
def test_a_frame_of_other_sizes_is_refused(source, sizes, named):
    with pytest.raises(ValueError, match=f"sums.pt2 was exported for {named}"):
        source(a_frame(**sizes))
    with pytest.raises(BEVSourceError, match=named):
        predict("mine", source, a_frame(**sizes), SIZE)


@pytest.mark.parametrize(
    ("module", "options", "named"),
    [
        (Sums(), {"channels": ["road"]}, r"one tensor of shape \(1, 1, 16, 16\), got \(1, 2"),
        (Sums(), {"channels": ["road", "cars"]}, "has channel 'cars', which does not exist"),
        (Sums(), {"output": "odds"}, "output must be probabilities or logits, got 'odds'"),
        (Sums(), {"bev_size": 32}, "cannot be exported: "),
        (torch.nn.Linear(2, 2), {}, "cannot be exported: "),
        (Remembering(), {"channels": ["road"]}, "not remember anything, .* buffers steps"),
        (
            Returning(lambda it: (it,)),
            {"channels": ["road"]},
            "must return one tensor .* got tuple",
        ),
        (Returning(lambda it: it - 3), {"channels": ["road"]}, r'from -3 to -3;.*output="logits"'),
        (Returning(lambda it: it * torch.nan), {"channels": ["road"]}, "from nan to nan"),
    ],
)
def test_a_module_that_keeps_not_to_the_convention_is_not_saved(module, options, named, tmp_path):
    options = {"channels": ["road", "lights"], **SIZES, **options}
    with pytest.raises(ValueError, match=named):
        save_source(module, tmp_path / "a.pt2", **options)
    assert list(tmp_path.iterdir()) == []


def test_an_archive_is_saved_as_pt2(tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.pt2, got '.*a\.pth'"):
        save_source(Sums(), tmp_path / "a.pth", ["road", "lights"])


@pytest.mark.parametrize(
    ("metadata", "named"),
    [
        (None, "has no bevtown.json; write it with perception.exported.save_source"),
        ("{", "has a bevtown.json that is no JSON: JSONDecodeError"),
        ("[]", r"must be an object with channels, got \[\]"),
        ("{}", "must have channels = a tuple of names, got None"),
        ('{"channels": ["raod"]}', "has channel 'raod', which does not exist"),
        ('{"channels": ["road"], "output": 3}', "output must be probabilities or logits, got 3"),
    ],
)
def test_an_archive_with_another_description_is_refused(metadata, named, tmp_path, capfd):
    path = tmp_path / "a.pt2"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("archive/version", "0")
        if metadata is not None:
            file.writestr("archive/extra/bevtown.json", metadata)
    with pytest.raises(ValueError, match=f"^checkpoint '.*a.pt2'.*{named}"):
        ExportedSource(path)
    assert capfd.readouterr().err == ""


def test_a_file_that_is_no_archive_is_refused_without_a_word_from_torch(tmp_path, capfd):
    path = tmp_path / "a.pt2"
    path.write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"a\.pt2' is no torch.export archive: BadZipFile"):
        ExportedSource(path)
    assert capfd.readouterr().err == ""


def test_an_archive_without_a_network_is_refused(tmp_path):
    path = tmp_path / "a.pt2"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("archive/extra/bevtown.json", json.dumps({"channels": ["road"]}))
    with pytest.raises(ValueError, match=r"a\.pt2' cannot be loaded: "):
        ExportedSource(path)


def test_a_missing_file_is_called_missing(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"a\.pt2"):
        ExportedSource(tmp_path / "a.pt2")


@pytest.mark.parametrize(
    ("shapes", "took"),
    [
        (SHAPES[:4], r"\(1, 1, 16, 16\)$"),
        ((*SHAPES[:4], (1, 4)), r"\(1, 4\)$"),
        ((SHAPES[0][1:], *SHAPES[1:]), r"it takes \(4, 3, 6, 10\)"),
        (((2, *SHAPES[0][1:]), *SHAPES[1:]), r"it takes \(2, 4, 3, 6, 10\)"),
    ],
)
def test_a_network_with_other_inputs_is_refused(shapes, took, tmp_path):
    class Last(torch.nn.Module):
        def forward(self, *inputs):
            return inputs[3] * 1.0

    path = export_by_hand(tmp_path / "a.pt2", Last(), shapes)
    with pytest.raises(ValueError, match=rf"must take images, .*{took}"):
        ExportedSource(path)


def test_a_network_of_variable_size_is_refused(tmp_path):
    variable = {"images": {4: torch.export.Dim.DYNAMIC}}
    variable |= dict.fromkeys(("intrinsics", "extrinsics", "route_map", "measurements"))
    module = Returning(lambda route_map: route_map * 1.0)
    path = export_by_hand(tmp_path / "a.pt2", module, dynamic_shapes=variable)
    with pytest.raises(ValueError, match="of fixed shapes"):
        ExportedSource(path)


def test_a_network_that_remembers_is_refused_when_it_is_read(tmp_path):
    path = export_by_hand(tmp_path / "a.pt2", Remembering())
    with pytest.raises(ValueError, match=r"must not remember anything, but changes .* steps"):
        ExportedSource(path)


@pytest.mark.parametrize("path", ["a.onnx", "a", "a.pt2.zip", "a.PTH"])
def test_a_checkpoint_of_another_kind_is_refused_by_its_suffix(path):
    message = r"ends in '(\.onnx||\.zip|\.PTH)'; supported: \.pt2, \.safetensors$"
    with pytest.raises(ValueError, match=message):
        perception.load_source(path)


def test_without_torch_both_ways_say_how_to_get_it(archive, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match="pip install torch"):
        ExportedSource(archive)
    with pytest.raises(ImportError, match="pip install torch"):
        save_source(None, tmp_path / "a.pt2", ["road"])


def test_importing_perception_loads_nothing_heavy():
    program = (
        "import sys, perception; print(sorted({'torch', 'numpy', 'numba'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
