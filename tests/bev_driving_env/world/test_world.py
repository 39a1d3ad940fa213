import numpy as np
import pytest

from bev_driving_env.frames import BEVGeometry
from bev_driving_env.kernels.bev import LANE, LIGHTS, PEDESTRIANS, ROAD, ROUTE, VEHICLES
from bev_driving_env.towns.route import Route, random_route, route_by_turns
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World


def test_a_placed_car_stands_at_the_start_of_its_route(start):
    world = start()
    assert world.state.ego[0].tolist() == pytest.approx([20.0, 2.0, 0.0, 0.0])
    assert world.state.route_length[0] == pytest.approx(160.0)
    assert world.episode_ids == ["ring/0"]
    assert world.route_position_m(0) == 0.0
    assert world.events[0] == ()


def test_ten_actions_make_a_second(start, drive):
    world = start(speed=6.0)
    drive(world, 1.0)
    assert world.state.steps[0] == 10
    assert world.state.ego[0, 0] == pytest.approx(26.0)
    assert world.route_position_m(0) == pytest.approx(6.0)


def test_full_throttle_reaches_5_metres_per_second_in_a_second(start, drive):
    world = start()
    drive(world, 1.0, acceleration=1.0)
    assert world.state.ego[0, 3] == pytest.approx(5.0)
    # 20 explicit Euler steps of 0.05 s: each moves with the speed before it
    assert world.state.ego[0, 0] - 20.0 == pytest.approx(5.0 * 0.05**2 * sum(range(20)))


def test_the_action_becomes_the_command(start):
    world = start()
    world.step(np.array([[0.25, -0.5]]))
    assert world.state.command[0].tolist() == [0.25, -0.5]


def test_99_percent_of_the_route_near_its_end_is_success(start, drive):
    world = start(end=(60.0, 2.0), speed=6.0)
    while not world.success[0]:
        assert world.state.progress[0, 1] < 0.99 * 40.0
        drive(world, 0.1)
    assert world.state.progress[0, 1] >= 0.99 * 40.0
    assert world.terminated()[0]
    assert not world.events[0]


def test_at_the_end_of_a_lap_the_start_is_near_but_no_success(ring, drive):
    world = World(ring, WorldConfig())
    world.place(0, route_by_turns(ring, (60.0, 2.0), "", (58.0, 2.0)))
    world.state.ego[0, 3] = 6.0
    drive(world, 1.0)
    assert not world.success[0]


def test_99_percent_of_a_long_route_is_no_success_while_its_end_is_far(ring):
    # 1 % of a route of more than 1,000 m is more than 10 m
    world = World(ring, WorldConfig())
    lane = next(k for k, lane in enumerate(ring.lanes) if lane.index[0] == "A1.E.out")
    lap = route_by_turns(ring, (60.0, 2.0), "", (58.0, 2.0)).lanes
    route = Route(ring, (lane, *lap[1:], *lap[1:], *lap[1:]), 50.0, 170.0)
    assert route.length_m > 1400.0
    world.place(0, route)
    for remaining, success in [(12.0, False), (9.0, True)]:
        position = route.length_m - remaining
        k = round(position / route.spacing_m)
        world.state.ego[0, :2] = route.points[k, :2]
        world.state.progress[0, :2] = position
        world.step(np.zeros((1, 2)))
        assert bool(world.success[0]) == success


def test_the_time_limit_truncates_and_does_not_terminate(start, drive):
    world = start(time_limit_s=2.0)
    drive(world, 1.9)
    assert not world.truncated()[0]
    drive(world, 0.1)
    assert world.truncated()[0]
    assert not world.terminated()[0]


def test_placing_anew_forgets_the_episode_before(start, drive, ring):
    world = start(y=6.0, speed=5.0)
    drive(world, 1.0, steering=0.3)
    assert world.events[0]
    world.place(0, route_by_turns(ring, (30.0, 2.0), "", (90.0, 2.0)), "again")
    fresh = World(ring, WorldConfig())
    fresh.place(0, route_by_turns(ring, (30.0, 2.0), "", (90.0, 2.0)), "again")
    for name in ("ego", "command", "progress", "timers", "holding", "steps", "returns"):
        np.testing.assert_array_equal(getattr(world.state, name), getattr(fresh.state, name))
    assert world.events[0] == ()
    assert world.rewards[0] == 0.0


def test_a_world_that_is_not_running_keeps_its_state(start):
    world = start(speed=5.0, worlds=2)
    before = world.state.copy()
    world.step(np.ones((2, 2)), np.array([False, True]))
    assert world.state.ego[0].tolist() == before.ego[0].tolist()
    assert world.state.steps.tolist() == [0, 1]


def test_many_worlds_together_equal_each_alone(town):
    rng = np.random.default_rng(0)
    routes = [random_route(town, rng, 80.0, 300.0) for _ in range(4)]
    actions = rng.uniform(-1.0, 1.0, (60, 4, 2)) * [1.0, 0.2] + [0.4, 0.0]
    actions = np.clip(actions, -1.0, 1.0)
    together = World(town, WorldConfig(), 4)
    for k, route in enumerate(routes):
        together.place(k, route)
    for action in actions:
        together.step(action)
    pictures = np.empty((4, *together.bev_shape), np.uint8)
    together.render(pictures)
    for k, route in enumerate(routes):
        alone, picture = World(town, WorldConfig()), np.empty((1, *together.bev_shape), np.uint8)
        alone.place(0, route)
        for action in actions:
            alone.step(action[k : k + 1])
        alone.render(picture)
        assert alone.state.ego[0].tobytes() == together.state.ego[k].tobytes()
        assert alone.state.returns[0] == together.state.returns[k]
        assert alone.events[0] == together.events[k]
        np.testing.assert_array_equal(picture[0], pictures[k])


def test_the_view_shows_road_route_and_lane_around_the_car(start):
    world = start()
    bev = np.full((1, *world.bev_shape), 77, np.uint8)
    world.render(bev)
    # the car is 2 m right of the axis: kerbs at 6.3 m to its left and 2.3 m to its right
    row = bev[0, ROAD, 152]
    assert np.flatnonzero(row).tolist() == list(range(96 - 31, 96 + 12))
    assert bev[0, LANE, 152, 96 - 10] == 255  # the centre line, 2 m to the left
    assert bev[0, ROUTE, :152, 96].all()
    assert not bev[0, ROUTE, 153:].any()
    assert not bev[0, [VEHICLES, PEDESTRIANS, LIGHTS]].any()


def test_the_view_follows_the_route_position_as_the_car_drives(start, drive):
    world = start(speed=6.0)
    drive(world, 5.0)
    bev = np.empty((1, *world.bev_shape), np.uint8)
    world.render(bev)
    assert bev[0, ROUTE, 151, 96] == 255
    assert not bev[0, ROUTE, 154:].any()


def test_the_rules_do_not_depend_on_how_finely_the_view_is_drawn(start, drive):
    logs = []
    for geometry in (BEVGeometry(), BEVGeometry(size=48, px_per_m=1.25, ego_row=38)):
        world = start(speed=6.0, bev=geometry)
        drive(world, 4.0, steering=0.06)
        logs.append(world.events[0])
    assert logs[0] == logs[1]
    assert logs[0]
