"""Taking down a drive."""

import numpy as np
import pytest

from bev_driving_env.env import BEVTownEnv
from bev_driving_env.logs.recorder import EpisodeRecorder

REST = {"collection": 0, "collection_seed": 0, "route": 0, "level": 0.0}
COAST = np.zeros(2, np.float32)


@pytest.fixture(scope="module")
def env():
    return BEVTownEnv("Town02", traffic={"vehicles": 2, "pedestrians": 3}, terminate_on=())


def test_both_actions_and_the_route_are_kept(env):
    env.reset(seed=0, options={"route": 0})
    recorder = EpisodeRecorder(env.world, **REST)
    recorder.record([0.5, 0.0], [0.25, -0.5])
    log = recorder.finish("lost")
    assert log.clean.tolist() == [[0.5, 0.0]]
    assert log.applied.tolist() == [[0.25, -0.5]]
    assert log.header.lanes == tuple(env.route.lanes)
    assert log.header.outcome == "lost"
    assert [len(log.header.vehicle_sizes), len(log.header.pedestrian_sizes)] == [2, 3]


def test_infractions_are_kept_with_the_step_that_they_lead_to(env):
    env.reset(seed=0, options={"route": 0})
    recorder = EpisodeRecorder(env.world, **REST)
    began = []
    for _ in range(60):
        recorder.record(COAST, [1.0, 0.4])
        env.step([1.0, 0.4])
        began.append(int(env.world.began[0]))
    recorder.record(COAST, COAST)
    log = recorder.finish("success")
    assert any(began)
    assert log.infractions.tolist() == [0, *began]
    assert log.header.infractions[0]["name"] == env.world.events[0][0].name


def test_it_starts_at_the_reset_and_leaves_no_step_out(env):
    env.reset(seed=0, options={"route": 0})
    recorder = EpisodeRecorder(env.world, **REST)
    with pytest.raises(ValueError, match="without a step"):
        recorder.finish("success")
    env.step(COAST)
    with pytest.raises(ValueError, match="right after a reset, got step 1"):
        EpisodeRecorder(env.world, **REST)
    with pytest.raises(ValueError, match="expected step 0, the world is at 1"):
        recorder.record(COAST, COAST)
