import math

import numpy as np
import pytest
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork
from scipy.spatial import cKDTree

from bev_driving_env.cameras.scenery import build_scenery, kerb_lines
from bev_driving_env.frames import footprint
from bev_driving_env.kernels import paints as paint
from bev_driving_env.kernels.layout import ROAD_BIT
from bev_driving_env.kernels.shapes import EMISSIVE, PATTERNS
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.furniture import (
    BUILDING,
    CAR,
    FENCE,
    HEDGE,
    HOUSE,
    KINDS,
    LAMP,
    PILLAR,
    SHELTER,
    SIGNAL,
    TREE,
    Prop,
)
from bev_driving_env.towns.registry import compiled_town

X, Y, COS, SIN, HALF_LENGTH, HALF_WIDTH, LOW, HIGH, SLOT, PATTERN, TOP_SLOT, VARIANT = range(12)
COLUMNS = {"boxes": 12, "gables": 11, "sprites": 9, "cars": 7, "kerbs": 4, "signals": 4}
TABLES = {
    BUILDING: {"boxes"},
    HOUSE: {"boxes", "gables"},
    TREE: {"sprites"},
    LAMP: {"sprites", "boxes"},
    SIGNAL: {"signals"},
    FENCE: {"boxes"},
    HEDGE: {"boxes"},
    SHELTER: {"boxes"},
    CAR: {"cars"},
    PILLAR: {"boxes"},
}


@pytest.fixture(scope="module")
def bare():
    """A street without sidewalks."""
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [60.0, 0.0]))
    return compile_network("bare", network, allow_dead_ends=True)


def outline(town):
    """Middles of the sides that part road pixels from others."""
    raster = town.classes()
    road = (raster.pixels & ROAD_BIT) > 0
    rows, columns = np.nonzero(road[1:] != road[:-1])
    level = np.column_stack([columns + 0.5, rows + 1.0])
    rows, columns = np.nonzero(road[:, 1:] != road[:, :-1])
    upright = np.column_stack([columns + 1.0, rows + 0.5])
    origin = (raster.grid.x0_m, raster.grid.y0_m)
    return np.concatenate([level, upright]) / raster.grid.px_per_m + origin


def along(pieces, step_m=0.1):
    """Points on pieces (E, 4), no farther apart than a step."""
    count = math.ceil(np.hypot(*(pieces[:, 2:] - pieces[:, :2]).T).max() / step_m) + 1
    t = np.linspace(0.0, 1.0, count)[:, None, None]
    return (pieces[:, :2] + t * (pieces[:, 2:] - pieces[:, :2])).reshape(-1, 2)


def box_corners(row):
    pose = (row[X], row[Y], math.atan2(row[SIN], row[COS]))
    return footprint(pose, 2.0 * row[HALF_LENGTH], 2.0 * row[HALF_WIDTH])


def some(kind, variant=77, heading=0.4):
    """One prop of a kind in the middle of nowhere."""
    sizes = {BUILDING: (14, 9, 9.6), HOUSE: (10, 8, 4), TREE: (0.35, 0.35, 7), LAMP: (0.2, 0.2, 6)}
    length, width, height = sizes.get(kind, (4.0, 1.6, 2.4))
    return Prop(kind, 50.0, 40.0, heading, float(length), float(width), float(height), variant)


def test_tables_have_their_columns_even_when_they_are_empty(bare, town):
    for scenery in (build_scenery(bare, []), town.scenery(), town.scenery(dense=True)):
        for name, columns in COLUMNS.items():
            table = getattr(scenery, name)
            assert table.ndim == 2
            assert table.shape[1] == columns
            assert table.dtype == np.float64
            assert np.isfinite(table).all()
    assert all(len(table) == 0 for table in build_scenery(bare, []))


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
@pytest.mark.parametrize("variant", [0, 77, 999])
def test_every_kind_of_furniture_yields_its_shapes(bare, kind, variant):
    scenery = build_scenery(bare, [some(kind, variant)])
    assert {name for name in COLUMNS if len(getattr(scenery, name))} == TABLES[kind]


def test_every_prop_of_a_town_yields_shapes(town, bare):
    for prop in town.furniture(dense=True):
        scenery = build_scenery(bare, [prop])  # which has no kerbs
        assert sum(len(table) for table in scenery) > 0, prop


def test_shapes_are_near_their_prop_and_not_taller_than_a_roof_allows(bare):
    for kind in range(len(KINDS)):
        for heading in (0.0, 2.0, -1.0):
            prop = some(kind, heading=heading)
            scenery = build_scenery(bare, [prop])
            for name in TABLES[kind]:
                table = getattr(scenery, name)
                reach = math.hypot(prop.length_m, prop.width_m) / 2.0 + 2.5
                assert (np.hypot(table[:, 0] - prop.x, table[:, 1] - prop.y) < reach).all()
            assert (scenery.boxes[:, LOW] < scenery.boxes[:, HIGH]).all()
            assert (scenery.boxes[:, LOW] >= 0.0).all()
            assert (scenery.boxes[:, HIGH] <= prop.height_m + 0.5 + 1e-9).all()
            z, half_height = scenery.sprites[:, 2], scenery.sprites[:, 4]
            assert (z - half_height >= -1e-9).all()
            assert (z + half_height <= prop.height_m + 1e-9).all()


@pytest.mark.parametrize("kind", [BUILDING, HOUSE, FENCE, HEDGE, PILLAR])
def test_what_is_seen_at_the_ground_is_what_one_collides_with(bare, kind):
    for heading in (0.0, 0.4, -2.5):
        prop = some(kind, heading=heading)
        boxes = build_scenery(bare, [prop]).boxes
        (standing,) = boxes[boxes[:, LOW] == 0.0]
        expected = footprint((prop.x, prop.y, heading), prop.length_m, prop.width_m)
        np.testing.assert_allclose(box_corners(standing), expected, atol=1e-9)
        assert standing[HIGH] == pytest.approx(prop.height_m)


