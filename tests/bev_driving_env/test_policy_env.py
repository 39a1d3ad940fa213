"""What stands between the world and the policy, through ``reset`` and ``step``."""

import pickle
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import bev_driving_env
from bev_driving_env import BEVSourceError, BEVTownEnv, BEVTownVectorEnv, CorruptedBEV
from bev_driving_env.cameras.renderer import CameraRenderer
from bev_driving_env.frames import CHANNELS

SMALL = {"camera_size": (32, 64), "bev": {"size": 64, "px_per_m": 1.5, "ego_row": 50}}
SIDE = 64
GAS = np.array([0.4, 0.02], np.float32)
MODES = list(AutoresetMode)


class Counter:
    """Predicts in ``road`` how often it was asked, in ``route`` how many episodes it has seen."""

    channels = ("road", "route")

    def __init__(self):
        self.asked, self.episodes = 0, 0

    def reset(self):
        self.asked, self.episodes = 0, self.episodes + 1

    def __call__(self, frame):
        self.asked += 1
        planes = np.zeros((2, SIDE, SIDE), np.uint8)
        planes[0], planes[1] = self.asked, self.episodes
        return planes

    def snapshot(self):
        return self.asked, self.episodes

    def restore(self, state):
        self.asked, self.episodes = state


class Seeing:
    """Predicts from everything in its frame, so that any difference in a frame shows."""

    channels = ("road", "lane")

    def reset(self):
        self.steps = 0

    def __call__(self, frame):
        self.steps += 1
        planes = np.zeros((2, SIDE, SIDE), np.uint8)
        planes[0, :32, :] = frame.images.mean(axis=-1)[0]
        planes[0, 32:, :] = frame.images.mean(axis=-1)[3]
        planes[1] = frame.route_map
        planes[1, 0, :3] = np.abs(frame.measurements) * 20 + self.steps
        return planes


class Batch(Seeing):
    """The same for many frames at once, and without a memory."""

    calls = 0

    def reset(self):
        self.steps = 0

    def __call__(self, frame):
        self.steps = 0
        return super().__call__(frame)

    def predict_batch(self, frames):
        self.calls += 1
        self.sizes = [*getattr(self, "sizes", []), len(frames)]
        return np.stack([self(frame) for frame in frames])


class Vandal(Seeing):
    """Paints over its frame once it has looked."""

    def __call__(self, frame):
        planes = super().__call__(frame)
        for array in vars(frame).values():
            array[:] = 77
        return planes


def single(**keywords):
    return BEVTownEnv("Town02", **{**SMALL, **keywords})


def vector(worlds, mode=AutoresetMode.NEXT_STEP, **keywords):
    return BEVTownVectorEnv(worlds, "Town02", autoreset_mode=mode, **{**SMALL, **keywords})


def assert_same(one, other):
    assert set(one) == set(other)
    for key, array in other.items():
        np.testing.assert_array_equal(one[key], array, err_msg=key)
        assert one[key].dtype == array.dtype


# --- ground truth, by whatever name --------------------------------------------------------------


@pytest.mark.parametrize(
    "spec",
    [
        {"default": "ground_truth"},
        dict.fromkeys(CHANNELS, "ground_truth"),
        {"lane": "ground_truth", "default": "ground_truth"},
        CorruptedBEV("ground_truth"),
        {"lights": "ground_truth", "default": CorruptedBEV("ground_truth")},
    ],
)
def test_every_spelling_of_ground_truth_is_the_same_drive_bit_for_bit(spec):
    envs = (
        gym.make("bev_driving_env:BEVTown02-v0"),
        gym.make("bev_driving_env:BEVTown02-v0", bev_source=spec),
    )
    observations = [env.reset(seed=4)[0] for env in envs]
    rng = np.random.default_rng(0)
    for _ in range(60):
        assert_same(*observations)
        truth = envs[1].unwrapped.ground_truth_bev()
        np.testing.assert_array_equal(observations[1]["bev"], truth)
        action = rng.uniform((0.0, -0.1), (1.0, 0.1)).astype(np.float32)
        results = [env.step(action) for env in envs]
        assert results[0][1:] == results[1][1:]
        observations = [result[0] for result in results]
        if results[0][2] or results[0][3]:
            observations = [env.reset()[0] for env in envs]


