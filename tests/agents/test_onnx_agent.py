"""ONNX agents, with a module in the place of onnxruntime: it is an extra."""

import sys
import types
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env
from agents import Agent, make_agent
from agents.onnx_agent import ONNXAgent


class Input(NamedTuple):
    name: str
    shape: list
    type: str = "tensor(float)"


class Session:
    """A model with given inputs, whose action is given or follows from what it is fed."""

    def __init__(self, *inputs, output=((0.5, -0.25),)):
        self.inputs = inputs
        self.output = np.array(output, np.float32)
        self.fed = None

    def get_inputs(self):
        return list(self.inputs)

    def run(self, names, feeds):
        assert names is None
        self.fed = feeds
        return [self.output, np.zeros((1, 1), np.float32)]


@pytest.fixture(scope="module")
def env():
    bev = {"size": 64, "px_per_m": 1.5, "ego_row": 50}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=1.0)


@pytest.fixture
def runtime(monkeypatch):
    """A module like onnxruntime whose sessions are those of ``Session``; returns what it saw."""
    seen = types.SimpleNamespace(session=Session(Input("bev", [1, 6, 64, 64])), options=None)

    def load(path, sess_options, providers):
        if Path(path).read_bytes() != b"model":
            raise RuntimeError("INVALID_PROTOBUF\nand more")
        seen.options, seen.providers = sess_options, providers
        return seen.session

    module = types.ModuleType("onnxruntime")
    module.InferenceSession = load
    module.SessionOptions = types.SimpleNamespace
    monkeypatch.setitem(sys.modules, "onnxruntime", module)
    return seen


@pytest.fixture
def path(tmp_path):
    (tmp_path / "driver.onnx").write_bytes(b"model")
    return tmp_path / "driver.onnx"


@pytest.mark.parametrize("form", ["onnx:{}", "{}"])
def test_a_model_drives_by_its_path(form, path, env, runtime):
    agent = make_agent(form.format(path), env)
    assert isinstance(agent, Agent)
    observation, _ = env.reset(seed=0)
    agent.reset(0)
    action = agent.act(observation)
    assert action in env.action_space
    np.testing.assert_array_equal(action, np.float32([0.5, -0.25]))
    assert runtime.options.intra_op_num_threads == 1
    assert runtime.providers == ["CPUExecutionProvider"]


@pytest.mark.parametrize("kind", ["tensor(float)", "tensor(uint8)"])
@pytest.mark.parametrize("shape", [[1, 6, 64, 64], ["batch", 6, 64, 64], [None, "c", "h", "w"]])
@pytest.mark.parametrize("name", ["bev", "input_0"])
def test_an_image_is_fed_with_its_batch_axis_as_the_environment_gives_it(name, shape, kind, env):
    session = Session(Input(name, shape, kind))
    observation, _ = env.reset(seed=0)
    ONNXAgent(session, env).act(observation)
    assert session.fed.keys() == {name}
    assert session.fed[name].dtype == (np.uint8 if "uint8" in kind else np.float32)
    np.testing.assert_array_equal(session.fed[name], observation["bev"][None])


def test_two_inputs_are_fed_each_with_its_own(env):
    session = Session(Input("state", ["n", 3]), Input("image", ["n", 6, 64, 64]))
    observation, _ = env.reset(seed=0)
    ONNXAgent(session, env).act(observation)
    np.testing.assert_array_equal(session.fed["state"], observation["measurements"][None])
    np.testing.assert_array_equal(session.fed["image"], observation["bev"][None])


def test_a_flat_input_is_fed_with_everything(env):
    session = Session(Input("observation", [1, 6 * 64 * 64 + 3]))
    observation, _ = env.reset(seed=0)
    ONNXAgent(session, env).act(observation)
    expected = gym.spaces.flatten(env.observation_space, observation)
    np.testing.assert_array_equal(session.fed["observation"][0], expected.astype(np.float32))


def test_an_image_input_also_takes_an_image_environment(env):
    wrapped = bev_driving_env.BEVOnly(env)
    session = Session(Input("input", ["n", 6, "h", "w"]))
    observation, _ = wrapped.reset(seed=0)
    ONNXAgent(session, wrapped).act(observation)
    np.testing.assert_array_equal(session.fed["input"], observation[None])


def test_actions_beyond_the_range_are_clipped(env):
    observation, _ = env.reset(seed=0)
    session = Session(Input("bev", [1, 6, 64, 64]), output=[[3.0, -1.5]])
    assert ONNXAgent(session, env).act(observation).tolist() == [1.0, -1.0]


@pytest.mark.parametrize("output", [[[0.1, 0.2, 0.3]], [[np.nan, 0.0]], []])
def test_an_output_that_is_no_action_is_refused(output, env):
    observation, _ = env.reset(seed=0)
    agent = ONNXAgent(Session(Input("bev", [1, 6, 64, 64]), output=output), env)
    with pytest.raises(ValueError, match=r"one finite action \(1, 2\)"):
        agent.act(observation)


@pytest.mark.parametrize(
    ("wanted", "named"),
    [
        (Input("bev", [8, 6, 64, 64]), "batch axis of 1"),
        (Input("bev", []), "batch axis"),
        (Input("bev", [1, 6, 64, 64], "tensor(int64)"), r"tensor\(int64\)"),
        (Input("memory", [1, 256]), r"input 'memory'.*trained on Box\(256,\)"),
        (Input("x", [1, "n"]), "name it after a key"),
        (Input("x", [1, 3, 192, 192]), r"\(3, 192, 192\)"),
    ],
)
def test_an_input_that_cannot_be_fed_is_refused(wanted, named, env):
    with pytest.raises(ValueError, match=named):
        ONNXAgent(Session(wanted), env)


def test_without_onnxruntime_the_extra_is_named(path, env, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ValueError, match=r"pip install 'bev-driving-env\[onnx\]'"):
        make_agent(str(path), env)


def test_a_file_that_is_no_model_is_refused_in_one_line(path, env, runtime):
    path.write_bytes(b"junk")
    with pytest.raises(ValueError, match=r"driver\.onnx is no ONNX model .*INVALID_PROTOBUF$"):
        make_agent(str(path), env)
    with pytest.raises(ValueError, match="there is no file"):
        make_agent("onnx:nowhere/driver", env)


def test_a_real_model_drives(env, tmp_path):
    pytest.importorskip("onnxruntime")
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper

    # action = tanh(measurements[:2])
    nodes = [
        helper.make_node("Slice", ["measurements", "from", "to", "axes"], ["first"]),
        helper.make_node("Tanh", ["first"], ["action"]),
    ]
    constants = [("from", [0]), ("to", [2]), ("axes", [1])]
    graph = helper.make_graph(
        nodes,
        "driver",
        [helper.make_tensor_value_info("measurements", TensorProto.FLOAT, ["n", 3])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 2])],
        [helper.make_tensor(n, TensorProto.INT64, [1], v) for n, v in constants],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, tmp_path / "driver.onnx")
    agent = make_agent(str(tmp_path / "driver.onnx"), env)
    observation, _ = env.reset(seed=0)
    observation["measurements"][:] = 0.5, -0.3, 0.9
    np.testing.assert_allclose(agent.act(observation), np.tanh([0.5, -0.3]), rtol=1e-5)