def test_a_shelter_stands_within_its_solid_box_but_for_the_edge_of_its_roof(bare):
    prop = some(SHELTER, heading=0.0)
    low = build_scenery(bare, [prop]).boxes
    low = low[low[:, LOW] < 2.0]
    for row in low:
        corners = box_corners(row) - (prop.x, prop.y)
        assert (np.abs(corners) <= (prop.length_m / 2.0 + 0.05, prop.width_m / 2.0 + 0.05)).all()


def test_a_parked_car_keeps_its_place_and_size(bare):
    prop = some(CAR)
    (car,) = build_scenery(bare, [prop]).cars
    np.testing.assert_allclose(car, prop[1:])


@pytest.mark.parametrize(("length_m", "width_m"), [(12.0, 7.0), (7.0, 12.0)])
def test_the_ridge_of_a_house_runs_along_its_longer_side_above_its_walls(bare, length_m, width_m):
    prop = some(HOUSE, heading=0.0)._replace(length_m=length_m, width_m=width_m)
    (gable,) = build_scenery(bare, [prop]).gables
    along_x = length_m > width_m
    np.testing.assert_allclose(np.abs(gable[2:4]), [1.0, 0.0] if along_x else [0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(gable[4:6], [6.0, 3.5])
    assert gable[6] == prop.height_m < gable[7] < prop.height_m + 4.0


def test_paints_and_patterns_exist_and_belong_to_what_they_are_for(town):
    scenery = town.scenery(dense=True)
    for table, slots, pattern in (
        (scenery.boxes, (SLOT, TOP_SLOT), PATTERN),
        (scenery.gables, (8, 9), None),
        (scenery.sprites, (6,), 7),
    ):
        for column in slots:
            assert (table[:, column] == np.round(table[:, column])).all()
            assert table[:, column].min() >= 0
            assert table[:, column].max() < paint.PAINTS
        if pattern is not None:
            assert set(table[:, pattern]) <= set(range(PATTERNS))
    walls, roofs = scenery.gables[:, 8], scenery.gables[:, 9]
    assert set(walls) == set(range(paint.WALL, paint.WALL + paint.WALLS))
    assert set(roofs) == set(range(paint.ROOF, paint.ROOF + paint.ROOFS))


def test_street_lamps_hang_over_the_road(town):
    raster, boxes = town.classes(), town.scenery().boxes
    lamps = boxes[boxes[:, PATTERN] == EMISSIVE]
    assert len(lamps) == sum(prop.kind == LAMP for prop in town.furniture()) > 0
    columns = ((lamps[:, X] - raster.grid.x0_m) * raster.grid.px_per_m).astype(int)
    rows = ((lamps[:, Y] - raster.grid.y0_m) * raster.grid.px_per_m).astype(int)
    assert ((raster.pixels[rows, columns] & ROAD_BIT) > 0).all()
    assert (lamps[:, LOW] > 4.5).all()


def test_signal_heads_come_in_the_order_of_the_towns_and_face_their_traffic(town):
    heads = town.scenery().signals
    lanes = {lane.index: lane for lane in town.lanes}
    assert len(heads) == len(town.signals) > 0
    for head, signal in zip(heads, town.signals, strict=True):
        lane = lanes[signal.lane]
        assert np.hypot(head[0] - signal.x, head[1] - signal.y) < 4.0
        np.testing.assert_allclose(head[2:], -lane.points[-1, 2:], atol=1e-9)
        # to the right of the lane it rules
        dx, dy = lane.points[-1, 2:]
        x, y = head[:2] - lane.points[-1, :2]
        assert -dy * x + dx * y > 2.0
    same = town.scenery(dense=True).signals
    np.testing.assert_array_equal(same, heads)


@pytest.mark.parametrize("name", ["Town01", "Town02", "ring", "ladder"])
def test_kerbs_run_along_the_whole_outline_of_the_road_within_15_cm(name, request):
    found = name.startswith("Town")
    town = compiled_town(name) if found else request.getfixturevalue(name)
    border, kerbs = outline(town), kerb_lines(town)
    points = along(kerbs)
    off, _ = cKDTree(border).query(points)
    assert off.max() < 0.15 + 0.05  # the middles are up to 10 cm apart
    missing, _ = cKDTree(points).query(border)
    assert missing.max() < 0.15 + 0.05


@pytest.mark.parametrize("name", ["Town01", "Town02", "ring", "ladder"])
def test_kerb_pieces_are_at_most_8_m_long_and_not_empty(name, request):
    found = name.startswith("Town")
    town = compiled_town(name) if found else request.getfixturevalue(name)
    kerbs = kerb_lines(town)
    lengths = np.hypot(*(kerbs[:, 2:] - kerbs[:, :2]).T)
    assert lengths.min() > 0.0
    assert lengths.max() <= 8.0 + 1e-9


def test_the_kerbs_of_a_ring_are_as_long_as_its_two_outlines(ring):
    kerbs = kerb_lines(ring)
    total = np.hypot(*(kerbs[:, 2:] - kerbs[:, :2]).T).sum()
    # straight parts of 180 and 40 m, corners of radius 10 around the centre line, 4.3 m each side
    expected = 2.0 * 2.0 * (180.0 + 40.0) + 2.0 * math.pi * (14.3 + 5.7)
    assert total == pytest.approx(expected, rel=0.01)


def test_a_town_without_sidewalks_has_no_kerbs(bare):
    assert kerb_lines(bare).shape == (0, 4)