@pytest.mark.parametrize("spec", ["ground_truth", CorruptedBEV("ground_truth", flicker=0.5)])
def test_no_camera_image_is_made_that_nobody_wants(spec, monkeypatch):
    monkeypatch.setattr(CameraRenderer, "render", lambda *_: pytest.fail("rendered"))
    env, envs = (make(bev_source=spec, bev={}) for make in (single, partial(vector, 2)))
    env.reset(seed=0)
    env.step(GAS)
    envs.reset(seed=0)
    envs.step(np.array([GAS, GAS]))


def test_channels_are_mixed_by_name_and_the_missing_ones_are_empty():
    env = single(bev_source={"road": Counter(), "lane": "ground_truth", "default": Counter()})
    env.reset(seed=0)
    for steps in range(1, 4):
        observation, *_ = env.step(GAS)
        bev = observation["bev"]
        assert (bev[0] == steps + 1).all()
        assert (bev[1] == 1).all()
        np.testing.assert_array_equal(bev[2], env.ground_truth_bev()[2])
        assert bev[2].any()
        assert not bev[3:].any()


@pytest.mark.parametrize("make", [single, partial(vector, 2)])
def test_a_channel_asked_of_a_source_without_it_is_refused(make):
    with pytest.raises(ValueError, match=r"Counter.*'lane'.*road, route"):
        make(bev_source={"lane": Counter(), "default": "ground_truth"})


def test_registered_sources_and_factories_by_name_are_new_in_each_world():
    bev_driving_env.register_bev_source("toy_counter", Counter, overwrite=True)
    envs = vector(3, bev_source="toy_counter")
    envs.reset(seed=0)
    only_one = np.array([False, True, False])
    observations, _ = envs.reset(options={"reset_mask": only_one})
    assert observations["bev"][:, 1, 0, 0].tolist() == [1, 2, 1]


# --- sources that fail ---------------------------------------------------------------------------


class Failing:
    """Works for some frames, then does what it was made for."""

    channels = ("road",)

    def __init__(self, then, good=0):
        self.then, self.good = then, good

    def reset(self):
        pass

    def __call__(self, frame):
        self.good -= 1
        if self.good >= 0:
            return np.zeros((1, SIDE, SIDE), np.uint8)
        if isinstance(self.then, Exception):
            raise self.then
        return self.then


WRONG = [
    (np.zeros((6, SIDE, SIDE), np.uint8), r"shape \(6, 64, 64\)"),
    (np.zeros((1, SIDE, SIDE), np.int64), "dtype int64"),
    (np.full((1, SIDE, SIDE), np.nan), "NaN"),
    (np.full((1, SIDE, SIDE), -0.5), r"-0\.5"),
    (None, "None"),
]


@pytest.mark.parametrize("good", [0, 2])
@pytest.mark.parametrize(("then", "came"), WRONG)
def test_a_wrong_answer_is_named_with_what_is_expected(then, came, good):
    envs = [
        gym.make("bev_driving_env:BEVTown02-v0", bev_source=Failing(then, good), **SMALL),
        vector(1, bev_source=Failing(then, good)),
    ]
    for env, action in zip(envs, (GAS, GAS[None]), strict=True):
        if good:
            env.reset(seed=0)
            env.step(action)
        use = partial(env.step, action) if good else partial(env.reset, seed=0)
        expected = rf"'Failing' returned .*{came}.*\(1, 64, 64\).*uint8.*float"
        with pytest.raises(BEVSourceError, match=expected) as caught:
            use()
        assert caught.value.source == "Failing"


@pytest.mark.parametrize("good", [0, 2])
def test_what_a_source_raises_is_chained(good):
    cause = LookupError("the weights\nare gone")
    env = gym.make("bev_driving_env:BEVTown02-v0", bev_source=Failing(cause, good), **SMALL)
    if good:
        env.reset(seed=0)
        env.step(GAS)
    use = partial(env.step, GAS) if good else partial(env.reset, seed=0)
    with pytest.raises(BEVSourceError, match="'Failing' raised LookupError: the weights") as caught:
        use()
    assert caught.value.__cause__ is cause


