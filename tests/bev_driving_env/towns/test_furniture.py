import hashlib
import itertools
import math
from collections import Counter, defaultdict

import cv2
import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.layout import ROAD_BIT
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.furniture import (
    BUILDING,
    CAR,
    HEDGE,
    HOUSE,
    KINDS,
    LAMP,
    PILLAR,
    SIGNAL,
    TREE,
    furnish,
)
from bev_driving_env.towns.registry import compiled_town

CLEARANCE_M = 0.3
SIZES_M = {"length_m": (0.05, 30.0), "width_m": (0.05, 30.0), "height_m": (0.5, 20.0)}


@pytest.fixture(scope="module")
def plain():
    """A one-way loop of a plain highway-env network: no sidewalks, no signals."""
    network, quarter = RoadNetwork(), math.pi / 2.0
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [90.0, 0.0]))
    network.add_lane("b", "c", CircularLane([90.0, 25.0], 25.0, -quarter, quarter))
    network.add_lane("c", "d", StraightLane([90.0, 50.0], [0.0, 50.0]))
    network.add_lane("d", "a", CircularLane([0.0, 25.0], 25.0, quarter, 3 * quarter))
    return compile_network("plain", network)


@pytest.fixture(params=["Town01", "Town02", "ring", "ladder", "plain"], scope="module")
def furnished(request):
    """Every town of these tests in turn."""
    if request.param.startswith("Town"):
        return compiled_town(request.param)
    return request.getfixturevalue(request.param)


def distance_to_road(town, prop, most_m=3.0):
    """From the footprint of a prop to the nearest centre of a road pixel, if one is near."""
    raster = town.classes()
    grid, reach = raster.grid, math.hypot(prop.length_m, prop.width_m) / 2.0 + most_m
    left, right = ((np.array([-reach, reach]) + prop.x - grid.x0_m) * grid.px_per_m).astype(int)
    top, bottom = ((np.array([-reach, reach]) + prop.y - grid.y0_m) * grid.px_per_m).astype(int)
    left, top = max(left, 0), max(top, 0)
    rows, columns = np.nonzero(raster.pixels[top : bottom + 1, left : right + 1] & ROAD_BIT)
    if len(rows) == 0:
        return most_m
    x = grid.x0_m + (columns + left + 0.5) / grid.px_per_m - prop.x
    y = grid.y0_m + (rows + top + 0.5) / grid.px_per_m - prop.y
    cos, sin = math.cos(prop.heading), math.sin(prop.heading)
    ahead = np.abs(x * cos + y * sin) - prop.length_m / 2.0
    across = np.abs(y * cos - x * sin) - prop.width_m / 2.0
    return float(np.hypot(np.maximum(ahead, 0.0), np.maximum(across, 0.0)).min())


def overlap_m2(a, b):
    """Area that the footprints of two props share, by OpenCV."""
    boxes = [
        footprint((p.x - a.x, p.y - a.y, p.heading), p.length_m, p.width_m).astype(np.float32)
        for p in (a, b)
    ]
    return cv2.intersectConvexConvex(*boxes)[0]


def touching_pairs(props):
    """Pairs of props whose circumscribed circles overlap."""
    places = np.array([(p.x, p.y) for p in props])
    radii = np.array([math.hypot(p.length_m, p.width_m) / 2.0 for p in props])
    for i, prop in enumerate(props):
        near = np.hypot(*(places[i + 1 :] - places[i]).T) < radii[i + 1 :] + radii[i]
        for j in np.flatnonzero(near) + i + 1:
            yield prop, props[j]


def hides(prop, start, end):
    """Whether the footprint of a prop cuts the line of sight between two points."""
    cos, sin = math.cos(prop.heading), math.sin(prop.heading)
    turn = np.array([[cos, sin], [-sin, cos]])
    origin = turn @ (start - (prop.x, prop.y))
    step = turn @ (end - start)
    first, last = 0.0, 1.0
    for at, by, half in zip(origin, step, (prop.length_m / 2, prop.width_m / 2), strict=True):
        if abs(by) < 1e-12:
            if abs(at) >= half:
                return False
            continue
        low, high = sorted(((-half - at) / by, (half - at) / by))
        first, last = max(first, low), min(last, high)
    return first < last


