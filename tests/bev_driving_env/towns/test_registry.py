import json
import math
import uuid

import gymnasium as gym
import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env import BEVTownEnv, GridTown, draw_routes, register_town, road_network
from bev_driving_env.towns import routebook
from bev_driving_env.towns.registry import (
    compiled_town,
    register_builtin_towns,
    route_book,
    town_files,
    town_name,
    town_names,
)
from bev_driving_env.towns.town02 import TOWN02


def unique_name():
    """A name no other test of this process has registered."""
    return f"Toy_{uuid.uuid4().hex[:8]}"


def stadium():
    """A clockwise loop: 80 m east along y = 0, half a circle, 80 m west, half a circle."""
    network, quarter = RoadNetwork(), math.pi / 2.0
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [80.0, 0.0]))
    network.add_lane("b", "c", CircularLane([80.0, 20.0], 20.0, -quarter, quarter))
    network.add_lane("c", "d", StraightLane([80.0, 40.0], [0.0, 40.0]))
    network.add_lane("d", "a", CircularLane([0.0, 20.0], 20.0, quarter, 3 * quarter))
    return network


def drive_straight(env, steps):
    for _ in range(steps):
        _, _, terminated, _, info = env.step(np.array([0.5, 0.0], dtype=np.float32))
        assert not terminated
    return info


def test_a_users_town_drives_on_random_routes():
    name = unique_name()
    register_town(name, stadium)
    env = BEVTownEnv(town=name)
    obs, info = env.reset(seed=0)
    assert obs["bev"][0].any()
    assert obs["bev"][1].any()
    assert info["episode_id"].startswith(name)
    _, again = BEVTownEnv(town=name).reset(seed=0)
    assert again["route_length_m"] == info["route_length_m"]


def test_a_users_town_drives_between_any_two_places():
    name = unique_name()
    register_town(name, stadium)
    env = BEVTownEnv(town=name)
    _, info = env.reset(options={"start": (5.0, 0.0), "goal": (75.0, 0.5)})
    assert info["route_length_m"] == pytest.approx(70.0)
    info = drive_straight(env, 30)
    # 2.5 m/s^2 for 3 s
    assert info["route_m"] == pytest.approx(0.5 * 2.5 * 3.0**2, abs=0.5)
    assert info["infractions"] == []


def test_a_registered_town_is_made_by_its_id_too():
    name = unique_name()
    assert register_town(name, stadium) == f"BEV{name}-v0"
    env = gym.make(f"BEV{name}-v0")
    env.reset(seed=1)
    assert env.unwrapped.world.town.name == name


def test_a_town_brings_its_routes_along(tmp_path):
    path, name = tmp_path / "routes.json", unique_name()
    row = {"start": [10, 0], "turns": "", "end": [40, 40]}
    path.write_text(json.dumps({"episode": [row]}))
    register_town(name, stadium, routes=str(path))
    env = BEVTownEnv(town=name)
    _, info = env.reset(options={"episode": 0})
    assert info["route_length_m"] == pytest.approx(70.0 + 20.0 * math.pi + 40.0)
    assert info["episode_id"] == f"{name}/episode/0"


def test_a_town_is_built_once_and_only_when_it_is_first_used():
    calls, name = [], unique_name()

    def build():
        calls.append(1)
        return stadium()

    register_town(name, build)
    assert not calls
    assert compiled_town(name) is compiled_town(name)
    assert len(calls) == 1


def test_a_town_with_a_dead_end_is_refused_when_it_is_used():
    name = unique_name()

    def street():
        network = RoadNetwork()
        network.add_lane("here", "there", StraightLane([0.0, 0.0], [80.0, 0.0]))
        return network

    register_town(name, street)
    with pytest.raises(ValueError, match=f"{name}.*dead end at node 'there'"):
        BEVTownEnv(town=name)


def test_a_taken_name_is_refused_with_those_registered():
    name = unique_name()
    register_town(name, stadium)
    with pytest.raises(ValueError, match=f"{name}.* already registered.*Town01, Town02"):
        register_town(name, stadium)


@pytest.mark.parametrize("name", ["", "my town", "town-1", "Town/01", "Town03-v0", "Town03\n"])
def test_a_name_that_would_make_no_environment_id_is_refused(name):
    with pytest.raises(ValueError, match="letters, digits and _"):
        register_town(name, stadium)
    assert name not in town_names()


