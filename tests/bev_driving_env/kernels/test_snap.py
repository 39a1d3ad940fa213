"""Other road users' rows lie on a grid: exact in few bits, and near enough to notice nothing."""

import numpy as np
import pytest

from bev_driving_env.kernels.snap import PER_RAD, PER_UNIT, snap, snap_rows, write_row
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.towns.route import random_route
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import TrafficConfig


@pytest.mark.parametrize("value", [0.0, -3.2, 396.38, 1e-5, -1e-5, 123.0004882])
def test_snapping_moves_by_at_most_half_a_step_and_only_once(value):
    snapped = snap(value, PER_UNIT)
    assert abs(snapped - value) <= 0.5 / PER_UNIT
    assert snapped * PER_UNIT == round(snapped * PER_UNIT)
    assert snap(snapped, PER_UNIT) == snapped


def test_a_written_row_keeps_its_size():
    row = np.array([0.0, 0.0, 0.0, 0.0, 4.123, 1.77])
    write_row(row, 1.23456, -7.65432, 2.34567, 5.4321)
    np.testing.assert_allclose(row[:4], [1.23456, -7.65432, 2.34567, 5.4321], atol=5e-4)
    assert row[4:].tolist() == [4.123, 1.77]


def on_grid(rows):
    units = rows[:, [0, 1, 3]] * PER_UNIT
    turns = rows[:, 2] * PER_RAD
    return bool((units == units.round()).all() and (turns == turns.round()).all())


def test_all_rows_of_a_world_are_on_the_grid_from_the_first_moment_on():
    town = compiled_town("Town02")
    world = World(town, WorldConfig(traffic=TrafficConfig(30, 60, True)))
    world.place(0, random_route(town, np.random.default_rng(0), 100.0, 400.0))
    for _ in range(200):
        assert on_grid(world.state.vehicles[0])
        assert on_grid(world.state.pedestrians[0])
        world.step(np.zeros((1, 2)))
    rows = world.state.pedestrians[0] + 1e-4
    assert not on_grid(rows)
    snap_rows(rows)
    assert on_grid(rows)
