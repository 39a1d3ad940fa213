"""World ``i`` of the vector environment is a single environment with seed ``s + i``, bit for bit.

The oracle is Gymnasium's own ``SyncVectorEnv`` over single environments, in each autoreset mode.
"""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from bev_driving_env import BEVTownEnv, BEVTownVectorEnv

MANY_ENDS = {
    "time_limit_s": 5.0,
    "rules": {"success_fraction": 0.05, "success_distance_m": 1000.0},
    "bev": {"size": 64, "px_per_m": 1.5, "ego_row": 50},
}
"""Short episodes that end in all three ways: infraction, success and time limit."""
STREETS = [{}, {"traffic": "dense", "traffic_lights": True}]


def actions(steps, worlds):
    """Random actions, each world with a temper of its own so that their ends do not coincide."""
    rng = np.random.default_rng(1)
    gas = np.linspace(0.1, 1.0, worlds)
    steer = np.tile([0.02, 0.6], worlds)[:worlds]
    noise = rng.uniform(-1.0, 1.0, (steps, worlds, 2))
    return np.stack([gas + 0.3 * noise[..., 0], steer * noise[..., 1]], -1).astype(np.float32)


def assert_same_infos(ours, theirs):
    """Equal where the masks are True; what no world has may be there or not."""
    held = {key for key in theirs if not key.startswith("_") and theirs[f"_{key}"].any()}
    assert held == {key for key in ours if not key.startswith("_") and ours[f"_{key}"].any()}
    for key in held:
        mask = theirs[f"_{key}"]
        np.testing.assert_array_equal(ours[f"_{key}"], mask, err_msg=key)
        if isinstance(theirs[key], dict):
            assert_same_infos(ours[key], theirs[key])
            continue
        assert ours[key].dtype == theirs[key].dtype, key
        for mine, other in zip(ours[key][mask], theirs[key][mask], strict=True):
            if key == "final_obs":
                assert_same_observations(mine, other)
            else:
                assert mine == other, key


def assert_same_observations(ours, theirs):
    assert list(ours) == list(theirs)
    for key in theirs:
        np.testing.assert_array_equal(ours[key], theirs[key], err_msg=key)
        assert ours[key].dtype == theirs[key].dtype


def assert_same_step(ours, theirs):
    assert_same_observations(ours[0], theirs[0])
    for mine, other in zip(ours[1:-1], theirs[1:-1], strict=True):
        np.testing.assert_array_equal(mine, other)
    assert_same_infos(ours[-1], theirs[-1])


def pair(worlds, mode, **keywords):
    batched = BEVTownVectorEnv(worlds, autoreset_mode=mode, **keywords)
    separate = SyncVectorEnv([partial(BEVTownEnv, **keywords)] * worlds, autoreset_mode=mode)
    return batched, separate


def ends_of(infos, mode):
    """How the episodes reported by these infos ended: a list of "success" and so on."""
    if mode is AutoresetMode.SAME_STEP:
        infos = infos.get("final_info", {})
    if "episode_summary" not in infos:
        return []
    mask, summary = infos["_episode_summary"], infos["episode_summary"]
    return [
        "success" if success else "time" if truncated else "infraction"
        for success, truncated in zip(
            summary["success"][mask], summary["truncated"][mask], strict=True
        )
    ]


@pytest.mark.parametrize("streets", STREETS)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_batched_worlds_equal_separate_environments_through_autoresets(mode, streets):
    batched, separate = pair(8, mode, **MANY_ENDS, **streets)
    assert_same_step(batched.reset(seed=42), separate.reset(seed=42))
    ends = []
    for action in actions(300, 8):
        ours = batched.step(action)
        assert_same_step(ours, separate.step(action))
        ends += ends_of(ours[-1], mode)
    # otherwise little has been compared
    assert all(ends.count(kind) >= 5 for kind in ("success", "time", "infraction"))


