"""``register_bev_source`` and ``make_bev_source``."""

import importlib.util
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import perception
from bev_driving_env.sources import registry
from bev_driving_env.sources.ground_truth import GroundTruth
from bev_driving_env.sources.protocol import BEVSource, PrivilegedSource
from bev_driving_env.sources.registry import (
    bev_source_names,
    make_bev_source,
    register_bev_source,
    source_file,
    source_name,
)


class Mine:
    """The least that a source can be."""

    channels = ("road", "lane")

    def reset(self):
        pass

    def __call__(self, frame):
        return np.zeros((2, 192, 192), np.uint8)


class Privileged(PrivilegedSource):
    channels = ("road",)
    needs_frame = False
    needs_truth = True

    def reset(self):
        pass

    def perceive(self, frame, truth):
        return truth[:1]


def lacking(name, kind=Mine):
    """A source without one of its attributes."""
    body = {key: value for key, value in vars(kind).items() if key not in (name, "__dict__")}
    return type("Lacking", kind.__bases__, body)()


def having(channels):
    return type("Having", (Mine,), {"channels": channels})()


@pytest.fixture(autouse=True)
def _registry_as_it_was(monkeypatch):
    monkeypatch.setattr(registry, "_factories", dict(registry._factories))
    monkeypatch.setattr(perception, "SOURCES", dict(perception.SOURCES))


@pytest.fixture
def my_sources(monkeypatch):
    """A module ``my_sources`` as a user would write one."""

    def broken():
        raise ZeroDivisionError("in the factory\nand more")

    module = types.ModuleType("my_sources")
    module.Mine = Mine
    module.make = lambda: Mine()
    module.number = 3
    module.nothing = lambda: None
    module.a_class = lambda: Mine
    module.broken = broken
    monkeypatch.setitem(sys.modules, "my_sources", module)


def test_a_registered_source_is_made_by_name_anew_each_time():
    register_bev_source("mine-2_b", Mine)
    first, second = make_bev_source("mine-2_b"), make_bev_source("mine-2_b")
    assert type(first) is type(second) is Mine
    assert first is not second


def test_ground_truth_is_made_by_name():
    assert type(make_bev_source("ground_truth")) is GroundTruth


@pytest.mark.skipif(
    importlib.util.find_spec("bev_driving_env.sources.ipm") is None, reason="no ipm yet"
)
def test_ipm_is_made_by_name():
    assert isinstance(make_bev_source("ipm"), BEVSource)


def test_predictors_are_found_by_the_names_that_perception_lists(my_sources):
    perception.SOURCES["cvt_test"] = "my_sources:make"
    assert type(make_bev_source("cvt_test")) is Mine


def test_names_are_the_built_in_ones_then_those_of_perception_then_registered_ones():
    perception.SOURCES["cvt_test"] = "my_sources:make"
    register_bev_source("mine", Mine)
    names = bev_source_names()
    assert names[:2] == ("ground_truth", "ipm")
    assert names.index("cvt_test") < names.index("mine") == len(names) - 1


def test_a_taken_name_is_refused_unless_it_is_to_be_replaced():
    register_bev_source("mine", Mine)
    with pytest.raises(ValueError, match=r"'mine' is already registered.*ground_truth, ipm.*mine"):
        register_bev_source("mine", Privileged)
    assert type(make_bev_source("mine")) is Mine
    register_bev_source("mine", Privileged, overwrite=True)
    assert type(make_bev_source("mine")) is Privileged


@pytest.mark.parametrize("name", ["ground_truth", "ipm", "cvt_test"])
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_built_in_name_stays_what_it_is(name, overwrite):
    perception.SOURCES["cvt_test"] = "my_sources:make"
    with pytest.raises(ValueError, match=f"{name!r} is built in"):
        register_bev_source(name, Mine, overwrite=overwrite)
    assert name not in registry._factories


@pytest.mark.parametrize("name", ["", "a:b", "a/b", "a\\b", "a.pt2", "a b", "a\n", 3, None])
def test_a_name_of_other_characters_is_refused(name):
    with pytest.raises(ValueError, match="letters, digits, _ and -") as error:
        register_bev_source(name, Mine)
    assert repr(name) in str(error.value)


@pytest.mark.parametrize("factory", [None, "my_sources:make", 3])
def test_a_factory_that_cannot_be_called_is_refused(factory):
    with pytest.raises(TypeError, match=r"'mine' must be a function .*, got ") as error:
        register_bev_source("mine", factory)
    assert repr(factory) in str(error.value)


def test_a_source_in_place_of_its_factory_is_refused():
    with pytest.raises(TypeError, match=r"got a source itself; pass its class, or lambda: Mine"):
        register_bev_source("mine", Mine())


@pytest.mark.parametrize("spec", ["my_sources:make", "my_sources:Mine"])
def test_a_factory_or_class_is_found_by_module_and_name(spec, my_sources):
    assert type(make_bev_source(spec)) is Mine


@pytest.mark.parametrize("kind", [Mine, Privileged])
def test_a_source_is_returned_as_it_is(kind):
    source = kind()
    assert make_bev_source(source) is source


