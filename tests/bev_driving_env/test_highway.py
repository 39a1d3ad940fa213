"""``BEVObservation`` on highway-env's own environments, against highway-env's own geometry."""

import warnings

import gymnasium as gym
import highway_env  # noqa: F401  # registers the ids
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bev_driving_env import BEVObservation
from bev_driving_env.frames import BEVGeometry

IDS = ("highway-v0", "merge-v1", "roundabout-v1", "intersection-v2", "racetrack-v1")
WITH_A_ROUTE = ("roundabout-v1", "intersection-v2")
ROAD, ROUTE, LANE, VEHICLES, PEDESTRIANS, LIGHTS = range(6)
ON = 255


@pytest.fixture(scope="module", params=IDS)
def env(request):
    config = {"vehicles_count": 12} if request.param == "highway-v0" else None  # 50 are slow
    made = BEVObservation(gym.make(request.param, config=config))
    yield made
    made.close()


def moments(env, resets=2, steps=2):
    """(view, env.unwrapped) right after several resets and a few steps of just going on."""
    discrete = isinstance(env.action_space, gym.spaces.Discrete)
    action = 1 if discrete else np.zeros(env.action_space.shape, np.float32)
    for seed in range(resets):
        observation, _ = env.reset(seed=seed)
        yield observation["bev"], env.unwrapped
        for _ in range(steps):
            observation, _, terminated, truncated, _ = env.step(action)
            yield observation["bev"], env.unwrapped
            if terminated or truncated:
                break


def pixel_of(ego, point):
    """(row, column) of a world point, written out from the contract: u = -5y + 96, v = -5x + 152.

    The world's y axis points south, the ego's to the left.
    """
    (dx, dy), h = np.asarray(point) - ego.position, ego.heading
    x, y = dx * np.cos(h) + dy * np.sin(h), dx * np.sin(h) - dy * np.cos(h)
    return -5.0 * x + 152.0, -5.0 * y + 96.0


def world_of(ego, row, column):
    """World points of pixel centres: the inverse of ``pixel_of``."""
    x, y, h = (152.0 - row) / 5.0, (96.0 - column) / 5.0, ego.heading
    ahead, left = np.array([np.cos(h), np.sin(h)]), np.array([np.sin(h), -np.cos(h)])
    return ego.position + np.multiply.outer(x, ahead) + np.multiply.outer(y, left)


def test_views_belong_to_the_space_over_several_resets(env):
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        assert observation in env.observation_space
        observation, *_ = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert set(np.unique(observation["bev"]).tolist()) == {0, ON}


def test_there_is_road_under_the_ego(env):
    for view, _ in moments(env):
        assert (view[ROAD, 150:155, 94:99] == ON).all()


def test_the_road_channel_is_where_highway_env_has_lanes(env):
    rng = np.random.default_rng(0)
    for view, base in moments(env, steps=0):
        lanes = base.road.network.lanes_list()
        pixels = rng.integers(0, 192, (300, 2))
        answers = []
        for row, column in pixels:
            point = world_of(base.vehicle, float(row), float(column))
            gaps = []
            for lane in lanes:
                along, across = lane.local_coordinates(point)
                beyond = max(-along, along - lane.length)
                gaps.append(max(beyond, abs(across) - lane.width_at(along) / 2.0))
            if min(gaps) < -0.4:
                answers.append(view[ROAD, row, column] == ON)
            elif min(gaps) > 1.5:  # joints between lanes are filled
                answers.append(view[ROAD, row, column] == 0)
        assert all(answers)
        assert len(answers) > 200


def test_lane_lines_are_drawn(env):
    for view, _ in moments(env, steps=0):
        assert 50 < (view[LANE] == ON).sum() < 0.2 * view[LANE].size


