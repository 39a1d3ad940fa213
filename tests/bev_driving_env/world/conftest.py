"""A world on the ring, with its car on the northern road."""

import numpy as np
import pytest

from bev_driving_env.towns.route import route_by_turns
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World


@pytest.fixture
def start(ring):
    """Function that makes a world whose route runs east along y = 2, from x = 20 on.

    The first world's car may be moved off the lane centre, turned and given a speed.
    """

    def make(*, end=(180.0, 2.0), y=2.0, heading=0.0, speed=0.0, worlds=1, **config):
        world = World(ring, WorldConfig(**config), worlds)
        for k in range(worlds):
            world.place(k, route_by_turns(ring, (20.0, 2.0), "", end), f"ring/{k}")
        world.state.ego[0, 1:] = y, heading, speed
        return world

    return make


@pytest.fixture
def drive():
    """Function that repeats one action in all worlds for some seconds."""

    def repeat(world, seconds, acceleration=0.0, steering=0.0):
        for _ in range(round(seconds * world.config.control_hz)):
            world.step(np.tile([float(acceleration), float(steering)], (len(world), 1)))

    return repeat