@pytest.mark.parametrize("streets", STREETS)
def test_batched_worlds_equal_separate_environments_reset_by_mask(streets):
    batched, separate = pair(8, AutoresetMode.DISABLED, **MANY_ENDS, **streets)
    assert_same_step(batched.reset(seed=42), separate.reset(seed=42))
    resets = 0
    for action in actions(300, 8):
        ours = batched.step(action)
        assert_same_step(ours, separate.step(action))
        ended = ours[2] | ours[3]
        if ended.any():
            resets += int(ended.sum())
            results = [
                envs.reset(options={"reset_mask": ended.copy()}) for envs in (batched, separate)
            ]
            assert_same_step(*results)
    assert resets >= 15


@pytest.mark.parametrize(("worlds", "time_limit_s"), [(1, 0.3), (3, 0.3), (1, 0.04)])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_all_worlds_may_end_in_the_same_step(mode, worlds, time_limit_s):
    batched, separate = pair(worlds, mode, **{**MANY_ENDS, "time_limit_s": time_limit_s})
    assert_same_step(batched.reset(seed=0), separate.reset(seed=0))
    for action in np.zeros((10, worlds, 2), np.float32):
        assert_same_step(batched.step(action), separate.step(action))


def test_max_episode_steps_does_what_gymnasiums_time_limit_does():
    make = partial(gym.make, "BEVTown01-v0", max_episode_steps=7)
    separate = SyncVectorEnv([make] * 3)
    batched = gym.make_vec("BEVTown01-v0", num_envs=3, max_episode_steps=7)
    assert_same_step(batched.reset(seed=0), separate.reset(seed=0))
    for action in np.zeros((20, 3, 2), np.float32):
        ours, theirs = batched.step(action), separate.step(action)
        assert_same_step((*ours[:4], {}), (*theirs[:4], {}))


def test_full_size_views_equal_those_of_single_environments_over_autoresets():
    batched = gym.make_vec("BEVTown01-v0", num_envs=8)
    singles = [gym.make("BEVTown01-v0") for _ in range(8)]
    views, _ = batched.reset(seed=100)
    waiting = [False] * 8
    for i, env in enumerate(singles):
        assert_same_observations({k: v[i] for k, v in views.items()}, env.reset(seed=100 + i)[0])
    resets = 0
    for action in actions(200, 8):
        views, rewards, terminations, truncations, _ = batched.step(action)
        for i, env in enumerate(singles):
            if waiting[i]:
                view, result = env.reset()[0], (0.0, False, False)
                resets += 1
            else:
                view, *result, _ = env.step(action[i])
            assert_same_observations({k: v[i] for k, v in views.items()}, view)
            assert (rewards[i], terminations[i], truncations[i]) == tuple(result)
            waiting[i] = bool(terminations[i] or truncations[i])
    assert resets >= 8


def test_a_partial_reset_leaves_the_other_worlds_as_they_are():
    batched, separate = pair(4, AutoresetMode.NEXT_STEP, **MANY_ENDS)
    assert_same_step(batched.reset(seed=0), separate.reset(seed=0))
    for action in actions(5, 4):
        assert_same_step(batched.step(action), separate.step(action))
    mask, poses = np.array([False, True, True, False]), batched.ego_poses
    results = [
        envs.reset(seed=[None, 77, None, None], options={"reset_mask": mask.copy(), "episode": 1})
        for envs in (batched, separate)
    ]
    assert_same_step(*results)
    np.testing.assert_array_equal(batched.ego_poses[~mask], poses[~mask])
    assert results[0][1]["_episode_id"].tolist() == mask.tolist()
    for action in actions(60, 4):
        assert_same_step(batched.step(action), separate.step(action))


def test_an_ended_world_must_be_reset_when_nothing_resets_it():
    envs = BEVTownVectorEnv(2, autoreset_mode="Disabled", max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2)))
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1\].*reset_mask"):
        envs.step(np.zeros((2, 2)))
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\].*reset_mask"):
        envs.step(np.zeros((2, 2)))
