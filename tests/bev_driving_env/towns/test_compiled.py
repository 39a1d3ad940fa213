import itertools
import math

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, LineType, SineLane, StraightLane
from highway_env.road.road import RoadNetwork
from scipy.integrate import quad

from bev_driving_env.kernels.layout import JUNCTION_BIT, LANE_BIT, ROAD_BIT, SIDEWALK_BIT
from bev_driving_env.towns.compiled import CompiledTown, compile_network
from bev_driving_env.towns.network import TownNetwork


def stadium():
    """One-way clockwise loop: 60 m east, half a circle of 20 m, 60 m west, half a circle."""
    network = RoadNetwork()
    quarter = math.pi / 2.0
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [60.0, 0.0]))
    network.add_lane("b", "c", CircularLane([60.0, 20.0], 20.0, -quarter, quarter, clockwise=True))
    network.add_lane("c", "d", StraightLane([60.0, 40.0], [0.0, 40.0]))
    network.add_lane("d", "a", CircularLane([0.0, 20.0], 20.0, quarter, 3 * quarter))
    return network


def chain(*points, names="abcdefgh"):
    network = RoadNetwork()
    for k, (start, end) in enumerate(itertools.pairwise(points)):
        network.add_lane(names[k], names[k + 1], StraightLane(list(start), list(end)))
    return network


def bits(source, x, y):
    """Value of a raster, or of a town's raster of classes, at a world point."""
    raster = source.classes() if isinstance(source, CompiledTown) else source
    row = math.floor((y - raster.grid.y0_m) * raster.grid.px_per_m)
    column = math.floor((x - raster.grid.x0_m) * raster.grid.px_per_m)
    return int(raster.pixels[row, column])


def test_a_plain_loop_compiles_to_its_own_geometry():
    town = compile_network("stadium", stadium())
    lengths = [lane.length_m for lane in town.lanes]
    assert lengths == pytest.approx([60.0, 20.0 * math.pi, 60.0, 20.0 * math.pi])
    assert town.successors == ((1,), (2,), (3,), (0,))
    np.testing.assert_allclose(town.bounds, (-20.0, 0.0, 80.0, 40.0), atol=0.01)
    turns = [lane.heading_change_rad for lane in town.lanes]
    assert [abs(turn) for turn in turns] == pytest.approx([0.0, math.pi, 0.0, math.pi])


def test_a_plain_network_is_paved_as_wide_as_its_lanes_and_has_neither_sidewalk_nor_signal():
    town = compile_network("stadium", stadium())
    assert bits(town, 30.0, 1.9) & ROAD_BIT
    assert not bits(town, 30.0, 2.1) & ROAD_BIT
    assert bits(town, 80.0 - 1.9, 20.0) & ROAD_BIT
    assert not bits(town, 80.0 + 2.1, 20.0) & ROAD_BIT
    assert not (town.classes().pixels & SIDEWALK_BIT).any()
    assert town.stop_lines.shape == (0, 4)


def test_a_lane_gives_poses_along_its_center():
    town = compile_network("stadium", stadium())
    assert town.lanes[0].pose_at(15.0) == pytest.approx((15.0, 0.0, 0.0))
    x, y, heading = town.lanes[1].pose_at(10.0 * math.pi)
    assert (x, y, heading) == pytest.approx((80.0, 20.0, math.pi / 2.0), abs=0.01)


SINE = {"amplitude": 3.0, "pulsation": 0.15, "phase": 0.4}


def test_a_sine_lane_is_paved_along_its_wave():
    network = RoadNetwork()
    network.add_lane("a", "b", SineLane([0.0, 10.0], [80.0, 10.0], **SINE))
    town = compile_network("wave", network, allow_dead_ends=True)
    for x in np.linspace(1.0, 79.0, 40):
        y = 10.0 + 3.0 * math.sin(0.15 * x + 0.4)
        assert bits(town, x, y) & ROAD_BIT
        assert not bits(town, x, y + 2.3) & ROAD_BIT
        assert not bits(town, x, y - 2.3) & ROAD_BIT


def test_a_sine_lane_is_as_long_as_its_wave_not_as_its_chord():
    network = RoadNetwork()
    network.add_lane("a", "b", SineLane([0.0, 10.0], [80.0, 10.0], **SINE))
    town = compile_network("wave", network, allow_dead_ends=True)
    wave, _ = quad(lambda s: math.hypot(1.0, 0.45 * math.cos(0.15 * s + 0.4)), 0.0, 80.0)
    assert wave > 83.0
    assert town.lanes[0].length_m == pytest.approx(wave, rel=1e-3)


def test_a_dead_end_is_refused_with_its_node_unless_allowed():
    network = chain((0, 0), (50, 0), (100, 0))
    with pytest.raises(ValueError, match="dead end at node 'c'"):
        compile_network("street", network)
    town = compile_network("street", network, allow_dead_ends=True)
    assert town.successors == ((1,), ())