@pytest.mark.parametrize("form", [str, Path])
def test_a_file_is_a_checkpoint(form, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(perception, "load_source", lambda path: asked.append(path) or Mine())
    path = tmp_path / "weights.pt2"
    path.touch()
    assert type(make_bev_source(form(path))) is Mine
    assert asked == [path]


def test_a_name_goes_before_a_file_of_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ground_truth").touch()
    assert type(make_bev_source("ground_truth")) is GroundTruth
    assert source_file("ground_truth") is None


def test_a_file_of_an_unknown_kind_is_refused_with_the_known_kinds(tmp_path):
    path = tmp_path / "weights.onnx"
    path.touch()
    with pytest.raises(ValueError, match=r"cannot be made: .*'\.onnx'; supported: \.pt2"):
        make_bev_source(path)


@pytest.mark.parametrize("spec", ["x", "", ":", "my_sources:", ":make", "a:b:c", "x" * 5000, "\0"])
def test_an_unknown_name_is_refused_with_what_there_is(spec, my_sources):
    register_bev_source("mine", Mine)
    with pytest.raises(ValueError, match=r"^unknown bev_source") as error:
        make_bev_source(spec)
    message = str(error.value)
    assert message == (
        f"unknown bev_source {spec!r}; available sources: {', '.join(bev_source_names())}; "
        "or 'module:factory', or the path of a checkpoint; SOURCE~MODEL=DOSE for one behind "
        "error models"
    )
    assert "ground_truth, ipm, " in message
    assert "mine" in message


def test_a_misspelt_name_is_refused_with_the_nearest_one():
    with pytest.raises(ValueError, match="did you mean 'ground_truth'"):
        make_bev_source("ground-truth")


@pytest.mark.parametrize("form", [str, Path])
def test_a_checkpoint_that_is_not_there_is_called_missing(form, tmp_path):
    with pytest.raises(ValueError, match=r"no\.pt2'; .*; there is no such file"):
        make_bev_source(form(tmp_path / "no.pt2"))


@pytest.mark.parametrize(
    ("spec", "named"),
    [
        ("no_such_module_xyz:make", "cannot be loaded: ModuleNotFoundError: .*no_such_module_xyz"),
        ("my_sources:sailing", "cannot be loaded: AttributeError: .*sailing"),
        ("my_sources:number", "must name a factory or a class, got 3"),
        ("my_sources:broken", "cannot be made: ZeroDivisionError: in the factory$"),
        ("my_sources:nothing", "got NoneType without channels"),
        ("my_sources:a_class", "got the class Mine"),
    ],
)
def test_a_spec_that_leads_to_no_source_is_refused_with_the_reason(spec, named, my_sources):
    with pytest.raises(ValueError, match=named) as error:
        make_bev_source(spec)
    assert str(error.value).startswith(f"bev_source {spec!r} ")


def test_the_error_of_a_registered_factory_is_chained(my_sources):
    register_bev_source("mine", sys.modules["my_sources"].broken)
    with pytest.raises(ValueError, match="'mine' cannot be made") as error:
        make_bev_source("mine")
    assert type(error.value.__cause__) is ZeroDivisionError


@pytest.mark.parametrize(
    ("thing", "missing"),
    [
        (lacking("channels"), "channels"),
        (lacking("reset"), r"reset\(\)"),
        (lacking("__call__"), r"__call__\(frame\)"),
        (lacking("needs_frame", Privileged), "needs_frame"),
        (lacking("needs_truth", Privileged), "needs_truth"),
        (lambda frame: None, r"channels, reset\(\)"),
        ({"road": "ipm"}, r"channels, reset\(\), __call__\(frame\)"),
        (None, r"channels, reset\(\), __call__\(frame\)"),
    ],
)
def test_an_object_that_is_no_source_is_refused_with_what_it_lacks(thing, missing):
    with pytest.raises(ValueError, match=f"got {type(thing).__name__} without {missing}$"):
        make_bev_source(thing)


def test_a_class_is_no_source():
    with pytest.raises(ValueError, match=r"got the class Mine; make one of it: Mine\("):
        make_bev_source(Mine)


@pytest.mark.parametrize("channels", ["road", (), ("raod",), ("road", "road"), None])
def test_a_source_with_other_channels_is_refused(channels):
    register_bev_source("mine", lambda: having(channels))
    with pytest.raises(ValueError, match=r"^bev_source 'mine' (must have|has channel)"):
        make_bev_source("mine")


def test_a_spec_is_shown_as_written_and_an_object_by_its_class():
    assert source_name("mine") == "mine"
    assert source_name("a:b") == "a:b"
    assert source_name(Path("runs") / "a.pt2") == str(Path("runs") / "a.pt2")
    assert source_name(Mine()) == "Mine"


def test_the_file_of_a_spec_is_the_checkpoint_or_the_module(tmp_path, monkeypatch):
    module = tmp_path / "my_sources_on_disk.py"
    module.write_text("class Mine: pass\n", encoding="utf-8")
    checkpoint = tmp_path / "a.pt2"
    checkpoint.touch()
    monkeypatch.syspath_prepend(tmp_path)
    assert source_file("my_sources_on_disk:Mine") == module
    assert source_file(checkpoint) == source_file(str(checkpoint)) == checkpoint
    monkeypatch.delitem(sys.modules, "my_sources_on_disk")


def test_names_objects_and_modules_without_a_file_have_none(my_sources):
    register_bev_source("mine", Mine)
    for spec in ("ground_truth", "mine", "no such thing", Mine(), "my_sources:Mine"):
        assert source_file(spec) is None


def test_the_file_of_a_module_that_is_not_there_is_an_error():
    with pytest.raises(ValueError, match="'no_such_module_xyz:make' cannot be loaded"):
        source_file("no_such_module_xyz:make")


def test_looking_up_names_loads_neither_torch_nor_a_predictor():
    program = (
        "import sys, bev_driving_env.sources.registry as registry;"
        "registry.bev_source_names(); registry.make_bev_source('ground_truth');"
        "print(sorted({'torch', 'stable_baselines3', 'perception.exported'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
