"""``snapshot`` and ``restore`` of a single environment: rewind and branch, bit for bit."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import bev_driving_env  # noqa: F401  # registers the ids

STREETS = {"empty": {}, "dense": {"traffic": "dense", "traffic_lights": True}}


@pytest.fixture(params=STREETS)
def streets(request):
    """The keywords of an empty town, and of one with dense traffic."""
    return STREETS[request.param]


@pytest.fixture
def env(streets):
    return gym.make("BEVTown01-v0", **streets).unwrapped


def actions(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform((-0.2, -0.3), (1.0, 0.3), (count, 2)).astype(np.float32)


def drive(env, commands):
    """Every result of the commands, starting new random episodes as old ones end."""
    results = []
    for command in commands:
        observation, *rest = env.step(command)
        results.append((*observation.values(), *rest))
        if rest[1] or rest[2]:
            observation, info = env.reset()
            results.append((*observation.values(), info))
    return results


def assert_equal_results(first, second):
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[1], b[1])
        assert a[2:] == b[2:]  # floats, flags and the whole info, exactly


def rng_state(env):
    return env.np_random.bit_generator.state


def test_200_steps_after_restoring_equal_the_first_200(env):
    env.reset(seed=0)
    drive(env, actions(30, seed=1))
    snapshot = env.snapshot()
    before = rng_state(env)
    first = drive(env, actions(200))
    assert sum(len(result) == 3 for result in first) >= 2  # random routes were drawn on the way
    after = rng_state(env)
    assert after != before
    env.restore(snapshot)
    assert rng_state(env) == before
    assert_equal_results(first, drive(env, actions(200)))
    assert rng_state(env) == after


def test_a_snapshot_can_be_restored_again_and_again(env):
    env.reset(seed=0)
    drive(env, actions(5))
    snapshot = env.snapshot()
    branches = []
    for _ in range(3):
        env.restore(snapshot)
        branches.append(drive(env, actions(40, seed=2)))
    assert_equal_results(branches[0], branches[1])
    assert_equal_results(branches[0], branches[2])


def test_restore_returns_the_observation_of_that_moment(env):
    env.reset(seed=0)
    for command in actions(10):
        observation, *_ = env.step(command)
    snapshot, pose = env.snapshot(), env.ego_pose
    drive(env, actions(60, seed=3))
    restored = env.restore(snapshot)
    np.testing.assert_array_equal(restored["bev"], observation["bev"])
    np.testing.assert_array_equal(restored["measurements"], observation["measurements"])
    assert env.ego_pose == pose


def test_driving_on_does_not_change_a_snapshot(env):
    env.reset(seed=0)
    snapshot = env.snapshot()
    arrays = {
        item.name: getattr(snapshot.state, item.name).tobytes()
        for item in dataclasses.fields(snapshot.state)
    }
    drive(env, actions(40))
    env.restore(snapshot)
    drive(env, actions(40, seed=1))
    for name, content in arrays.items():
        assert getattr(snapshot.state, name).tobytes() == content, name


def test_another_route_in_between_is_forgotten(env):
    env.reset(seed=0, options={"episode": 2})
    drive(env, actions(5))
    snapshot, route = env.snapshot(), env.route
    first = drive(env, actions(10, seed=4))
    env.reset(seed=9, options={"route": 3})  # much longer: its arrays are larger
    drive(env, actions(5))
    env.restore(snapshot)
    assert env.route is route
    assert_equal_results(first, drive(env, actions(10, seed=4)))


def test_a_branch_can_go_on_in_another_environment(env, streets):
    other = gym.make("BEVTown01-v0", **streets).unwrapped
    env.reset(seed=0)
    other.reset(seed=1)
    drive(env, actions(20))
    other.restore(env.snapshot())
    assert_equal_results(drive(env, actions(100, seed=5)), drive(other, actions(100, seed=5)))


def test_infractions_before_the_snapshot_stay_on_the_record():
    env = gym.make("BEVTown01-v0", terminate_on=(), time_limit_s=30.0).unwrapped
    env.reset(seed=0, options={"episode": 0})
    gas = np.array([1.0, 0.0], np.float32)
    for _ in range(200):
        env.step(gas)
    snapshot = env.snapshot()
    assert any(snapshot.events)
    summaries = []
    for _ in range(2):
        env.reset(seed=1)  # begins another record
        env.restore(snapshot)
        for _ in range(100):
            *_, truncated, info = env.step(gas)
        assert truncated
        summaries.append(info["episode_summary"])
    assert summaries[0] == summaries[1]
    assert len(summaries[0]["infractions"]) >= len(snapshot.events[0])


def test_a_snapshot_of_another_town_is_refused_with_both_names(env, streets):
    other = gym.make("BEVTown02-v0", **streets).unwrapped
    other.reset(seed=0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"Town02.*Town01"):
        env.restore(other.snapshot())


def test_a_snapshot_survives_pickling(env):
    import pickle

    env.reset(seed=0)
    drive(env, actions(10))
    snapshot = pickle.loads(pickle.dumps(env.snapshot()))
    first = drive(env, actions(50, seed=6))
    env.restore(snapshot)
    assert_equal_results(first, drive(env, actions(50, seed=6)))


@pytest.mark.parametrize(
    ("keywords", "named"),
    [
        ({"terminate_on": ()}, "terminate_on"),
        ({"max_speed_mps": 3.0}, "cruise_speed_mps"),
        ({"time_limit_s": 5.0}, "time_limit_s"),
        ({"vehicle": {"length_m": 4.0}}, "vehicle"),
        ({"traffic": "light"}, "traffic"),
        ({"traffic": {"vehicles": 3}}, "traffic"),
    ],
)
def test_a_snapshot_of_another_configuration_is_refused(env, streets, keywords, named):
    env.reset(seed=0)
    other = gym.make("BEVTown01-v0", **{**streets, **keywords}).unwrapped
    with pytest.raises(ValueError, match=f"snapshot was taken with {named}"):
        other.restore(env.snapshot())


def test_the_view_may_differ_between_a_snapshot_and_where_it_is_restored(env, streets):
    env.reset(seed=0)
    other = gym.make("BEVTown01-v0", bev={"size": 96, "ego_row": 76}, **streets).unwrapped
    observation = other.restore(env.snapshot())
    assert observation["bev"].shape == (6, 96, 96)
    assert other.ego_pose == env.ego_pose


@pytest.mark.parametrize("wrong", [None, "a snapshot", 3])
def test_what_is_no_snapshot_is_refused(env, wrong):
    with pytest.raises(TypeError, match=type(wrong).__name__):
        env.restore(wrong)


@pytest.mark.parametrize("what", ["snapshot", "ground_truth_bev"])
def test_before_the_first_reset_there_is_nothing_to_see(env, what):
    with pytest.raises(gym.error.ResetNeeded, match=what):
        getattr(env, what)()
    with pytest.raises(gym.error.ResetNeeded, match="ego_pose"):
        _ = env.ego_pose