def arms(town):
    """Lanes that lead into each junction, by the junction's name."""
    result = defaultdict(list)
    for lane, following in zip(town.lanes, town.successors, strict=True):
        inside = [town.lanes[k] for k in following if town.lanes[k].in_junction]
        if inside and not lane.in_junction:
            result[inside[0].junction].append(lane)
    return result


def digests():
    seen = []
    for name, dense in (("Town01", True), ("Town02", False)):
        props = compiled_town(name).furniture(dense=dense)
        seen.append(
            hashlib.sha256(repr([tuple(map(float, p)) for p in props]).encode()).hexdigest()
        )
    return seen


def test_furniture_is_the_same_in_every_process(printed_elsewhere):
    assert printed_elsewhere(__file__) == digests()


def test_furnishing_again_gives_the_same(furnished):
    for dense in (False, True):
        assert furnish(furnished, dense=dense) == furnished.furniture(dense=dense)


@pytest.mark.parametrize("dense", [False, True])
def test_nothing_solid_stands_on_the_pavement_or_within_30_cm_of_it(furnished, dense):
    close = []
    for prop in furnished.furniture(dense=dense):
        distance = distance_to_road(furnished, prop)
        if distance < CLEARANCE_M:
            close.append((KINDS[prop.kind], round(prop.x, 1), round(prop.y, 1), distance))
    assert not close


def test_the_distance_to_the_road_is_that_of_a_toy(ring):
    # traffic heading east keeps to y = 2, the pavement ends at y = 4.3
    lamp = furnish(ring)[0]._replace(x=100.0, y=6.0, heading=0.0, length_m=4.0, width_m=2.0)
    assert distance_to_road(ring, lamp) == pytest.approx(0.75, abs=0.051)
    assert distance_to_road(ring, lamp._replace(y=4.5)) == 0.0
    assert distance_to_road(ring, lamp._replace(heading=math.pi / 2)) == 0.0


@pytest.mark.parametrize("dense", [False, True])
def test_no_two_things_overlap(furnished, dense):
    props = furnished.furniture(dense=dense)
    pairs = [(a, b) for a, b in touching_pairs(props) if overlap_m2(a, b) > 0.01]
    assert not pairs


def test_a_thing_overlaps_itself_and_not_its_neighbour(ring):
    house = furnish(ring)[0]._replace(x=5.0, y=6.0, heading=0.3, length_m=8.0, width_m=10.0)
    assert overlap_m2(house, house) == pytest.approx(80.0, rel=1e-4)
    beside = house._replace(x=5.0 + 8.0 * math.cos(0.3), y=6.0 + 8.0 * math.sin(0.3))
    assert overlap_m2(house, beside) < 0.01


def test_dense_adds_things_that_hide_and_keeps_all_others(furnished):
    usual, dense = furnished.furniture(), furnished.furniture(dense=True)
    assert not Counter(usual) - Counter(dense)
    added = Counter(prop.kind for prop in Counter(dense) - Counter(usual))
    assert {HEDGE, PILLAR} <= set(added) <= {HEDGE, PILLAR, CAR, TREE}
    assert len(dense) > 1.1 * len(usual)


def test_every_kind_of_furniture_occurs_in_the_towns(town):
    assert {p.kind for p in town.furniture()} == set(range(len(KINDS))) - {PILLAR}
    assert {p.kind for p in town.furniture(dense=True)} == set(range(len(KINDS)))


def test_things_have_sensible_sizes_and_numbers(furnished):
    for prop in furnished.furniture(dense=True):
        for name, (low, high) in SIZES_M.items():
            assert low <= getattr(prop, name) <= high, prop
        assert 0 <= prop.kind < len(KINDS)
        assert 0 <= prop.variant < 1000
        assert isinstance(prop.variant, int)
        assert np.isfinite([prop.x, prop.y, prop.heading]).all()


def test_streets_are_lined_with_buildings_and_lamps(furnished):
    kinds = Counter(prop.kind for prop in furnished.furniture())
    road_m = sum(lane.length_m for lane in furnished.lanes if not lane.in_junction)
    assert kinds[BUILDING] + kinds[HOUSE] > road_m / 100.0
    assert kinds[LAMP] > road_m / 100.0
    assert kinds[TREE] > 0


