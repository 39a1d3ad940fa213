"""Traffic in the environments: what is seen of it, and that it keeps to itself."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from agents import Expert
from bev_driving_env.frames import CHANNELS
from bev_driving_env.kernels.layout import (
    LENGTH,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    SIGNAL_YELLOW,
    WIDTH,
)

DENSE = {"traffic": "dense", "traffic_lights": True}
NOCRASH = {
    ("Town01", "light"): (20, 50),
    ("Town01", "dense"): (100, 250),
    ("Town02", "light"): (15, 50),
    ("Town02", "dense"): (70, 150),
}


def make(town="Town02", **keywords):
    return gym.make(f"bev_driving_env:BEV{town}-v0", **keywords).unwrapped


@pytest.fixture(scope="module")
def env():
    return make(**DENSE, terminate_on=())


def drive(env, steps, seed=0, route=1):
    """The expert's drive, as observations."""
    observation, _ = env.reset(seed=seed, options={"route": route})
    expert = Expert(env)
    yield observation
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
        yield observation


@pytest.mark.parametrize(("town", "preset"), NOCRASH)
def test_presets_have_nocrashs_numbers(town, preset):
    env = make(town, traffic=preset)
    env.reset(seed=0)
    vehicles, pedestrians = NOCRASH[town, preset]
    assert env.vehicle_states.shape == (vehicles, 6)
    assert (env.world.state.pedestrians[0, :, LENGTH] > 0.0).sum() == pedestrians
    assert (env.world.state.signals == SIGNAL_OFF).all()


def test_explicit_numbers_are_what_is_there():
    env = make(traffic={"vehicles": 7})
    env.reset(seed=0)
    assert env.vehicle_states.shape == (7, 6)
    assert env.world.state.pedestrians.shape[1] == 0


def test_vehicles_and_people_move_and_vary(env):
    for _ in drive(env, 150):
        pass
    states = env.vehicle_states
    assert (states[:, 3] > 1.0).sum() > 15
    # motorbikes, cars, vans and trucks
    assert [
        ((states[:, 4] > a) & (states[:, 4] <= b)).any()
        for a, b in ((1.9, 2.4), (3.6, 5.0), (5.1, 6.1), (6.5, 7.4))
    ] == [True] * 4
    sizes = env.world.state.pedestrians[0, :, WIDTH]
    assert sizes.min() < 0.4 < 0.5 < sizes.max()


def test_nobody_starts_near_the_ego_or_on_it(env):
    for seed in range(10):
        env.reset(seed=seed)
        x, y, _ = env.ego_pose
        assert np.hypot(*(env.vehicle_states[:, :2] - (x, y)).T).min() > 10.0


def ego_frame(pose, points):
    """World points (n, 2) as metres ahead and to the right of a pose, by rotation matrix."""
    x, y, heading = pose
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    return (points - (x, y)) @ turn


def pixels(env, points):
    """Rows and columns (n, 2) of the BEV pixels that hold world points, and which are inside."""
    ahead, right = ego_frame(env.ego_pose, points).T
    cells = np.floor(np.column_stack([152.0 - 5.0 * ahead, 96.0 + 5.0 * right])).astype(int)
    return cells, ((cells >= 1) & (cells < 191)).all(axis=1)


def test_channels_3_to_5_agree_with_where_the_actors_are(env):
    seen = dict.fromkeys(CHANNELS[3:], 0)
    shown = set()
    lines = env.world.town.stop_lines
    for step, observation in enumerate(drive(env, 1500)):
        if step % 10:
            continue
        state, bev = env.world.state, observation["bev"]
        for name, actors in (("vehicles", state.vehicles), ("pedestrians", state.pedestrians)):
            cells, inside = pixels(env, actors[0, :, :2])
            for row, column in cells[inside]:
                assert bev[CHANNELS.index(name), row, column] == 255
            seen[name] += inside.sum()
        cells, inside = pixels(env, (lines[:, :2] + lines[:, 2:]) / 2.0)
        for k in np.flatnonzero(inside):
            row, column = cells[k]
            stop = state.signals[0, k] in (SIGNAL_YELLOW, SIGNAL_RED)
            assert (bev[5, row, column] == 255) == stop
            shown.add(int(state.signals[0, k]))
            seen["lights"] += 1
        # nothing but the actors that are there is drawn: no more pixels than their footprints have
        for channel, actors, least_m in (
            (3, state.vehicles[0], 0.0),
            (4, state.pedestrians[0], 1.6),
        ):
            cells, _ = pixels(env, actors[:, :2])
            near = actors[((cells > -25) & (cells < 217)).all(axis=1)]
            length, width = np.maximum(near[:, [LENGTH, WIDTH]], least_m).T
            # a pixel is drawn if its centre is inside: at most a rim of half a pixel too many
            assert (bev[channel] == 255).sum() <= ((5.0 * length + 1.5) * (5.0 * width + 1.5)).sum()
    assert min(seen.values()) > 50
    assert shown == {SIGNAL_GREEN, SIGNAL_YELLOW, SIGNAL_RED}


def test_cameras_see_vehicles_people_and_signals(env):
    for _ in drive(env, 120):
        pass
    everybody = env.sensor_frame().images
    state = env.world.state
    for name in ("vehicles", "pedestrians"):
        rows = getattr(state, name)
        kept = rows.copy()
        rows[..., LENGTH] = 0.0
        assert (env.sensor_frame().images != everybody).any(), name
        rows[:] = kept
    kept = state.signals.copy()
    state.signals[:] = np.where(kept == SIGNAL_RED, SIGNAL_GREEN, SIGNAL_RED)
    assert (env.sensor_frame().images != everybody).any()
    state.signals[:] = kept
    np.testing.assert_array_equal(env.sensor_frame().images, everybody)


def test_the_environment_still_is_one_that_gymnasium_accepts():
    check_env(make(**DENSE), skip_render_check=True)


def test_traffic_is_another_in_every_episode(env):
    env.reset(seed=0)
    first = env.vehicle_states
    env.reset()
    assert (env.vehicle_states[:, :2] != first[:, :2]).any(axis=1).mean() > 0.9