def test_a_batched_source_that_fails_is_named_in_the_vector_environment():
    class Half(Batch):
        def predict_batch(self, frames):
            return super().predict_batch(frames)[:1]

    with pytest.raises(BEVSourceError, match=r"'Half'.*\(1, 2, 64, 64\).*\(3, 2, 64, 64\)"):
        vector(3, bev_source=Half()).reset(seed=0)


def test_after_a_failure_the_next_episode_is_as_if_nothing_had_happened():
    class FailsOnce(Counter):
        failed = False

        def __call__(self, frame):
            if self.asked == 2 and not self.failed:
                self.failed = True
                raise ValueError("once")
            return super().__call__(frame)

    env, calm = single(bev_source=FailsOnce()), single(bev_source=Counter())
    env.reset(seed=0)
    env.step(GAS)
    with pytest.raises(BEVSourceError, match="once"):
        env.step(GAS)
    env.reset(seed=1)
    calm.reset(seed=0)
    calm.reset(seed=1)
    for _ in range(4):
        assert_same(env.step(GAS)[0], calm.step(GAS)[0])


# --- a source cannot reach beyond its frame ------------------------------------------------------


def test_a_source_that_paints_over_its_frame_changes_nothing_but_its_own_copy():
    spec = {"road": Vandal(), "route": Counter(), "default": Seeing()}
    honest = {"road": Seeing(), "route": Counter(), "default": Seeing()}
    envs = [single(cameras=True, bev_source=source) for source in (spec, honest)]
    observations = [env.reset(seed=2)[0] for env in envs]
    for _ in range(5):
        assert_same(*observations)
        assert (observations[0]["cameras"] != 77).mean() > 0.5
        observations = [env.step(GAS)[0] for env in envs]
    together = [vector(2, cameras=True, bev_source=source) for source in (spec, honest)]
    assert_same(*[envs.reset(seed=2)[0] for envs in together])
    assert_same(*[envs.step(np.array([GAS, GAS]))[0] for envs in together])


def test_a_source_that_keeps_its_frames_does_not_see_them_change():
    kept = []

    class Keeping(Seeing):
        def __call__(self, frame):
            kept.append((frame, frame.copy()))
            return super().__call__(frame)

    env = single(cameras=True, bev_source=Keeping())
    env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(GAS)
        for array in observation.values():
            array[...] = 0
    assert len(kept) == 4
    for frame, copy in kept:
        for name, array in vars(copy).items():
            np.testing.assert_array_equal(getattr(frame, name), array)


# --- one world of many is a single environment ---------------------------------------------------

ENDS = {
    "time_limit_s": 1.6,
    "rules": {"success_fraction": 0.05, "success_distance_m": 1000.0},
    "cameras": True,
}
"""Short episodes that end by infraction, success and time."""


def commands(steps, worlds):
    rng = np.random.default_rng(1)
    gas = np.linspace(0.1, 1.0, worlds)
    noise = rng.uniform(-1.0, 1.0, (steps, worlds, 2)) * (0.3, 0.4)
    return (noise + np.stack([gas, np.zeros(worlds)], -1)).astype(np.float32)


def assert_same_finals(ours, theirs):
    assert ("final_obs" in ours) == ("final_obs" in theirs)
    if "final_obs" not in theirs:
        return 0
    mask = theirs["_final_obs"]
    np.testing.assert_array_equal(ours["_final_obs"], mask)
    for mine, other in zip(ours["final_obs"][mask], theirs["final_obs"][mask], strict=True):
        assert_same(mine, other)
    return int(mask.sum())


