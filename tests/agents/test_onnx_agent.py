"""ONNX agents: small models whose action is linear in what they are fed, and the shipped policy."""

import sys

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env
from agents import Agent, make_agent
from agents.onnx_agent import load_onnx_agent

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

SIZE = 64
SIDES = {"c": 6, "h": SIZE, "w": SIZE, "n": 5}
"""What symbolic dimensions stand for; a batch axis for 1."""


@pytest.fixture(scope="module")
def env():
    bev = {"size": SIZE, "px_per_m": 1.5, "ego_row": 50}
    return gym.make("BEVTown01-v0", bev=bev, time_limit_s=1.0)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "driver.onnx"


def save_model(path, *inputs, outputs=2, scale=1.0):
    """Write a model of (name, shape, type) inputs; returns its weights (features, outputs).

    Its output is the product of all inputs, flattened and joined, with the weights, which are
    random so that no scaling, reordering or mixing up of inputs goes unnoticed.
    """
    helper, kinds = onnx.helper, onnx.TensorProto
    sizes = [np.prod([_side(k, s) for k, s in enumerate(shape)]) for _, shape, _ in inputs]
    rng = np.random.default_rng(0)
    shape = int(sum(sizes)), outputs
    weights = (scale * rng.uniform(-1.0, 1.0, shape) / shape[0] / 255.0).astype(np.float32)
    nodes, flat = [], []
    for name, _, _ in inputs:
        flat.append(f"{name}_flat")
        nodes += [
            helper.make_node("Cast", [name], [f"{name}_float"], to=kinds.FLOAT),
            helper.make_node("Reshape", [f"{name}_float", "one_row"], [flat[-1]]),
        ]
    nodes += [
        helper.make_node("Concat", flat, ["joined"], axis=1),
        helper.make_node("MatMul", ["joined", "weights"], ["action"]),
    ]
    constants = [
        onnx.numpy_helper.from_array(weights, "weights"),
        onnx.numpy_helper.from_array(np.array([1, -1]), "one_row"),
    ]
    graph = helper.make_graph(
        nodes,
        "driver",
        [helper.make_tensor_value_info(n, getattr(kinds, kind), s) for n, s, kind in inputs],
        [helper.make_tensor_value_info("action", kinds.FLOAT, [1, outputs])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return weights


def _side(axis, side):
    return side if isinstance(side, int) else 1 if axis == 0 else SIDES.get(side, SIZE)


def expected(weights, *arrays):
    """The action for arrays, with sums in double precision."""
    return np.concatenate([np.ravel(array).astype(np.float64) for array in arrays]) @ weights


def assert_acts(agent, observation, wanted):
    action = agent.act(observation)
    assert action.dtype == np.float32
    assert np.abs(wanted).min() > 1e-4
    np.testing.assert_allclose(action, wanted, atol=1e-6)


@pytest.mark.parametrize("form", ["onnx:{}", "{}"])
def test_a_model_drives_by_its_path_on_one_core(form, path, env):
    weights = save_model(path, ("bev", [1, 6, SIZE, SIZE], "FLOAT"), scale=10.0)
    agent = make_agent(form.format(path), env)
    assert isinstance(agent, Agent)
    observation, _ = env.reset(seed=0)
    agent.reset(0)
    assert_acts(agent, observation, expected(weights, observation["bev"]))
    assert agent.act(observation) in env.action_space
    assert agent.session.get_session_options().intra_op_num_threads == 1
    assert agent.session.get_providers() == ["CPUExecutionProvider"]


@pytest.mark.parametrize("kind", ["FLOAT", "DOUBLE", "FLOAT16", "UINT8"])
@pytest.mark.parametrize("shape", [[1, 6, 64, 64], ["batch", 6, 64, 64], [None, "c", "h", None]])
@pytest.mark.parametrize("name", ["bev", "input_0"])
def test_an_image_is_fed_as_the_environment_gives_it(name, shape, kind, path, env):
    weights = save_model(path, (name, shape, kind), scale=10.0)
    observation, _ = env.reset(seed=0)
    agent = load_onnx_agent(path, env)
    assert_acts(agent, observation, expected(weights, observation["bev"]))


def test_two_inputs_are_fed_each_with_its_own(path, env):
    inputs = ("state", ["n", 3], "FLOAT"), ("image", ["n", 6, SIZE, SIZE], "FLOAT")
    weights = save_model(path, *inputs, scale=10.0)
    observation, _ = env.reset(seed=0)
    observation["measurements"][:] = 5.0, -0.5, 0.25
    wanted = expected(weights, observation["measurements"], observation["bev"])
    assert_acts(load_onnx_agent(path, env), observation, wanted)


def test_a_flat_input_is_fed_with_everything(path, env):
    weights = save_model(path, ("observation", [1, 6 * SIZE * SIZE + 3], "FLOAT"), scale=10.0)
    observation, _ = env.reset(seed=0)
    flat = gym.spaces.flatten(env.observation_space, observation)
    assert_acts(load_onnx_agent(path, env), observation, expected(weights, flat))


def test_an_image_input_also_takes_an_image_environment(path, env):
    wrapped = bev_driving_env.BEVOnly(env)
    weights = save_model(path, ("input", ["n", 6, "h", "w"], "FLOAT"), scale=10.0)
    observation, _ = wrapped.reset(seed=0)
    assert_acts(load_onnx_agent(path, wrapped), observation, expected(weights, observation))


def test_actions_beyond_the_range_are_clipped(path, env):
    weights = save_model(path, ("bev", [1, 6, SIZE, SIZE], "FLOAT"), scale=1e5)
    observation, _ = env.reset(seed=0)
    wanted = expected(weights, observation["bev"])
    assert np.abs(wanted).min() > 2.0
    assert load_onnx_agent(path, env).act(observation).tolist() == np.sign(wanted).tolist()


@pytest.mark.parametrize(("outputs", "scale"), [(3, 1.0), (1, 1.0), (0, 1.0), (2, np.nan)])
def test_an_output_that_is_no_action_is_refused(outputs, scale, path, env):
    save_model(path, ("bev", [1, 6, SIZE, SIZE], "FLOAT"), outputs=outputs, scale=scale)
    observation, _ = env.reset(seed=0)
    agent = load_onnx_agent(path, env)
    with pytest.raises(ValueError, match=r"one finite action \(1, 2\)"):
        agent.act(observation)


@pytest.mark.parametrize(
    ("wanted", "named"),
    [
        (("bev", [8, 6, 64, 64], "FLOAT"), "batch axis of 1"),
        (("bev", [], "FLOAT"), "batch axis"),
        (("bev", [1, 6, 64, 64], "INT64"), r"tensor\(int64\)"),
        (("memory", [1, 256], "FLOAT"), r"input 'memory'.*trained on Box\(256,\)"),
        (("x", [1, "n"], "FLOAT"), "name it after a key"),
        (("x", [1, 3, 192, 192], "FLOAT"), r"\(3, 192, 192\)"),
    ],
)
def test_an_input_that_cannot_be_fed_is_refused(wanted, named, path, env):
    save_model(path, wanted)
    with pytest.raises(ValueError, match=named):
        make_agent(str(path), env)


def test_without_onnxruntime_the_extra_is_named(path, env, monkeypatch):
    save_model(path, ("bev", [1, 6, SIZE, SIZE], "FLOAT"))
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ValueError, match=r"pip install 'bev-driving-env\[onnx\]'"):
        make_agent(str(path), env)


def test_a_file_that_is_no_model_is_refused_in_one_line(path, env, capfd):
    path.write_bytes(b"junk")
    with pytest.raises(
        ValueError, match=r"driver\.onnx is no ONNX model .*INVALID_PROTOBUF[^\n]*$"
    ):
        make_agent(str(path), env)
    with pytest.raises(ValueError, match="there is no file"):
        make_agent("onnx:nowhere/driver", env)
    assert capfd.readouterr() == ("", "")


def test_a_model_that_fails_while_driving_says_so_in_one_line(path, env, monkeypatch, capfd):
    """Its free axes promise any size, its weights fit another one."""
    monkeypatch.setitem(SIDES, "h", 32)
    save_model(path, ("bev", ["n", 6, "h", "w"], "FLOAT"))
    observation, _ = env.reset(seed=0)
    agent = make_agent(str(path), env)
    with pytest.raises(ValueError, match=r"run on bev \(1, 6, 64, 64\): .*MatMul[^\n]*$"):
        agent.act(observation)
    assert capfd.readouterr() == ("", "")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # PyTorch's, of its older exporter
def test_the_shipped_policy_drives_the_same_as_onnx(path):
    torch = pytest.importorskip("torch")
    from agents.beta import beta_mode
    from agents.beta_agent import load_beta_agent
    from agents.registry import agent_source

    class Driver(torch.nn.Module):
        def __init__(self, actor):
            super().__init__()
            self.actor = actor

        def forward(self, bev, measurements):
            return beta_mode(*self.actor(bev, measurements))

    env = gym.make("BEVTown01-v0")
    shipped = load_beta_agent(agent_source("bc"), env)
    torch.onnx.export(
        Driver(shipped._actor).eval(),
        (torch.zeros(1, 6, 192, 192, dtype=torch.uint8), torch.zeros(1, 3)),
        path,
        input_names=["bev", "measurements"],
        dynamo=False,
    )
    exported = make_agent(f"onnx:{path}", env)
    observation, _ = env.reset(seed=0, options={"episode": 1})
    actions = []
    for _ in range(120):
        action = shipped.act(observation)
        np.testing.assert_allclose(exported.act(observation), action, atol=1e-5)
        observation = env.step(action)[0]
        actions.append(action)
    assert np.ptp(actions, axis=0).min() > 0.05
