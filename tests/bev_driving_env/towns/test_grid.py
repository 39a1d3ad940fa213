import dataclasses
import math

import pytest
from highway_env.road.lane import CircularLane

from bev_driving_env.towns.build import build_grid_town
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.grid import GridTown
from bev_driving_env.towns.network import CrossSection
from bev_driving_env.towns.route import turn_letter

RING = GridTown(
    columns={"A": 0.0, "B": 80.0},
    rows={"1": 0.0, "2": 60.0},
    links="A1-B1 B1-B2 A2-B2 A1-A2",
    junctions="",
    corners="A1 10  B1 10  B2 10  A2 10",
)
T_TOWN = GridTown(
    columns={"A": 0.0, "B": 50.0, "C": 100.0},
    rows={"1": 0.0, "2": 40.0},
    links="A1-B1 B1-C1 A2-B2 B2-C2 A1-A2 B1-B2 C1-C2",
    junctions="""
        B1 8  E 10 62,-4  S 11 54,12  W 12 38,4
        B2 8  N 10 46,28  E 10 62,36  W 10 38,44
    """,
    corners="A1 9  C1 9  C2 9  A2 9",
)


def changed(town, **fields):
    return build_grid_town(dataclasses.replace(town, **fields))


def circles(network):
    return [lane for lane in network.lanes_list() if isinstance(lane, CircularLane)]


def test_a_ring_has_a_lane_each_way_on_every_side_and_at_every_corner():
    network = build_grid_town(RING)
    assert len(network.lanes_list()) == 2 * 4 + 2 * 4
    assert sorted(lane.radius for lane in circles(network)) == [8.0] * 4 + [12.0] * 4
    clockwise = 2 * (60.0 + 40.0) + 2.0 * math.pi * 8.0
    anticlockwise = 2 * (60.0 + 40.0) + 2.0 * math.pi * 12.0
    total = sum(lane.length for lane in network.lanes_list())
    assert total == pytest.approx(clockwise + anticlockwise)
    assert not network.signals
    assert not network.junction_lanes


def test_right_turns_are_4_m_tighter_than_left_turns_of_the_same_junction():
    network = build_grid_town(T_TOWN)
    inside = [network.get_lane(index) for index in network.junction_lanes]
    radii = sorted(lane.radius for lane in inside if isinstance(lane, CircularLane))
    assert radii == pytest.approx([6.0] * 4 + [10.0] * 4)


def test_a_wide_turn_changes_the_radius_of_its_own_movement_only():
    network = changed(T_TOWN, wide_turns={"B1 S>W": 11.5})
    radii = sorted(lane.radius for lane in circles(network) if lane.radius not in (7.0, 11.0))
    # arriving by the southern arm, so heading north, and leaving west: a left turn
    assert radii == pytest.approx([6.0] * 4 + [10.0] * 3 + [11.5])


def test_lane_width_shoulder_sidewalk_and_speed_limit_come_from_the_table():
    network = changed(RING, lane_width_m=3.5, shoulder_m=1.0, sidewalk_m=2.5, speed_limit_mps=8.0)
    assert {lane.width for lane in network.lanes_list()} == {3.5}
    assert {lane.speed_limit for lane in network.lanes_list()} == {8.0}
    assert sorted({lane.radius for lane in circles(network)}) == [8.25, 11.75]
    assert network.cross_section == CrossSection(shoulder_m=1.0, sidewalk_m=2.5)


@pytest.mark.parametrize("link", ["A1-B2", "A1-A1"])
def test_a_link_off_the_grid_is_refused_by_name(link):
    with pytest.raises(ValueError, match=link):
        changed(RING, links=RING.links + " " + link)


@pytest.mark.parametrize("node", ["Z1", "A9", "B"])
def test_an_unknown_node_is_refused_with_the_columns_and_rows_there_are(node):
    with pytest.raises(ValueError, match=f"'{node}'.*AB.*12"):
        changed(RING, links=f"A1-{node}")