# deeply copied for each separate environment, as the vector environment does for its worlds
SOURCES = {
    "seeing": Seeing,
    "mixed": lambda: {"road": Seeing(), "route": Counter(), "default": "ground_truth"},
    "corrupted": lambda: CorruptedBEV(
        "ground_truth", latency=0.3, flicker=0.3, rotation=0.5, geometry=GEOMETRY
    ),
    "batched": Batch,
}
GEOMETRY = bev_driving_env.BEVTownEnv("Town02", **SMALL).world.config.bev


@pytest.mark.parametrize("source", list(SOURCES))
@pytest.mark.parametrize("mode", MODES)
def test_every_world_sees_what_a_single_environment_sees(mode, source):
    make = SOURCES[source]
    worlds = 3
    batched = vector(worlds, mode, bev_source=make(), **ENDS)
    separate = SyncVectorEnv(
        [lambda: single(bev_source=make(), **ENDS)] * worlds, autoreset_mode=mode
    )
    assert_same(batched.reset(seed=42)[0], separate.reset(seed=42)[0])
    ends = finals = 0
    for action in commands(40, worlds):
        ours, theirs = batched.step(action), separate.step(action)
        assert_same(ours[0], theirs[0])
        finals += assert_same_finals(ours[-1], theirs[-1])
        ended = ours[2] | ours[3]
        ends += int(ended.sum())
        if mode is AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended.copy()}
            both = [envs.reset(options=dict(options))[0] for envs in (batched, separate)]
            assert_same(*both)
    assert ends >= 6
    assert finals == (ends if mode is AutoresetMode.SAME_STEP else 0)


def test_worlds_have_looks_of_their_own_and_frames_as_a_single_environment():
    envs = vector(3, cameras=True)
    observations, _ = envs.reset(seed=7, options={"episode": 0})
    frames = envs.sensor_frames()
    for i in range(3):
        env = single(cameras=True)
        observation, _ = env.reset(seed=7 + i, options={"episode": 0})
        assert_same({key: array[i] for key, array in observations.items()}, observation)
        for name, array in vars(env.sensor_frame()).items():
            np.testing.assert_array_equal(getattr(frames[i], name), array)
    images = observations["cameras"].astype(float)
    assert np.abs(images[0] - images[1]).mean() > 3.0
    assert not np.array_equal(observations["route_map"][0], observations["route_map"][1])


# --- asked once a moment -------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_a_source_is_asked_once_a_world_and_moment_and_reset_once_an_episode(mode):
    worlds = 3
    envs = vector(worlds, mode, bev_source=Counter(), **ENDS)
    observations, _ = envs.reset(seed=5)
    asked, episodes = np.ones(worlds, int), np.ones(worlds, int)
    waiting = np.zeros(worlds, bool)
    ends = 0
    for action in commands(60, worlds):
        observations, _, terminated, truncated, infos = envs.step(action)
        ended = terminated | truncated
        asked, episodes = np.where(waiting, 1, asked + 1), episodes + waiting
        if mode is AutoresetMode.SAME_STEP:
            for i in np.flatnonzero(ended):
                final = infos["final_obs"][i]["bev"]
                assert (final[0, 0, 0], final[1, 0, 0]) == (asked[i], episodes[i])
            asked, episodes = np.where(ended, 1, asked), episodes + ended
        if mode is AutoresetMode.DISABLED and ended.any():
            observations, _ = envs.reset(options={"reset_mask": ended})
            asked, episodes = np.where(ended, 1, asked), episodes + ended
        waiting = ended if mode is AutoresetMode.NEXT_STEP else waiting
        ends += int(ended.sum())
        assert observations["bev"][:, 0, 0, 0].tolist() == asked.tolist()
        assert observations["bev"][:, 1, 0, 0].tolist() == episodes.tolist()
    assert ends >= 9


@pytest.mark.parametrize("mode", MODES)
def test_a_batched_source_gets_all_frames_of_a_step_in_one_call(mode):
    source = Batch()
    envs = vector(4, mode, bev_source=source, time_limit_s=60.0, terminate_on=())
    envs.reset(seed=0)
    for count in range(2, 6):
        envs.step(np.full((4, 2), 0.1, np.float32))
        assert source.calls == count
    assert source.sizes == [4] * 5


