import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bev_driving_env.frames import footprint
from bev_driving_env.kernels.overlap import SolidGrid, boxes_overlap, hits_any
from bev_driving_env.towns.solids import index_solids

CAR = (4.9, 2.0)


def overlap(a, b):
    """The kernel's answer for boxes (x, y, heading, length, width)."""

    def arguments(box):
        x, y, heading, length, width = box
        return x, y, math.cos(heading), math.sin(heading), length / 2.0, width / 2.0

    return boxes_overlap(*arguments(a), *arguments(b))


def contains(box, points):
    """Which points (K, 2) a box contains."""
    x, y, heading, length, width = box
    dx, dy = points[:, 0] - x, points[:, 1] - y
    ahead = dx * math.cos(heading) + dy * math.sin(heading)
    right = dy * math.cos(heading) - dx * math.sin(heading)
    return (np.abs(ahead) <= length / 2.0) & (np.abs(right) <= width / 2.0)


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def edges_cross(p, q, r, s):
    """Whether segments p-q and r-s cross properly."""
    sides = cross(q - p, r - p) * cross(q - p, s - p)
    return sides < 0.0 and cross(s - r, p - r) * cross(s - r, q - r) < 0.0


def overlap_by_parts(a, b):
    """Convex polygons overlap when one has a corner in the other or their edges cross."""
    corners = footprint(a[:3], *a[3:]), footprint(b[:3], *b[3:])
    if contains(a, corners[1]).any() or contains(b, corners[0]).any():
        return True
    return any(
        edges_cross(corners[0][i - 1], corners[0][i], corners[1][k - 1], corners[1][k])
        for i in range(4)
        for k in range(4)
    )


def grown(box, by_m):
    return *box[:3], box[3] + by_m, box[4] + by_m


headings = st.floats(-7.0, 7.0) | st.sampled_from([0.0, math.pi / 2.0, math.pi / 4.0, math.pi])
extents = st.floats(0.1, 12.0) | st.sampled_from([0.15, 4.9, 2.0])
boxes = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), headings, extents, extents)


@settings(max_examples=200, deadline=None)
@given(boxes, boxes)
@example((0.0, 0.0, 0.0, 12.0, 0.15), (0.0, 0.0, 1.0, 12.0, 0.15))  # no corner in the other
@example((0.0, 0.0, 0.0, 12.0, 12.0), (1.0, 2.0, 1.0, 0.15, 0.15))  # no edges cross
def test_boxes_overlap_when_corners_lie_inside_or_edges_cross(a, b):
    # a hair's breadth around touching is left to rounding
    if overlap_by_parts(a, grown(b, -1e-6)):
        assert overlap(a, b)
    if not overlap_by_parts(a, grown(b, 1e-6)):
        assert not overlap(a, b)
    assert overlap(a, b) == overlap(b, a)


@pytest.mark.parametrize("seed", range(3))
def test_boxes_overlap_when_a_dense_sample_of_one_lies_in_the_other(seed):
    rng = np.random.default_rng(seed)
    step = 0.02
    for _ in range(150):
        a, b = (
            (*rng.uniform(-3.5, 3.5, 2), rng.uniform(-4.0, 4.0), *rng.uniform(0.15, 5.0, 2))
            for _ in range(2)
        )
        ahead, right = (
            np.linspace(-extent / 2.0, extent / 2.0, math.ceil(extent / step) + 1)
            for extent in a[3:]
        )
        ahead, right = (part.ravel() for part in np.meshgrid(ahead, right))
        cos, sin = math.cos(a[2]), math.sin(a[2])
        points = np.column_stack(
            [a[0] + ahead * cos - right * sin, a[1] + ahead * sin + right * cos]
        )
        if contains(b, points).any():
            assert overlap(a, b)
        elif not contains(grown(b, 2.0 * step), points).any():
            assert not overlap(a, b)


@pytest.mark.parametrize(
    ("b", "expected"),
    [
        ((4.0, 0.0, 0.0, 4.0, 2.0), True),  # bumper to bumper
        ((4.001, 0.0, 0.0, 4.0, 2.0), False),
        ((0.0, -2.0, 0.0, 4.0, 2.0), True),  # door to door
        ((0.0, -2.001, 0.0, 4.0, 2.0), False),
        ((4.0, 2.0, 0.0, 4.0, 2.0), True),  # corner to corner
        ((4.001, 2.0, 0.0, 4.0, 2.0), False),
        ((0.0, 0.0, 0.0, 4.0, 2.0), True),  # one in the other
        ((0.5, 0.2, 0.7, 0.1, 0.1), True),
    ],
)
def test_touching_is_overlapping(b, expected):
    assert overlap((0.0, 0.0, 0.0, 4.0, 2.0), b) == expected


def test_circles_that_meet_do_not_make_boxes_overlap():
    # turned by 45 degrees and beyond the corner of a car: only its own axis tells them apart
    assert not overlap((0.0, 0.0, 0.0, 4.0, 2.0), (2.8, 1.8, math.pi / 4.0, 2.0, 1.0))
    assert overlap((0.0, 0.0, 0.0, 4.0, 2.0), (2.8, 1.8, math.pi / 4.0, 2.6, 1.0))


