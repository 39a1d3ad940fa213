import math

import numpy as np
from scipy.ndimage import binary_erosion

from bev_driving_env.kernels.layout import JUNCTION_BIT, LANE_BIT, ROAD_BIT, SIDEWALK_BIT


def bits_at(raster, x, y):
    """Raster values at world points."""
    column = np.floor((np.asarray(x) - raster.grid.x0_m) * raster.grid.px_per_m).astype(int)
    row = np.floor((np.asarray(y) - raster.grid.y0_m) * raster.grid.px_per_m).astype(int)
    return raster.pixels[row, column]


def across(lane, raster, rights, share=0.5):
    """Raster values along the cross-section of a lane, at distances right of the road's axis."""
    x, y, heading = lane.pose_at(share * lane.length_m)
    rights = np.asarray(rights) - 2.0  # the lane centre is 2 m right of the axis
    return bits_at(raster, x - rights * math.sin(heading), y + rights * math.cos(heading))


def roads(town):
    return [lane for lane in town.lanes if not lane.in_junction]


def test_pavement_is_4_3_m_and_sidewalk_4_m_more_to_each_side_of_the_axis(town):
    for lane in roads(town):
        for side in (-1.0, 1.0):
            paved = across(lane, town.classes(), side * np.array([0.1, 2.0, 3.9, 4.2]))
            assert (paved & ROAD_BIT).all()
            assert not (paved & SIDEWALK_BIT).any()
            walked = across(lane, town.classes(), side * np.array([4.4, 6.0, 8.2]))
            assert (walked & SIDEWALK_BIT).all()
            assert not (walked & ROAD_BIT).any()
            beyond = across(lane, town.classes(), side * np.array([8.4, 9.5]))
            assert not (beyond & (ROAD_BIT | SIDEWALK_BIT)).any()


def test_sidewalk_is_never_on_the_road(town):
    both = ROAD_BIT | SIDEWALK_BIT
    assert not (town.classes().pixels & both == both).any()


def test_boundaries_run_unbroken_along_the_axis_and_both_edges_of_every_road(town):
    for lane in roads(town):
        margin = 0.2 / lane.length_m
        for share in np.linspace(margin, 1.0 - margin, int(lane.length_m / 0.2)):
            lines = across(lane, town.classes(), [-4.0, -0.05, 0.05, 4.0], share)
            assert (lines & LANE_BIT).all()


def test_boundaries_are_0_4_m_wide_and_nothing_else_is_marked(town):
    for lane in roads(town):
        for axis in (-4.0, 0.0, 4.0):
            marked = across(lane, town.classes(), axis + np.array([-0.1, 0.1]))
            assert (marked & LANE_BIT).all()
        between = across(lane, town.classes(), [-3.7, -2.0, -0.3, 0.3, 2.0, 3.7])
        assert not (between & LANE_BIT).any()


def test_nothing_is_marked_inside_junctions(town):
    pixels = town.classes().pixels
    inside = binary_erosion(pixels & JUNCTION_BIT > 0, iterations=3)
    assert inside.sum() > 1000
    assert not (pixels[inside] & LANE_BIT).any()


def test_every_way_through_a_junction_is_paved(town):
    for lane in town.lanes:
        if lane.in_junction:
            for share in np.linspace(0.0, 1.0, 9):
                here = across(lane, town.classes(), [0.1, 2.0, 3.9], share)
                assert (here & ROAD_BIT).all()
                assert (here & JUNCTION_BIT).all() or share in (0.0, 1.0)


def test_junctions_reach_to_their_stop_lines_and_no_farther(town):
    for x0, y0, x1, y1 in town.stop_lines:
        middle = np.array([x0 + x1, y0 + y1]) / 2.0
        across_line = np.array([x1 - x0, y1 - y0]) / math.dist((x0, y0), (x1, y1))
        # the line runs from the lane's left to its right, so travel is its left normal
        travel = np.array([across_line[1], -across_line[0]])
        before, after = (bits_at(town.classes(), *(middle + s * 0.3 * travel)) for s in (-1, 1))
        assert not before & JUNCTION_BIT
        assert after & JUNCTION_BIT


def test_lane_directions_are_known_on_roads_and_nowhere_else(town):
    directions = town.directions
    for lane in roads(town):
        for share in (0.02, 0.31, 0.5, 0.97):
            x, y, heading = lane.pose_at(share * lane.length_m)
            code = int(bits_at(directions, x, y))
            assert code > 0
            stored = (code - 1) * 2.0 * math.pi / 255
            assert math.cos(stored - heading) > math.cos(math.radians(8.0))
    for lane in town.lanes:
        if lane.in_junction:
            x, y, _ = lane.pose_at(lane.length_m / 2.0)
            assert bits_at(directions, x, y) == 0


def test_towns_span_the_map_with_room_for_the_view_around(town):
    grid, (rows, columns) = town.classes().grid, town.classes().pixels.shape
    x0, y0, x1, y1 = town.bounds
    assert min(x0 - grid.x0_m, y0 - grid.y0_m) >= 36.0
    assert grid.x0_m + columns / grid.px_per_m - x1 >= 36.0
    assert grid.y0_m + rows / grid.px_per_m - y1 >= 36.0