def test_an_unknown_town_is_refused_with_those_registered():
    with pytest.raises(ValueError, match=r"unknown town 'Town99'.*Town01, Town02"):
        road_network("Town99")
    with pytest.raises(ValueError, match=r"unknown town 'Town99'.*Town01, Town02"):
        BEVTownEnv(town="Town99")


def test_registering_the_builtin_towns_again_is_harmless():
    before = town_names()
    register_builtin_towns()
    assert town_names() == before
    assert {"BEVTown01-v0", "BEVTown02-v0"} <= set(gym.registry)


@pytest.mark.parametrize("build", [None, 123, "Town01"])
def test_a_build_that_cannot_be_called_is_refused_at_once(build):
    name = unique_name()
    with pytest.raises(TypeError, match=repr(build)):
        register_town(name, build)
    assert name not in town_names()


def test_a_build_that_returns_no_road_network_is_named():
    name = unique_name()
    register_town(name, lambda: {"a": "b"})
    with pytest.raises(TypeError, match=f"{name}.*RoadNetwork.*dict"):
        BEVTownEnv(town=name)


def test_a_broken_town_can_be_put_right_with_overwrite():
    name = unique_name()
    register_town(name, lambda: None)
    register_town(name, stadium, overwrite=True)
    assert BEVTownEnv(town=name).reset(seed=0)[1]["route_length_m"] > 0.0


RING = GridTown(
    columns={"A": 0.0, "B": 400.0},
    rows={"1": 0.0, "2": 300.0},
    links="A1-B1 B1-B2 A2-B2 A1-A2",
    junctions="",
    corners="A1 10  B1 10  B2 10  A2 10",
)


def test_a_table_is_a_town():
    name = unique_name()
    register_town(name, TOWN02)
    ours, theirs = compiled_town(name), compiled_town("Town02")
    assert [lane.index for lane in ours.lanes] == [lane.index for lane in theirs.lanes]
    assert ours.bounds == theirs.bounds


def test_drawn_routes_are_there_at_once_and_again_when_read(tmp_path, monkeypatch):
    monkeypatch.setattr(routebook, "POOL", 120)
    name, path = unique_name(), tmp_path / "routes.json"
    register_town(name, RING, routes=path)
    path.write_text(json.dumps({"episode": [{"start": [20, 2], "turns": "", "end": [60, 2]}]}))
    assert route_book(name).size("val") == 0
    drawn = draw_routes(name, path)
    assert route_book(name).suites == drawn.suites
    assert (drawn.size("val"), drawn.size("episode")) == (50, 1)
    _, info = BEVTownEnv(town=name).reset(options={"split": "test", "index": 49})
    assert 80.0 <= info["route_length_m"] <= 400.0


def test_a_file_that_holds_no_routes_stays_as_it_is(tmp_path):
    name, path = unique_name(), tmp_path / "routes.json"
    register_town(name, RING)
    path.write_text("[]")
    with pytest.raises(ValueError, match=r"routes\.json is not a route file"):
        draw_routes(name, path)
    assert path.read_text() == "[]"


@pytest.fixture
def village(tmp_path, monkeypatch):
    """A module that registers the town Village_xxx, and its name."""
    monkeypatch.syspath_prepend(tmp_path)
    name = unique_name()
    module = f"module_of_{name}"
    (tmp_path / f"{module}.py").write_text(
        "from bev_driving_env import register_town\n"
        "from bev_driving_env.towns.town02 import TOWN02\n"
        f"register_town({name!r}, TOWN02, routes={str(tmp_path / 'routes.json')!r})\n"
    )
    return module, name


def test_a_town_is_named_by_the_module_that_registers_it(village, tmp_path):
    module, name = village
    assert town_name(f"{module}:{name}") == name
    assert compiled_town(f"{module}:{name}") is compiled_town(name)
    assert BEVTownEnv(town=f"{module}:{name}").world.town.name == name
    files = town_files(f"{module}:{name}")
    assert files == (tmp_path / f"{module}.py", tmp_path / "routes.json")
    assert town_files("Town01") == ()


def test_a_module_that_cannot_be_imported_or_registers_no_such_town_is_told(village):
    module, _ = village
    with pytest.raises(ValueError, match=r"town 'no_such_module:Grove' cannot be loaded: ModuleNo"):
        compiled_town("no_such_module:Grove")
    with pytest.raises(ValueError, match=rf"unknown town '{module}:Grove'; registered.*Town01"):
        compiled_town(f"{module}:Grove")
