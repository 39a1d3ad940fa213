"""``collision_static``: hitting what stands beside the road, driven step by step."""

import gymnasium as gym
import numpy as np
import pytest

from agents import Expert
from bev_driving_env.frames import footprint
from bev_driving_env.towns.furniture import CAR, LAMP, PILLAR, TREE
from bev_driving_env.towns.registry import compiled_town

from ..polygons import overlap

LENGTH, WIDTH = 5.0, 2.0
SPEED = 5.0


def make(**keywords):
    keywords = {"terminate_on": (), **keywords}
    return gym.make("bev_driving_env:BEVTown02-v0", **keywords).unwrapped


@pytest.fixture(scope="module")
def env():
    return make()


@pytest.fixture(scope="module")
def hard():
    return make(appearance="hard")


def hit_along(boxes, start, metres):
    """How many boxes a car touches on its way straight ahead, each counted once."""
    x, y, heading = start
    ways = np.arange(0.0, metres, 0.2)[:, None]
    centres = np.array([x, y]) + ways * [np.cos(heading), np.sin(heading)]
    hit = 0
    for box in boxes:
        reach = (np.hypot(LENGTH, WIDTH) + np.hypot(*box[3:])) / 2.0
        near = centres[np.hypot(*(centres - box[:2]).T) < reach]
        solid = footprint(box[:3], *box[3:])
        hit += any(overlap(footprint((*at, heading), LENGTH, WIDTH), solid) for at in near)
    return hit


def isolated(town, kinds, *, dense=False):
    """A start 9 m before a lonely thing of a kind, facing it; nothing else is in the way."""
    boxes = town.solids(dense=dense).boxes
    props = town.furniture(dense=dense)
    more = len(props) - len(town.furniture(dense=False))
    chosen = props[len(props) - more :] if dense else props
    for prop in chosen:
        if prop.kind not in kinds:
            continue
        for heading in prop.heading + np.arange(8) * np.pi / 4.0:
            start = prop.x - 9.0 * np.cos(heading), prop.y - 9.0 * np.sin(heading), heading
            close = boxes[np.hypot(boxes[:, 0] - prop.x, boxes[:, 1] - prop.y) < 40.0]
            if hit_along(close, start, 18.0) == 1 and hit_along(close, start, 5.0) == 0:
                return start
    raise AssertionError("nothing stands alone")


def drive_from(env, start, steps):
    """The events of driving straight ahead at 5 m/s from a pose."""
    env.reset(seed=0, options={"episode": 0})
    env.world.state.ego[0] = (*start, SPEED)
    names = []
    for _ in range(steps):
        *_, info = env.step([0.0, 0.0])
        names += info["infractions"]
    events = [event for event in env.world.events[0] if event.name == "collision_static"]
    assert names.count("collision_static") == len(events)
    return events


@pytest.mark.parametrize("kind", [LAMP, TREE])
def test_driving_through_a_pole_or_a_tree_is_one_event_in_its_place(env, kind):
    start = isolated(env.world.town, [kind])
    (event,) = drive_from(env, start, 36)
    gone = np.hypot(event.x - start[0], event.y - start[1])
    # the front bumper is half a length ahead of the centre; a trunk is half a metre thick
    assert gone == pytest.approx(9.0 - LENGTH / 2.0, abs=1.0)
    assert event.heading == pytest.approx(start[2])


def test_standing_in_a_house_is_one_event_until_the_car_has_left_and_comes_again(env):
    start = isolated(env.world.town, [LAMP])
    env.reset(seed=0, options={"episode": 0})
    forth = np.array([*start[:2], 0.0]) + np.array([np.cos(start[2]), np.sin(start[2]), 0.0]) * 9.0
    seen = []
    # within 2 s it would still be the same collision
    for (x, y), steps in [(forth[:2], 1), (forth[:2], 9), (start[:2], 21), (forth[:2], 1)]:
        env.world.state.ego[0] = (x, y, start[2], 0.0)
        infos = [env.step([0.0, 0.0])[-1] for _ in range(steps)]
        seen.append(sum(info["infractions"].count("collision_static") for info in infos))
    assert seen == [1, 0, 0, 1]


def test_off_the_road_straight_into_the_houses_ends_the_episode_once():
    env = make(terminate_on=("collision_static",))
    env.reset(seed=0, options={"episode": 0})
    terminated, steps = False, 0
    while not terminated and steps < 200:
        *_, terminated, _, info = env.step([0.5, 0.25])
        steps += 1
    assert terminated
    assert "collision_static" in info["infractions"]
    names = [event["name"] for event in info["episode_summary"]["infractions"]]
    assert names.count("collision_static") == 1
    assert names.index("off_road") < names.index("collision_static")
    boxes = env.world.town.solids(dense=False).boxes
    car = footprint(env.ego_pose, LENGTH, WIDTH)
    assert any(overlap(car, footprint(box[:3], *box[3:])) for box in boxes)


def test_a_hit_costs_what_an_infraction_costs(env):
    start = isolated(env.world.town, [LAMP])
    env.reset(seed=0, options={"episode": 0})
    env.world.state.ego[0] = (*start, SPEED)
    for _ in range(36):
        *_, info = env.step([0.0, 0.0])
        if "collision_static" in info["infractions"]:
            assert info["reward_terms"]["infractions"] <= -1.0
            return
    raise AssertionError("nothing was hit")


def test_only_hard_looks_put_more_in_the_way(env, hard):
    start = isolated(env.world.town, [CAR, PILLAR, TREE], dense=True)
    sparse, dense = (env.world.town.solids(dense=which).boxes for which in (False, True))
    assert hit_along(sparse, start, 18.0) == 0
    assert hit_along(dense, start, 18.0) == 1
    assert drive_from(env, start, 36) == []
    assert len(drive_from(hard, start, 36)) == 1


@pytest.mark.parametrize("look", ["train", "hard"])
def test_the_expert_hits_nothing(look):
    env = make(appearance=look, terminate_on=None)
    for options in ({"episode": 1}, {"split": "test", "index": 3}, {"split": "val", "index": 7}):
        env.reset(seed=0, options=options)
        expert, ended = Expert(env), False
        while not ended:
            # the expert looks at the environment, not at its observation
            *_, terminated, truncated, info = env.step(expert.act({}))
            ended = terminated or truncated
        assert info["success"]
        assert env.world.events[0] == ()


def test_no_lane_of_either_town_leads_into_anything():
    for name in ("Town01", "Town02"):
        town = compiled_town(name)
        boxes = town.solids(dense=True).boxes
        for lane in town.lanes[::3]:
            pose = lane.pose_at(lane.length_m / 2.0)
            near = boxes[np.hypot(boxes[:, 0] - pose[0], boxes[:, 1] - pose[1]) < 25.0]
            car = footprint(pose, LENGTH, WIDTH)
            assert not any(overlap(car, footprint(box[:3], *box[3:])) for box in near)