def test_a_node_that_is_neither_corner_nor_junction_is_refused_by_name():
    with pytest.raises(ValueError, match="B2"):
        changed(RING, corners="A1 10  B1 10  A2 10")


def test_a_junction_without_the_arm_a_road_arrives_by_is_refused_by_name():
    with pytest.raises(ValueError, match=r"B1.*S"):
        changed(T_TOWN, junctions=T_TOWN.junctions.replace("S 11 54,12", ""))


def test_a_junction_arm_without_a_road_is_refused_by_name():
    with pytest.raises(ValueError, match="B1"):
        changed(T_TOWN, links=T_TOWN.links.replace("B1-B2", ""))


def test_a_corner_with_a_single_road_is_refused_by_name():
    with pytest.raises(ValueError, match="B2"):
        changed(RING, links="A1-B1 B1-B2 A1-A2")


@pytest.mark.parametrize("name", ["shoulder_m", "sidewalk_m"])
@pytest.mark.parametrize("value", [-0.1, 21.0, math.nan])
def test_an_impossible_cross_section_is_refused_by_name_and_value(name, value):
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        CrossSection(**{name: value})


CROSS = dataclasses.replace(
    T_TOWN,
    rows={"1": 0.0, "2": 40.0, "3": 80.0},
    links="A1-B1 B1-C1 A2-B2 B2-C2 A3-B3 B3-C3 A1-A2 A2-A3 B1-B2 B2-B3 C1-C2 C2-C3",
    junctions="""
        B1 8  E 10 62,-4  S 11 54,12  W 12 38,4
        A2 8  N 10 -4,28  E 10 12,36  S 10 4,52
        B2 8  N 10 46,28  E 10 62,36  S 10 54,52  W 10 38,44
        C2 8  N 10 96,28  S 10 104,52  W 10 88,44
        B3 8  N 10 46,68  E 10 62,76  W 10 38,84
    """,
    corners="A1 9  C1 9  A3 9  C3 9",
)


def test_a_junction_of_four_arms_has_twelve_movements_and_four_signals():
    town = compile_network("cross", build_grid_town(CROSS))
    ways = [
        (lane, following)
        for lane, options in enumerate(town.successors)
        for following in options
        if len(options) > 1 and town.lanes[following].junction == "B2"
    ]
    assert len(ways) == 4 * 3
    assert [turn_letter(town, following) for _, following in ways].count("S") == 4
    assert sum(signal.junction == "B2" for signal in town.signals) == 4


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"columns": {"AB": 0.0}}, "one letter each, got 'AB'"),
        ({"lane_width_m": 0.0}, r"lane_width_m.*got 0\.0"),
        ({"speed_limit_mps": math.nan}, "speed_limit_mps.*got nan"),
        ({"links": "A1B1"}, "'A1B1'"),
        ({"corners": "A1 10 B1"}, "pairs of node and radius.*got 'A1 10 B1'"),
        ({"corners": "A1 -1"}, r"corner A1 .*got -1\.0"),
        ({"corners": "Z1 9"}, "unknown node 'Z1'"),
        ({"junctions": "B1 8 E 10"}, "one line such as.*got 'B1 8 E 10'"),
        ({"junctions": "B1 8 E 10 62"}, "one line such as"),
        ({"junctions": "B1 8 E 10 62,0 Q 3 1,1 S 1 0,0"}, "junction B1 .*three or four arms"),
        ({"junctions": "B1 8 E 10 62,0 W 3 1,1"}, "junction B1 .*three or four arms.*got E, W"),
        ({"wide_turns": {"B1 S>W": 0.0}}, r"wide_turns\['B1 S>W'\].*0\.0"),
    ],
)
def test_an_entry_that_cannot_be_read_is_refused_when_the_table_is_made(fields, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(T_TOWN, **fields)
