"""``SmoothedBEV``: a memory that moves with the car."""

import numpy as np
import pytest

from agents import Expert
from bev_driving_env import BEVTownEnv
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.sources.protocol import SensorFrame
from bev_driving_env.sources.registry import make_bev_source
from bev_driving_env.sources.smoothed import EgoMotion, SmoothedBEV, ego_motion, moved
from bev_driving_env.world.config import VehicleModel, WorldConfig

GEOMETRY = BEVGeometry()


class Given:
    """Shows the planes that it is told to show."""

    channels = ("road", "route", "vehicles")

    def __init__(self):
        self.planes = np.zeros((3, 192, 192), np.uint8)

    def reset(self):
        pass

    def __call__(self, frame):
        return self.planes.copy()


def frame(speed=0.0, steering=0.0):
    empty = np.zeros((4, 1, 1, 3), np.uint8)
    measurements = np.array([speed, 0.0, steering], np.float32)
    return SensorFrame(
        empty, np.zeros((4, 3, 3)), np.zeros((4, 4, 4)), empty[0, :, :, 0], measurements
    )


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def test_dead_reckoning_moves_the_map_as_the_world_does():
    still, followed = [], []
    with BEVTownEnv("Town01") as env:
        observation, _ = env.reset(seed=0, options={"episode": 2})
        expert = Expert(env)
        for _ in range(220):
            before = observation
            observation, *_, terminated, _, _ = env.step(expert.act(observation))
            motion = ego_motion(
                before["measurements"],
                observation["measurements"],
                VehicleModel(),
                WorldConfig().step_s,
            )
            old, new = (each["bev"][0] for each in (before, observation))
            predicted = moved(old.astype(np.float32), motion, GEOMETRY) >= 127.5
            inside = slice(20, 172)  # what comes into view cannot be known
            still.append(iou(old[inside, inside] > 0, new[inside, inside] > 0))
            followed.append(iou(predicted[inside, inside], new[inside, inside] > 0))
            if terminated:
                break
    assert min(followed) > 0.97
    assert min(still) < 0.93


def test_straight_ahead_the_map_comes_closer():
    plane = np.zeros((192, 192), np.float32)
    plane[100, 96] = 255.0
    seen = moved(plane, EgoMotion(1.0, 0.0, 0.0), GEOMETRY)
    assert np.unravel_index(seen.argmax(), seen.shape) == (105, 96)  # 1 m is 5 px


def test_turning_left_the_map_turns_right_about_the_car():
    plane = np.zeros((192, 192), np.float32)
    plane[152 - 50, 96] = 255.0  # 10 m ahead
    seen = moved(plane, EgoMotion(0.0, 0.0, np.pi / 2.0), GEOMETRY)
    assert np.unravel_index(seen.argmax(), seen.shape) == (152, 96 + 50)


def test_what_is_lost_for_a_moment_is_remembered():
    source = Given()
    smoothed = SmoothedBEV(source, 0.6)
    smoothed.reset()
    source.planes[:, 100:120] = 255
    first = smoothed(frame())
    source.planes[:] = 0
    second, third, fourth = (smoothed(frame()) for _ in range(3))
    assert (first[:2, 100:120] == 255).all()
    assert (second[:2, 100:120] == 255).all()  # 0.6
    assert not third[:2].any()  # 0.36
    assert not fourth.any()
    assert not second[2].any()  # vehicles are not remembered


def test_without_memory_nothing_changes():
    source = Given()
    source.planes[0, 50:60] = 255
    smoothed = SmoothedBEV(source, 0.0)
    smoothed.reset()
    smoothed(frame())
    source.planes[:] = 0
    assert not smoothed(frame()).any()


def test_a_reset_forgets():
    source = Given()
    smoothed = SmoothedBEV(source, 0.9)
    source.planes[:] = 255
    smoothed(frame())
    source.planes[:] = 0
    smoothed.reset()
    assert not smoothed(frame()).any()


def test_a_snapshot_brings_the_memory_back():
    source = Given()
    smoothed = SmoothedBEV(source, 0.9)
    source.planes[:] = 255
    smoothed(frame())
    kept = smoothed.snapshot()
    source.planes[:] = 0
    first = [smoothed(frame(3.0, 0.1)) for _ in range(3)]
    smoothed.restore(kept)
    again = [smoothed(frame(3.0, 0.1)) for _ in range(3)]
    np.testing.assert_array_equal(first, again)
    assert first[0].any()


def test_it_is_made_from_text():
    made = make_bev_source("ipm~memory=0.5")
    assert repr(made) == "SmoothedBEV('ipm', memory=0.5)"
    corrupted = make_bev_source("ipm~memory=0.5,shift=0.2")
    assert type(corrupted).__name__ == "CorruptedBEV"


@pytest.mark.parametrize("memory", [-0.1, 1.0, float("nan"), "much"])
def test_a_memory_out_of_range_is_an_error(memory):
    with pytest.raises(ValueError, match=r"memory must be from 0 to below 1"):
        SmoothedBEV("ipm", memory)


def test_the_truth_needs_no_memory():
    with pytest.raises(ValueError, match="starts from the truth"):
        make_bev_source("ground_truth~memory=0.5")