def test_lanes_that_share_a_node_but_do_not_touch_do_not_lead_on():
    network = chain((0, 0), (50, 0))
    network.add_lane("b", "a", StraightLane([50.0, 5.0], [0.0, 5.0]))
    with pytest.raises(ValueError, match="dead end at node 'b'"):
        compile_network("street", network)


def test_an_empty_network_is_refused():
    with pytest.raises(ValueError, match="'void' has no lanes"):
        compile_network("void", RoadNetwork())


def test_lanes_at_a_node_where_roads_part_or_meet_are_in_a_junction():
    network = chain((0, 0), (50, 0), (100, 0), (150, 0))  # a b c d
    network.add_lane("b", "x", StraightLane([50.0, 0.0], [80.0, 30.0]))
    network.add_lane("x", "y", StraightLane([80.0, 30.0], [120.0, 30.0]))
    network.add_lane("y", "d", StraightLane([120.0, 30.0], [150.0, 0.0]))
    network.add_lane("d", "z", StraightLane([150.0, 0.0], [200.0, 0.0]))
    town = compile_network("fork", network, allow_dead_ends=True)
    inside = {lane.index[:2] for lane in town.lanes if lane.in_junction}
    assert inside == {("b", "c"), ("b", "x"), ("c", "d"), ("y", "d")}
    assert bits(town, 75.0, 0.5) & JUNCTION_BIT
    assert not bits(town, 25.0, 0.5) & JUNCTION_BIT


def test_the_two_directions_of_a_road_make_no_junction_where_roads_join():
    network = RoadNetwork()
    for start, end, x0, x1 in (("a", "b", 0.0, 40.0), ("b", "c", 40.0, 80.0)):
        network.add_lane(start, end, StraightLane([x0, 2.0], [x1, 2.0]))
        network.add_lane(end, start, StraightLane([x1, -2.0], [x0, -2.0]))
    town = compile_network("two-way", network, allow_dead_ends=True)
    assert not any(lane.in_junction for lane in town.lanes)


def test_boundaries_are_drawn_on_roads_and_not_inside_junctions_of_a_plain_network():
    network = chain((0, 0), (60, 0), (100, 0), (160, 0))
    network.add_lane("b", "x", StraightLane([60.0, 0.0], [90.0, 30.0]))
    town = compile_network("fork", network, allow_dead_ends=True)
    assert bits(town, 30.0, 2.0) & LANE_BIT
    assert not bits(town, 80.0, 2.0) & LANE_BIT


def test_parallel_lanes_of_one_road_are_no_junction_and_lead_on_side_by_side():
    network = RoadNetwork()
    for y in (0.0, 4.0):
        network.add_lane("a", "b", StraightLane([0.0, y], [50.0, y]))
        network.add_lane("b", "c", StraightLane([50.0, y], [100.0, y]))
    town = compile_network("highway", network, allow_dead_ends=True)
    assert not any(lane.in_junction for lane in town.lanes)
    leads = {town.lanes[k].index: town.successors[k] for k in range(4)}
    for number in (0, 1):
        (following,) = leads["a", "b", number]
        assert town.lanes[following].index == ("b", "c", number)


def test_where_a_junction_lane_crosses_a_road_no_direction_is_known():
    network = TownNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [100.0, 0.0]))
    network.add_lane("n", "s", StraightLane([50.0, -30.0], [50.0, 30.0]))
    network.junction_lanes = {("n", "s", 0)}
    town = compile_network("crossing", network, allow_dead_ends=True)
    assert bits(town.directions, 20.0, 0.1) == bits(town.directions, 80.0, 0.1) > 0
    assert bits(town.directions, 50.0, 0.1) == 0


def test_only_the_lines_a_lane_has_are_drawn():
    network = RoadNetwork()
    lines = [LineType.NONE, LineType.CONTINUOUS_LINE]
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [50.0, 0.0], line_types=lines))
    town = compile_network("street", network, allow_dead_ends=True)
    assert town.lanes[0].lines == (False, True)
    assert bits(town, 25.0, 2.05) & LANE_BIT  # south is right of an eastward lane
    assert not bits(town, 25.0, -1.95) & LANE_BIT


def test_a_network_too_large_to_draw_is_refused_with_its_extent():
    town = compile_network("desert", chain((0, 0), (9e4, 9e4)), allow_dead_ends=True)
    with pytest.raises(ValueError, match=r"too large.*90090 m x 90090 m.*px_per_m"):
        town.classes()


def test_a_raster_is_made_once_per_resolution():
    town = compile_network("stadium", stadium())
    assert town.classes(4.0) is town.classes(4.0)
    assert town.classes(4.0).grid.px_per_m == 4.0
    assert town.classes(8.0).pixels.shape[0] == pytest.approx(
        2 * town.classes(4.0).pixels.shape[0], abs=1
    )