def test_the_vehicles_channel_shows_the_footprints_of_the_others(env):
    rows, columns = np.mgrid[0:192, 0:192].astype(float)
    shown = 0
    for view, base in moments(env):
        points = world_of(base.vehicle, rows, columns)
        surely, perhaps = np.zeros((192, 192), bool), np.zeros((192, 192), bool)
        for other in base.road.vehicles:
            if other is base.vehicle:
                continue
            offset = points - other.position
            cos, sin = np.cos(other.heading), np.sin(other.heading)
            along = np.abs(offset[..., 0] * cos + offset[..., 1] * sin)
            across = np.abs(offset[..., 1] * cos - offset[..., 0] * sin)
            half_length, half_width = other.LENGTH / 2.0, other.WIDTH / 2.0
            surely |= (along < half_length - 0.2) & (across < half_width - 0.2)
            perhaps |= (along < half_length + 0.2) & (across < half_width + 0.2)
            row, column = pixel_of(base.vehicle, other.position)
            if 0.0 <= row <= 191.0 and 0.0 <= column <= 191.0:
                shown += 1
                assert view[VEHICLES, round(row), round(column)] == ON
        assert (view[VEHICLES][surely] == ON).all()
        assert (view[VEHICLES][~perhaps] == 0).all()
    assert shown > 0


def test_a_route_is_drawn_where_the_ego_has_one_and_lies_on_the_road(env):
    has_route = env.unwrapped.spec.id in WITH_A_ROUTE
    for view, base in moments(env):
        route = view[ROUTE] == ON
        assert route.any() == bool(getattr(base.vehicle, "route", None)) == has_route
        # highway-env's roundabout has a kink where its entries join
        assert (view[ROAD][route] == ON).sum() >= 0.97 * route.sum()


def test_the_route_starts_at_the_ego_and_leads_ahead():
    env = BEVObservation(gym.make("intersection-v2"))
    for view, _ in moments(env, steps=0):
        rows = np.flatnonzero((view[ROUTE] == ON).any(axis=1))
        assert rows.max() == pytest.approx(152, abs=3)  # nothing behind
        assert view[ROUTE, 140, 96] == ON
        assert rows.min() < 60


def test_highway_env_has_no_pedestrians_and_no_lights(env):
    for view, _ in moments(env, resets=1):
        assert not view[[PEDESTRIANS, LIGHTS]].any()


def test_gymnasiums_checker_accepts_the_wrapped_environment(env):
    fresh = BEVObservation(env.unwrapped.spec.make().unwrapped)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # the checker notes any wrapper
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        check_env(fresh, skip_render_check=True, skip_close_check=True)


def test_measurements_are_speed_and_commands_in_highway_envs_ranges():
    config = {"action": {"type": "ContinuousAction"}}
    env = BEVObservation(gym.make("intersection-v2", config=config))
    env.reset(seed=0)
    observation, *_ = env.step(np.array([0.5, -0.2]))
    speed = env.unwrapped.vehicle.speed
    np.testing.assert_allclose(observation["measurements"], [speed, 0.5, -0.2], rtol=1e-5)
    # this vehicle plans no route
    assert not observation["bev"][ROUTE].any()


def test_the_geometry_of_the_view_may_be_chosen():
    env = BEVObservation(gym.make("roundabout-v1"), BEVGeometry(size=64, px_per_m=2.0, ego_row=40))
    observation, _ = env.reset(seed=0)
    assert observation["bev"].shape == (6, 64, 64)
    assert observation in env.observation_space
    assert observation["bev"][ROAD, 40, 32] == ON


@pytest.mark.parametrize("env_id", ["CartPole-v1", "BEVTown01-v0"])
def test_an_environment_without_a_highway_env_road_is_refused_by_name(env_id):
    env = gym.make(env_id)
    with pytest.raises(TypeError, match=type(env.unwrapped).__name__):
        BEVObservation(env)


def test_the_view_can_be_configured_by_a_mapping_as_in_the_towns():
    env = BEVObservation(gym.make("highway-v0"), bev={"size": 64, "ego_row": 40})
    assert env.reset(seed=0)[0]["bev"].shape == (6, 64, 64)