@pytest.mark.parametrize("heading", [0.0, 0.3, 2.0, -1.2])
def test_a_pole_15_cm_thick_is_hit_from_every_side(heading):
    cos, sin = math.cos(heading), math.sin(heading)
    car = (12.0, -7.0, heading, *CAR)
    for ahead in np.arange(-3.0, 3.01, 0.05):
        for right in np.arange(-1.5, 1.51, 0.05):
            place = 12.0 + ahead * cos - right * sin, -7.0 + ahead * sin + right * cos
            margin = min(2.45 + 0.075 - abs(ahead), 1.0 + 0.075 - abs(right))
            if abs(margin) > 1e-6:
                assert overlap(car, (*place, heading, 0.15, 0.15)) == (margin > 0.0)


def test_a_pole_turned_by_45_degrees_reaches_by_half_its_diagonal():
    for right, expected in [(1.1, True), (1.107, False)]:
        pole = (0.3, right, math.pi / 4.0, 0.15, 0.15)
        assert overlap((0.0, 0.0, 0.0, *CAR), pole) == expected


def hits(solids, ego):
    return hits_any(
        solids.boxes,
        solids.cell_start,
        solids.cell_items,
        solids.grid,
        np.array([*ego, 0.0]),
        CAR[0] / 2.0,
        CAR[1] / 2.0,
    )


def street_furniture(rng, count):
    """Poles, walls and houses around the origin."""
    kinds = np.array([[0.15, 0.15], [0.5, 0.5], [40.0, 0.3], [18.0, 12.0]])
    table = np.empty((count, 5))
    table[:, :2] = rng.uniform(-60.0, 60.0, (count, 2))
    table[:, 2] = rng.uniform(-4.0, 4.0, count)
    table[:, 3:] = kinds[rng.choice(4, count, p=[0.6, 0.2, 0.1, 0.1])]
    return table


@pytest.mark.parametrize("cell_m", [1.5, 8.0, 70.0])
@pytest.mark.parametrize("count", [1, 6, 120])
def test_the_grid_gives_the_answer_of_asking_every_solid(cell_m, count):
    rng = np.random.default_rng(count)
    table = street_furniture(rng, count)
    solids = index_solids(table, cell_m)
    answers = []
    for _ in range(600):
        ego = (*rng.uniform(-75.0, 75.0, 2), rng.uniform(-4.0, 4.0))
        if rng.random() < 0.5:  # around one of them
            ego = (*(table[rng.integers(count), :2] + rng.normal(0.0, 2.0, 2)), ego[2])
        expected = any(overlap((*ego, *CAR), box) for box in table)
        assert hits(solids, ego) == expected
        answers.append(expected)
    assert 0.1 < np.mean(answers) < 0.95


def test_a_pole_on_the_border_between_cells_is_hit_from_both_sides():
    # the grid starts at the first pole's left edge
    solids = index_solids([[0.0, 0.0, 0.0, 0.15, 0.15], [16.0, 0.0, 0.0, 0.15, 0.15]], 4.0)
    for x in np.arange(12.0, 20.0, 0.1):
        reach = 2.45 + 0.075 - abs(x - 16.0)
        if abs(reach) > 1e-6:
            assert hits(solids, (x, 0.0, 0.0)) == (reach > 0.0)


@pytest.mark.parametrize(
    "place",
    [
        (-9.0, 0.0),
        (9.0, 0.0),
        (0.0, 9.0),
        (0.0, -9.0),
        (1e300, 0.0),
        (0.0, -1e300),
        (math.nan, 0.0),
    ],
)
def test_outside_the_grid_nothing_is_hit(place):
    solids = index_solids([[0.0, 0.0, 0.0, 2.0, 2.0]])
    assert hits(solids, (0.0, 0.0, 0.0))
    assert not hits(solids, (*place, 0.3))


def test_a_car_partly_outside_the_grid_still_hits_what_is_at_its_border():
    solids = index_solids([[0.0, 0.0, 0.0, 2.0, 2.0]])
    for angle in np.arange(0.0, 2.0 * math.pi, 0.1):
        cos, sin = math.cos(angle), math.sin(angle)
        assert hits(solids, (3.2 * cos, 3.2 * sin, angle))
        assert not hits(solids, (4.0 * cos, 4.0 * sin, angle))


def test_a_town_without_solids_has_nothing_to_hit():
    assert not hits(index_solids(np.zeros((0, 5))), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("cell", range(9))
def test_only_cells_near_the_ego_are_looked_at(cell):
    box = np.array([[12.0, 12.0, 0.0, 1.0, 1.0]])
    start = np.array([0] * (cell + 1) + [1] * (9 - cell))  # only this cell lists the box
    ego = np.array([12.0, 12.0, 0.0, 0.0])
    grid = SolidGrid(0.0, 0.0, 8.0, 3, 3)
    assert hits_any(box, start, np.array([0]), grid, ego, 2.45, 1.0) == (cell == 4)
