import dataclasses

import numpy as np

from bev_driving_env.world.state import WorldState


def route(length_m):
    x = np.linspace(0.0, length_m, int(length_m) + 1)
    return np.column_stack([x, 0.0 * x, 0.0 * x + 1.0, 0.0 * x])


def arrays(state):
    return {item.name: getattr(state, item.name) for item in dataclasses.fields(state)}


def filled(worlds=2):
    """A state whose every number is different from zero."""
    state = WorldState.empty(worlds, vehicles=3, pedestrians=2, signals=4)
    for k, array in enumerate(arrays(state).values()):
        array[...] = k + 1
    return state


def test_an_empty_state_has_room_for_actors_and_signals():
    state = WorldState.empty(5, vehicles=3, pedestrians=2, signals=4)
    assert state.ego.shape == (5, 4)
    assert state.vehicles.shape == (5, 3, 6)
    assert state.pedestrians.shape == (5, 2, 6)
    assert state.signals.shape == (5, 4)
    assert not state.vehicles.any()


def test_a_copy_shares_nothing_with_the_original():
    state = filled()
    copy = state.copy()
    for name, array in arrays(copy).items():
        np.testing.assert_array_equal(array, getattr(state, name))
        assert not np.shares_memory(array, getattr(state, name))
        array[...] = 77
    assert all((array != 77).all() for array in arrays(state).values())


def test_nbytes_counts_every_array():
    state = filled()
    assert state.nbytes() == sum(len(array.tobytes()) for array in arrays(state).values())


def test_clearing_a_world_leaves_its_route_and_the_other_worlds():
    state, before = filled(), filled()
    state.clear(0)
    for name, array in arrays(state).items():
        np.testing.assert_array_equal(array[1], getattr(before, name)[1])
        if not name.startswith(("route_", "plan_")):
            assert not array[0].any()


def test_a_longer_route_makes_room_and_keeps_the_other_worlds_routes():
    state = WorldState.empty(3)
    state.set_route(0, route(10.0), 10.0)
    state.set_route(1, route(30.0), 30.0)
    np.testing.assert_array_equal(state.route_points[0, :11], route(10.0))
    np.testing.assert_array_equal(state.route_points[1], route(30.0))
    assert state.route_size.tolist() == [11, 31, 0]
    assert state.route_length.tolist() == [10.0, 30.0, 0.0]
    assert state.route_spacing.tolist() == [1.0, 1.0, 1.0]


def test_a_shorter_route_leaves_nothing_of_the_longer_one_behind():
    state = WorldState.empty(1)
    state.set_route(0, route(30.0), 30.0)
    state.set_route(0, route(10.0), 10.0)
    assert not state.route_points[0, 11:].any()
    assert state.route_size[0] == 11
