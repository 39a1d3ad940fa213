import math

import numpy as np
import pytest
from highway_env.road.road import RoadNetwork

from bev_driving_env import road_network

NODES = {
    "Town01": """
        B1 90.4,0 B2 90.4,57.5 B3 90.4,131.45 B4 90.4,197.15 B5 90.4,328.6 C1 156.05,0
        C2 156.05,57.5 D1 336.8,0 D2 336.8,57.5 D3 336.8,131.45 D4 336.8,197.15 D5 336.8,328.6
    """,
    "Town02": """
        A2 -5.4,189.6 B2 43.85,189.6 B3 43.85,238.9 B4 43.85,304.55
        C2 134.15,189.6 C3 134.15,238.9 D2 191.7,189.6 D3 191.7,238.9
    """,
}
CORNERS = {
    "Town01": {(0.0, 0.0): 8.9, (0.0, 328.6): 9.9, (394.3, 0.0): 8.9, (394.3, 328.6): 9.2},
    "Town02": {
        (-5.4, 107.4): 9.6,
        (-5.4, 304.55): 8.4,
        (191.7, 107.4): 10.1,
        (191.7, 304.55): 10.3,
    },
}
BOUNDS = {"Town01": (-2.06, -2.05, 396.38, 330.61), "Town02": (-7.46, 105.39, 193.74, 306.56)}
OUTSIDE_JUNCTIONS_KM = {"Town01": 4.96, "Town02": 2.112}


def junction_centers(town):
    words = NODES[town.name].split()
    places = [tuple(float(part) for part in text.split(",")) for text in words[1::2]]
    return dict(zip(words[::2], places, strict=True))


def passages(town):
    """Every way through a junction: lane before, lane after, and the lanes between."""
    for number, lane in enumerate(town.lanes):
        if lane.in_junction or len(town.successors[number]) < 2:
            continue
        for following in town.successors[number]:
            inside = [following]
            while len(town.successors[inside[-1]]) == 1 and town.lanes[inside[-1]].in_junction:
                inside.append(town.successors[inside[-1]][0])
            yield number, inside.pop(), inside


def test_every_lane_leads_on_without_a_gap_or_a_kink(town):
    starts = {}
    for number, lane in enumerate(town.lanes):
        starts.setdefault(lane.index[0], set()).add(number)
    for number, lane in enumerate(town.lanes):
        assert set(town.successors[number]) == starts[lane.index[1]]
        for following in town.successors[number]:
            joint = town.lanes[following].points[0] - lane.points[-1]
            assert np.abs(joint).max() < 1e-6


def test_each_junction_has_three_arms_and_all_six_movements(town):
    found = {name: set() for name in junction_centers(town)}
    for before, after, inside in passages(town):
        middle = town.lanes[inside[len(inside) // 2]].points[:, :2].mean(axis=0)
        centers = junction_centers(town)
        name = min(centers, key=lambda node: math.dist(centers[node], middle))
        assert math.dist(centers[name], middle) < 12.0
        headings = [
            round(math.degrees(math.atan2(lane.points[0, 3], lane.points[0, 2]))) % 360
            for lane in (town.lanes[before], town.lanes[after])
        ]
        assert headings[1] != (headings[0] + 180) % 360, "nobody turns back in a junction"
        found[name].add(tuple(headings))
    for name, movements in found.items():
        assert len(movements) == 6, name
        assert len({heading for heading, _ in movements}) == 3, name


def test_a_town_has_four_corners_of_the_measured_radius(town):
    bends = [
        lane for lane in town.lanes if not lane.in_junction and abs(lane.heading_change_rad) > 1.0
    ]
    assert len(bends) == 8
    for (x, y), radius in CORNERS[town.name].items():
        there = [lane for lane in bends if math.dist(lane.points[0, :2], (x, y)) < 20.0]
        inner, outer = sorted(lane.length_m / (math.pi / 2.0) for lane in there)
        assert inner == pytest.approx(radius - 2.0, abs=1e-6)
        assert outer == pytest.approx(radius + 2.0, abs=1e-6)


def test_lane_centers_fill_the_measured_bounding_box(town):
    np.testing.assert_allclose(town.bounds, BOUNDS[town.name], atol=0.1)


def test_lane_length_outside_junctions_is_the_measured_one(town):
    total_km = sum(lane.length_m for lane in town.lanes if not lane.in_junction) / 1000.0
    assert total_km == pytest.approx(OUTSIDE_JUNCTIONS_KM[town.name], rel=0.005)


def test_every_lane_reaches_every_other(town):
    for start in (0, len(town.lanes) // 2):
        seen, todo = {start}, [start]
        while todo:
            fresh = set(town.successors[todo.pop()]) - seen
            seen |= fresh
            todo += fresh
        assert len(seen) == len(town.lanes)


def test_lanes_are_4_m_wide_and_limited_to_25_miles_per_hour(town):
    for lane in town.lanes:
        np.testing.assert_allclose(2.0 * lane.half_width, 4.0)
        assert lane.speed_limit_mps == pytest.approx(11.18, abs=0.01)


def test_lanes_lie_on_the_right_hand_side_of_their_road(town):
    roads = [lane for lane in town.lanes if not lane.in_junction]
    for lane in roads:
        x, y, heading = lane.pose_at(lane.length_m / 2.0)
        opposite = (x + 4.0 * math.sin(heading), y - 4.0 * math.cos(heading))  # 4 m to the left
        partners = [
            other
            for other in roads
            if math.dist(other.pose_at(other.length_m / 2.0)[:2], opposite) < 0.02
        ]
        assert len(partners) == 1
        turned = partners[0].pose_at(partners[0].length_m / 2.0)[2] - heading
        assert math.cos(turned) == pytest.approx(-1.0)


def test_compiled_samples_lie_on_highway_envs_own_lanes(town):
    network = road_network(town.name)
    for lane in town.lanes:
        original = network.get_lane(lane.index)
        assert lane.length_m == pytest.approx(original.length)
        for station, (x, y, dx, dy) in zip(lane.stations, lane.points, strict=True):
            along, lateral = original.local_coordinates(np.array([x, y]))
            assert along == pytest.approx(station, abs=1e-6)
            assert lateral == pytest.approx(0.0, abs=1e-6)
            turn = original.local_angle(math.atan2(dy, dx), along)
            assert turn == pytest.approx(0.0, abs=1e-9)


def test_highway_env_finds_the_same_lanes(town):
    network = road_network(town.name)
    assert isinstance(network, RoadNetwork)
    rng = np.random.default_rng(0)
    for lane in town.lanes:
        if not lane.in_junction:
            x, y, heading = lane.pose_at(rng.uniform(0.1, 0.9) * lane.length_m)
            beside = np.array([x, y]) + rng.uniform(-0.5, 0.5, 2)
            assert network.get_closest_lane_index(beside, heading) == lane.index


def test_each_road_network_is_new_and_free_to_be_changed():
    first = road_network("Town02")
    first.graph.clear()
    assert road_network("Town02").graph