def test_looking_and_drawing_do_not_ask_a_source():
    env = single(bev_source=Counter(), render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    env.draw()
    env.sensor_frame()
    env.ground_truth_bev()
    env.snapshot()
    observation, *_ = env.step(GAS)
    assert observation["bev"][0, 0, 0] == 2


# --- rewinding -----------------------------------------------------------------------------------


def corrupted():
    return CorruptedBEV(
        "ground_truth",
        latency=0.5,
        flicker=0.4,
        pixel_dropout=0.2,
        blob_dropout=0.2,
        geometry=GEOMETRY,
    )


def rollout(env, steps=12):
    results = []
    for action in commands(steps, 1)[:, 0]:
        observation, *rest = env.step(action)
        results.append((observation, rest))
    return results


def assert_same_rollout(first, second):
    for (one, rest), (other, other_rest) in zip(first, second, strict=True):
        assert_same(one, other)
        assert rest == other_rest


@pytest.mark.parametrize("pickled", [False, True])
def test_going_back_repeats_cameras_route_map_and_every_error_bit_for_bit(pickled):
    env = single(cameras=True, bev_source=corrupted(), terminate_on=())
    env.reset(seed=3)
    last = rollout(env, 7)[-1][0]
    snapshot = env.snapshot()
    if pickled:
        snapshot = pickle.loads(pickle.dumps(snapshot))
    first = rollout(env)
    env.reset(seed=9)
    rollout(env, 4)
    assert_same(env.restore(snapshot), last)
    assert_same_rollout(rollout(env), first)
    # the branch goes on in another environment too
    other = single(cameras=True, bev_source=corrupted(), terminate_on=())
    assert_same(other.restore(snapshot), last)
    assert_same_rollout(rollout(other), first)


def test_the_vector_environment_goes_back_with_its_sources():
    envs = vector(3, bev_source=corrupted(), **ENDS)
    envs.reset(seed=3)
    for action in commands(6, 3):
        last = envs.step(action)[0]
    snapshot = pickle.loads(pickle.dumps(envs.snapshot()))
    first = [envs.step(action)[0] for action in commands(25, 3)]
    assert_same(envs.restore(snapshot), last)
    for action, expected in zip(commands(25, 3), first, strict=True):
        assert_same(envs.step(action)[0], expected)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("ground_truth", Counter()),
        (Counter(), "ground_truth"),
        (Seeing(), Counter()),
        (Seeing(), {"lane": "ground_truth", "default": Counter()}),
    ],
)
def test_a_snapshot_fits_where_the_policy_sees_through_another_source(before, after):
    env, other = single(bev_source=before), single(bev_source=after)
    env.reset(seed=0)
    rollout(env, 5)
    other.reset(seed=1)
    rollout(other, 5)
    observation = other.restore(env.snapshot())
    assert other.ego_pose == env.ego_pose
    if after == "ground_truth":
        np.testing.assert_array_equal(observation["bev"], env.ground_truth_bev())
    else:
        # asked once in an episode that is its second: it has started anew
        assert observation["bev"][0, 0, 0] == 1
        assert observation["bev"][1, 0, 0] == 2
    assert other.step(GAS)[0]["bev"].shape == (6, SIDE, SIDE)


def test_a_snapshot_of_other_doses_is_of_another_source():
    blind, clear = (
        single(bev_source=CorruptedBEV("ground_truth", pixel_dropout=dose, geometry=GEOMETRY))
        for dose in (1.0, 0.0)
    )
    blind.reset(seed=0)
    observation = clear.restore(blind.snapshot())
    np.testing.assert_array_equal(observation["bev"], clear.ground_truth_bev())


def test_the_route_map_changes_from_episode_to_episode_but_not_on_looking_again():
    env = single(cameras=True)
    first = env.reset(seed=0, options={"episode": 0})[0]["route_map"]
    np.testing.assert_array_equal(env.sensor_frame().route_map, first)
    second = env.reset(seed=1, options={"episode": 0})[0]["route_map"]
    assert first.any()
    assert not np.array_equal(first, second)