def test_a_lamp_stands_every_25_to_40_m_on_the_ring(ring):
    lamps = [p for p in ring.furniture() if p.kind == LAMP]
    # those on the northern sidewalk of the northern street, outside of which the street lies
    north = sorted(p.x for p in lamps if p.y < -4.0)
    assert len(north) >= 4
    gaps = np.diff(north)
    assert gaps.min() > 24.9
    assert gaps.max() < 40.1


@pytest.mark.parametrize("kind", [BUILDING, HOUSE])
def test_buildings_stand_beyond_the_sidewalk_with_a_side_along_the_street(ring, kind):
    buildings = [p for p in ring.furniture() if p.kind == kind]
    # away from the ring's corners, streets run east and west
    straight = [p for p in buildings if 30.0 < p.x < 170.0]
    assert straight
    for prop in straight:
        assert abs(math.sin(2.0 * prop.heading)) < 1e-9
        assert distance_to_road(ring, prop, 9.0) > 4.0  # the sidewalk is 4 m wide


def test_signals_have_one_post_each_in_their_order(town):
    posts = [p for p in town.furniture() if p.kind == SIGNAL]
    assert len(posts) == len(town.signals)
    lanes = {lane.index: lane for lane in town.lanes}
    for post, signal in zip(posts, town.signals, strict=True):
        # moved sideways off the pavement, if at all
        ahead = np.array([math.cos(post.heading), math.sin(post.heading)])
        shift = np.array([post.x - signal.x, post.y - signal.y])
        assert abs(shift @ ahead) < 1e-6
        assert np.hypot(*shift) < 4.0
        # its heading is that of the traffic it stops
        np.testing.assert_allclose(ahead, lanes[signal.lane].points[-1, 2:], atol=1e-9)


def test_towns_without_signals_have_no_posts(ring, plain):
    for town in (ring, plain):
        assert SIGNAL not in {p.kind for p in town.furniture(dense=True)}


def test_some_building_stands_near_the_corner_of_most_arms(town):
    buildings = [p for p in town.furniture() if p.kind in (BUILDING, HOUSE)]
    near = []
    for lanes in arms(town).values():
        center = np.mean([lane.points[-1, :2] for lane in lanes], axis=0)
        for lane in lanes:
            x, y, dx, dy = lane.points[-1]
            count = 0
            for prop in buildings:
                corners = footprint((prop.x, prop.y, prop.heading), prop.length_m, prop.width_m)
                outside = (corners - (x, y)) @ (dx, dy) < 6.0  # on this arm, not beyond
                close = np.hypot(*(corners - center).T) < 25.0
                count += (outside & close).any()
            near.append(count > 0)
    assert len(near) >= 24
    assert np.mean(near) > 0.8


def test_corners_hide_side_roads(town):
    buildings = [p for p in town.furniture() if p.kind in (BUILDING, HOUSE)]
    hidden = []
    for lanes in arms(town).values():
        for lane, other in itertools.permutations(lanes, 2):
            if abs(lane.points[-1, 2:] @ other.points[-1, 2:]) > 0.5:
                continue  # straight across
            # drivers 20 m before their stop lines
            here, there = (one.points[-1, :2] - 20.0 * one.points[-1, 2:] for one in (lane, other))
            hidden.append(any(hides(prop, here, there) for prop in buildings))
    assert len(hidden) >= 30
    assert np.mean(hidden) > 0.8


def test_the_line_of_sight_is_cut_by_what_stands_in_it_alone(ring):
    house = furnish(ring)[0]._replace(x=0.0, y=0.0, heading=math.pi / 4, length_m=4.0, width_m=2.0)
    start, end = np.array([-5.0, -5.0]), np.array([5.0, 5.0])
    assert hides(house, start, end)
    assert not hides(house, start, -np.ones(2) * 2.1)
    east = np.array([1.0, 0.0])
    assert not hides(house, start + 3.0 * east, end + 3.0 * east)
    assert hides(house, start + 1.3 * east, end + 1.3 * east)


def test_a_plain_network_gets_all_that_needs_no_sidewalk(plain):
    kinds = {KINDS[p.kind] for p in plain.furniture()}
    assert {"building", "house", "lamp", "tree"} <= kinds
    # off the road on both sides of the loop
    inside = [p for p in plain.furniture() if 0.0 < p.x < 90.0 and 4.0 < p.y < 46.0]
    outside = [p for p in plain.furniture() if p.y < -4.0 or p.y > 54.0]
    assert inside or outside


if __name__ == "__main__":
    print(*digests())
