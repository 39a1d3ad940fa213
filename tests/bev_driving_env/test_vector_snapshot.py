"""``snapshot`` and ``restore`` of all worlds at once."""

import numpy as np
import pytest

from bev_driving_env import BEVTownVectorEnv

WORLDS = 4


def actions(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform((0.0, -0.4), (1.0, 0.4), (count, WORLDS, 2)).astype(np.float32)


def make(**keywords):
    return BEVTownVectorEnv(WORLDS, bev={"size": 64, "px_per_m": 1.5, "ego_row": 50}, **keywords)


def drive(envs, commands):
    results = []
    for command in commands:
        observations, *arrays, infos = envs.step(command)
        ids, terms = infos["episode_id"].tolist(), infos.get("reward_terms", {})
        arrays += [*observations.values(), infos["route_m"], *terms.values(), envs.ego_poses]
        results.append((arrays, ids))
    return results


def assert_equal_results(first, second):
    for (arrays, ids), (other_arrays, other_ids) in zip(first, second, strict=True):
        assert ids == other_ids
        for array, other in zip(arrays, other_arrays, strict=True):
            np.testing.assert_array_equal(array, other)


@pytest.mark.parametrize("streets", [{}, {"traffic": "dense", "traffic_lights": True}])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_200_steps_after_restoring_equal_the_first_200(mode, streets):
    envs = make(autoreset_mode=mode, **streets)
    envs.reset(seed=0)
    drive(envs, actions(20, seed=1))
    snapshot = envs.snapshot()
    first = drive(envs, actions(200))
    assert sum(arrays[1].sum() for arrays, _ in first) >= WORLDS  # terminations, so random routes
    envs.restore(snapshot)
    assert_equal_results(first, drive(envs, actions(200)))


def test_a_world_that_waits_for_its_reset_still_waits_after_restoring():
    envs = make(max_episode_steps=3)
    envs.reset(seed=0)
    drive(envs, actions(3))
    snapshot = envs.snapshot()
    first = drive(envs, actions(1))
    assert first[0][0][0].tolist() == [0.0] * WORLDS  # the step that only resets
    drive(envs, actions(2))
    envs.restore(snapshot)
    assert_equal_results(first, drive(envs, actions(1)))


def test_restore_returns_the_observations_of_that_moment():
    envs = make()
    envs.reset(seed=0)
    observations = envs.step(actions(1)[0])[0]
    snapshot = envs.snapshot()
    drive(envs, actions(10))
    restored = envs.restore(snapshot)
    for key, array in observations.items():
        np.testing.assert_array_equal(restored[key], array)


def test_a_snapshot_of_another_number_of_worlds_is_refused_with_both():
    envs, fewer = make(), BEVTownVectorEnv(2)
    envs.reset(seed=0)
    fewer.reset(seed=0)
    with pytest.raises(ValueError, match=r"2 worlds.*4"):
        envs.restore(fewer.snapshot())


def test_the_views_can_be_drawn_anew_at_any_time():
    envs = make()
    envs.reset(seed=0)
    observations = envs.step(actions(1)[0])[0]
    np.testing.assert_array_equal(envs.ground_truth_bev(), observations["bev"])
