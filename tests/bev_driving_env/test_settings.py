"""The keywords of ``gym.make``: defaults, valid values, and what a wrong one is told."""

import gymnasium as gym
import pytest

import bev_driving_env
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.settings import EnvSettings
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.world.infractions import INFRACTIONS


def test_defaults_are_those_of_the_contract():
    settings = EnvSettings.from_keywords({})
    assert settings.bev_source == "ground_truth"
    assert settings.traffic == "none"
    assert settings.traffic_lights is False
    assert settings.appearance == "train"
    assert settings.cameras is False
    assert settings.camera_size == (112, 240)
    assert settings.camera_motion is True
    assert settings.max_speed_mps == 6.0
    assert set(settings.world_config(compiled_town("Town01")).terminate_on) == set(INFRACTIONS)


@pytest.mark.parametrize(
    "source",
    [
        "ground_truth",
        {"default": "ground_truth"},
        {"route": "ground_truth", "default": "ground_truth"},
        dict.fromkeys(
            ("road", "route", "lane", "vehicles", "pedestrians", "lights"), "ground_truth"
        ),
    ],
)
def test_ground_truth_may_be_asked_for_in_every_form(source):
    assert gym.make("BEVTown01-v0", bev_source=source).reset(seed=0)[0]["bev"].any()


@pytest.mark.parametrize("appearance", ["train", "test", "hard", "hard:night", 0, 12345])
def test_appearance_is_a_name_or_a_seed(appearance):
    assert EnvSettings(appearance=appearance).appearance == appearance


@pytest.mark.parametrize(
    ("keyword", "value", "named"),
    [
        ("bev_source", "cvt_kdee", r"'cvt_kdee'.*ground_truth"),
        ("bev_source", None, r"None.*ground_truth"),
        ("bev_source", "", r"''.*ground_truth"),
        ("bev_source", {"default": None}, r"None.*ground_truth"),
        ("bev_source", {"default": "perfect"}, r"'perfect'.*ground_truth"),
        ("bev_source", {"raod": "ground_truth"}, r"'raod'.*road, route, lane.*default"),
        ("bev_source", {"road": "ground_truth"}, r"'route'.*default"),
        ("traffic", "heavy", r"traffic must be.*'none', 'light', 'dense'.*'heavy'"),
        ("traffic", {"cars": 3}, r"keys vehicles and pedestrians.*'cars'"),
        ("traffic", {"vehicles": -3}, r"vehicles must be.*-3"),
        ("traffic", {"vehicles": 3000}, r"Town01 has room for \d+ vehicles, got 3000"),
        ("traffic", {"pedestrians": 30000}, r"Town01 has room for \d+ pedestrians, got 30000"),
        ("traffic", 7, r"traffic must be.*got 7"),
        ("traffic_lights", "on", r"traffic_lights must be True or False.*'on'"),
        ("cameras", 1, r"cameras must be True or False, got 1"),
        ("camera_rig", (), r"rig needs a tuple of Camera.*\(\)"),
        ("camera_rig", ("front",), r"rig needs a tuple of Camera.*front"),
        ("appearance", -1, r"at least 0.*-1"),
        ("appearance", "sunny", r"train, test, hard.*'sunny'"),
        ("appearance", True, r"train, test, hard.*True"),
        ("appearance", "train:dusk", r"'train:dusk'.*train:clear, train:overcast, train:wet$"),
        ("appearance", "night", r"train, test, hard, got 'night'.*'hard:night'"),
        ("camera_size", (8, 240), r"\(8, 240\)"),
        ("camera_size", (112,), r"\(112,\)"),
        ("camera_size", 112, r"112"),
        ("camera_motion", "yes", r"True or False.*'yes'"),
        ("max_speed_mps", 0.0, r"max_speed_mps.*0\.0"),
        ("max_speed_mps", "fast", r"max_speed_mps.*'fast'"),
        ("max_speed_mps", float("nan"), r"max_speed_mps.*nan"),
        ("time_limit_s", -1.0, r"time_limit_s.*-1\.0"),
        ("terminate_on", ("off_raod",), r"'off_raod'.*off_road, wrong_lane"),
        ("terminate_on", "off_road", r"'off_road'.*\('off_road', 'blocked'\)"),
        ("terminate_on", 5, r"terminate_on.*5"),
        ("bev", {"sise": 96}, r"'sise'.*size, px_per_m, ego_row"),
        ("bev", 96, r"BEVGeometry.*96"),
        ("vehicle", {"length_m": -1.0}, r"length_m.*-1\.0"),
        ("rules", {"deviation": 2.0}, r"'deviation'.*deviation_m"),
        ("reward", {"progress": -1.0}, r"progress.*-1\.0"),
    ],
)
def test_a_bad_value_is_refused_with_its_keyword_and_the_choices(keyword, value, named):
    with pytest.raises(ValueError, match=named):
        bev_driving_env.BEVTownEnv(**{keyword: value})


@pytest.mark.parametrize(
    ("keyword", "suggestion"),
    [("bev_sorce", "bev_source"), ("trafic", "traffic"), ("terminates_on", "terminate_on")],
)
def test_a_misspelt_keyword_is_refused_with_a_suggestion(keyword, suggestion):
    with pytest.raises(TypeError, match=f"{keyword!r}.*did you mean {suggestion!r}"):
        gym.make("BEVTown01-v0", **{keyword: None})


def test_a_keyword_like_no_other_is_refused_with_the_list():
    with pytest.raises(TypeError, match=r"'zzz'.*bev_source.*terminate_on") as error:
        bev_driving_env.BEVTownEnv(zzz=1)
    assert "did you mean" not in str(error.value)


@pytest.mark.parametrize("bev", [BEVGeometry(96, 2.5, 76), {"size": 96, "px_per_m": 2.5}])
def test_the_bev_geometry_may_be_changed(bev):
    env = gym.make("BEVTown01-v0", bev={**bev, "ego_row": 76} if isinstance(bev, dict) else bev)
    observation, _ = env.reset(seed=0)
    assert observation["bev"].shape == (6, 96, 96)
    assert observation in env.observation_space
    road, column = observation["bev"][0], 96 // 2
    assert road[76, column] == 255


def test_both_environments_take_the_same_keywords():
    with pytest.raises(TypeError, match="did you mean 'traffic'"):
        bev_driving_env.BEVTownVectorEnv(2, trafic="none")
    with pytest.raises(ValueError, match=r"'cvt_9000'.*ground_truth"):
        bev_driving_env.BEVTownVectorEnv(2, bev_source="cvt_9000")
