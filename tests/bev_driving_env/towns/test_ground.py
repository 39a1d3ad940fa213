import hashlib
import math

import cv2
import numpy as np
import pytest
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork
from scipy.ndimage import binary_closing

from bev_driving_env.kernels.layout import LANE_BIT, ROAD_BIT, SIDEWALK_BIT
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.ground import (
    ASPHALT,
    CODE_EIGHTHS,
    CODE_INDEX,
    CODE_MATERIALS,
    CRACK,
    GRASS,
    KERB,
    LEVELS,
    MATERIALS,
    PATCH,
    SIDEWALK,
    WHITE,
    YELLOW,
    build_ground,
    reduce_codes,
)
from bev_driving_env.towns.registry import compiled_town

PAVED = [ASPHALT, PATCH, CRACK]


def share_table():
    """Shares (codes, 8) of the materials in each code."""
    table = np.zeros((len(CODE_EIGHTHS), len(MATERIALS)))
    for code, ((first, second), eighths) in enumerate(
        zip(CODE_MATERIALS, CODE_EIGHTHS, strict=True)
    ):
        table[code, first] += 1.0 - eighths / 8.0
        table[code, second] += eighths / 8.0
    return table


SHARES = share_table()


def levels(ground):
    return [
        ground.texels[start : start + rows * columns].reshape(rows, columns)
        for start, (rows, columns) in zip(ground.offsets, ground.shapes, strict=True)
    ]


def reduced(codes):
    return reduce_codes(codes, CODE_MATERIALS, CODE_EIGHTHS, CODE_INDEX)


def shares_at(ground, x, y):
    """Shares (..., 8) of the materials of level 0 at world points."""
    grid = ground.grid
    rows = np.floor((np.asarray(y) - grid.y0_m) * grid.px_per_m).astype(int)
    columns = np.floor((np.asarray(x) - grid.x0_m) * grid.px_per_m).astype(int)
    return SHARES[levels(ground)[0][rows, columns]]


def runs_m(present, step_m):
    """Lengths of the runs of True and of those of False, without the first and the last run."""
    edges = np.flatnonzero(np.diff(present.astype(int)))
    lengths = np.diff(edges) * step_m
    kinds = present[edges[:-1] + 1]
    return lengths[kinds], lengths[~kinds]


def inner(mask, margin_px=4):
    """Pixels of a mask that lie some way inside of it."""
    side = 2 * margin_px + 1
    return cv2.erode((mask > 0).astype(np.uint8), np.ones((side, side), np.uint8)) > 0


def digests():
    grounds = [compiled_town(name).ground for name in ("Town01", "Town02")]
    return [hashlib.sha256(ground.texels.tobytes()).hexdigest() for ground in grounds]


def test_the_ground_is_the_same_in_every_process(printed_elsewhere):
    assert printed_elsewhere(__file__) == digests()


def test_painting_again_gives_the_same(ladder):
    np.testing.assert_array_equal(build_ground(ladder).texels, ladder.ground.texels)


def test_every_level_is_half_as_fine_and_the_finest_has_10_px_per_m(town):
    ground, classes = town.ground, town.classes()
    assert ground.grid == classes.grid
    assert ground.grid.px_per_m == 10.0
    assert ground.shapes.shape == (LEVELS, 2)
    np.testing.assert_array_equal(ground.shapes[0], classes.pixels.shape)
    for fine, coarse in zip(ground.shapes[:-1], ground.shapes[1:], strict=True):
        np.testing.assert_array_equal(coarse, -(-fine // 2))
    sizes = ground.shapes.prod(axis=1)
    assert ground.offsets.tolist() == [0, *np.cumsum(sizes)[:-1]]
    assert ground.texels.shape == (sizes.sum(),)
    assert ground.texels.dtype == np.uint8


def test_codes_are_pure_materials_or_every_mixture_of_two_in_eighths():
    assert CODE_MATERIALS.shape == (len(CODE_EIGHTHS), 2)
    assert len(CODE_EIGHTHS) == 8 + 28 * 7 <= 256
    np.testing.assert_array_equal(SHARES[:8], np.eye(8))
    assert (np.count_nonzero(SHARES[8:], axis=1) == 2).all()
    np.testing.assert_allclose(SHARES.sum(axis=1), 1.0)
    assert len({tuple(row) for row in SHARES}) == len(SHARES)


def test_the_index_finds_the_code_of_each_mixture_whichever_material_comes_first():
    for first in range(8):
        for second in range(8):
            for eighths in range(9):
                expected = np.zeros(8)
                expected[first] += 1.0 - eighths / 8.0
                expected[second] += eighths / 8.0
                if first != second or eighths in (0, 8):
                    code = CODE_INDEX[first, second, eighths]
                    np.testing.assert_allclose(SHARES[code], expected)


def test_the_texels_of_a_town_are_known_codes(town):
    assert town.ground.texels.max() < len(CODE_EIGHTHS)


@pytest.mark.parametrize("shape", [(16, 24), (7, 9), (1, 1), (1, 8)])
def test_reducing_keeps_the_two_commonest_of_four_texels_in_their_proportion(shape):
    codes = np.random.default_rng(1).integers(0, len(CODE_EIGHTHS), shape).astype(np.uint8)
    result = reduced(codes)
    assert result.shape == (-(-shape[0] // 2), -(-shape[1] // 2))
    padded = np.pad(codes, ((0, shape[0] % 2), (0, shape[1] % 2)), "edge")
    for (row, column), code in np.ndenumerate(result):
        block = padded[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].ravel()
        histogram = SHARES[block].mean(axis=0)
        kept = SHARES[code]
        named = np.flatnonzero(kept)
        # no material left out is commoner than one that is kept, but for shares rounded away
        others = np.delete(histogram, named)
        assert len(named) == 1 or others.max() <= histogram[named].min() + 1e-9
        two = np.sort(histogram)[-2:]
        assert kept.max() == pytest.approx(max(two) / two.sum(), abs=1.0 / 16.0 + 1e-9)
        assert histogram[kept.argmax()] == pytest.approx(two.max(), abs=1.0 / 16.0 + 1e-9)


def test_reducing_what_mixes_two_materials_keeps_their_shares_within_a_sixteenth():
    rng = np.random.default_rng(2)
    two = [code for code in range(len(SHARES)) if set(np.flatnonzero(SHARES[code])) <= {1, 6}]
    codes = rng.choice(two, (40, 60)).astype(np.uint8)
    before = SHARES[codes].reshape(20, 2, 30, 2, 8).mean(axis=(1, 3))
    after = SHARES[reduced(codes)]
    assert np.abs(after - before).max() <= 1.0 / 16.0 + 1e-9
    assert np.abs((after - before).mean(axis=(0, 1))).max() < 0.04


@pytest.mark.parametrize("code", [0, 7, 8, 100, 203])
def test_an_even_surface_stays_what_it_is(code):
    codes = np.full((5, 6), code, np.uint8)
    assert (reduced(codes) == code).all()


def test_a_thin_line_fades_with_distance_instead_of_flickering():
    codes = np.full((64, 64), ASPHALT, np.uint8)
    codes[:, 21] = WHITE
    first = reduced(codes)
    np.testing.assert_allclose(SHARES[first][:, 10, WHITE], 0.5)
    np.testing.assert_allclose(SHARES[reduced(first)][:, 5, WHITE], 0.25)


def test_the_mean_colour_of_a_town_stays_from_level_to_level(town):
    colours = np.array(
        [(84, 118, 52), (98, 100, 104), (80, 82, 86), (54, 55, 57),
         (172, 170, 164), (193, 190, 184), (232, 232, 228), (222, 178, 48)]
    )  # fmt: skip
    # the border repeats itself at the odd last row and column, so look at whole blocks only
    pages = levels(town.ground)
    rows, columns = (pages[-1].shape[0] - 1, pages[-1].shape[1] - 1)
    seen = []
    for k, page in enumerate(pages):
        scale = 2 ** (LEVELS - 1 - k)
        counts = np.bincount(page[: rows * scale, : columns * scale].ravel(), minlength=len(SHARES))
        seen.append(counts @ SHARES @ colours / counts.sum())
    np.testing.assert_allclose(np.diff(seen, axis=0), 0.0, atol=0.5)
    np.testing.assert_allclose(seen[-1], seen[0], atol=1.0)


def test_roads_are_asphalt_and_sidewalks_and_grass_are_pure(town):
    classes, codes = town.classes().pixels, levels(town.ground)[0]
    road = inner(classes & ROAD_BIT)
    painted = cv2.dilate(classes & LANE_BIT, np.ones((9, 9), np.uint8)) > 0
    counts = np.bincount(codes[road], minlength=len(SHARES))
    assert not counts[SHARES[:, [GRASS, SIDEWALK, KERB]].any(axis=1)].any()
    assert (counts @ SHARES)[ASPHALT] > 0.8 * counts.sum()
    # away from the lines there are only the stop lines' paint and asphalt
    counts = np.bincount(codes[road & ~painted], minlength=len(SHARES))
    assert not counts[SHARES[:, YELLOW] > 0.0].any()
    assert (counts @ SHARES)[PAVED].sum() > 0.995 * counts.sum()
    assert (codes[inner(classes & SIDEWALK_BIT)] == SIDEWALK).all()
    streets = (classes & (ROAD_BIT | SIDEWALK_BIT)) > 0
    assert (codes[inner(~streets)] == GRASS).all()


def test_the_road_has_some_patches_and_cracks(town):
    counts = np.bincount(levels(town.ground)[0].ravel(), minlength=len(SHARES)) @ SHARES
    road = (town.classes().pixels & ROAD_BIT > 0).sum()
    assert 0.03 < counts[PATCH] / road < 0.2
    assert 0.001 < counts[CRACK] / road < 0.05


def test_a_kerb_runs_between_road_and_sidewalk(ring):
    x = np.arange(30.0, 170.0, 0.1)
    # traffic heading east keeps to y = 2; 2 m of lane and 0.3 m of shoulder, then 15 cm of kerb
    assert (shares_at(ring.ground, x, 4.35)[:, KERB] > 0.9).all()
    assert (shares_at(ring.ground, x, -4.35)[:, KERB] > 0.9).all()
    assert (shares_at(ring.ground, x, 4.25)[:, PAVED].sum(axis=1) > 0.9).all()
    assert (shares_at(ring.ground, x, 4.55)[:, SIDEWALK] == 1.0).all()
    assert (shares_at(ring.ground, x, 8.2)[:, SIDEWALK] == 1.0).all()
    assert (shares_at(ring.ground, x, 8.4)[:, GRASS] == 1.0).all()


def test_yellow_dashes_of_3_m_with_gaps_of_4_5_m_run_along_the_centre_line(ring):
    x = np.arange(12.0, 188.0, 0.1)
    yellow = shares_at(ring.ground, x, [[-0.05], [0.05]])[..., YELLOW].sum(axis=0)
    # worn spots of a few decimetres do not make a gap
    dashes, gaps = runs_m(binary_closing(yellow > 0.2, np.ones(15)), 0.1)
    assert len(dashes) > 15
    assert np.median(dashes) == pytest.approx(3.0, abs=0.25)
    assert np.median(gaps) == pytest.approx(4.5, abs=0.25)
    assert dashes.max() < 3.3
    assert gaps.min() > 4.2
    # at no other place between the kerbs
    for y in (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0):
        assert not shares_at(ring.ground, x, y)[:, YELLOW].any()


def test_white_lines_run_along_both_edges_without_gaps(ring):
    x = np.arange(12.0, 188.0, 0.1)
    for y in (-4.0, 4.0):
        white = shares_at(ring.ground, x, [[y - 0.05], [y + 0.05]])[..., WHITE].sum(axis=0)
        assert (white > 0.2).mean() > 0.75
        _, gaps = runs_m(white > 0.2, 0.1)
        assert gaps.max() < 2.0  # worn
    assert not shares_at(ring.ground, x, 2.0)[:, WHITE].any()


def test_both_lanes_of_a_street_agree_on_the_dashes(town):
    grounds = []
    for lane in town.lanes:
        if lane.in_junction or lane.length_m < 40.0 or len(lane.points) > 2:
            continue
        x, y, dx, dy = lane.points[0]
        s = np.arange(5.0, lane.length_m - 5.0, 0.1)
        # the left boundary, seen from here: y points south
        half = lane.half_width[0]
        yellow = shares_at(town.ground, x + dx * s + dy * half, y + dy * s - dx * half)[:, YELLOW]
        grounds.append((yellow > 0.1).mean())
    assert len(grounds) > 10
    # two lanes out of step would fill the gaps; worn paint takes up to a half
    assert np.mean(grounds) == pytest.approx(0.4, abs=0.08)
    assert max(grounds) < 0.55


def test_white_stop_lines_lie_where_the_signals_rule(town):
    assert len(town.stop_lines) == len(town.signals) > 0
    for x1, y1, x2, y2 in town.stop_lines:
        t = np.linspace(0.05, 0.95, 40)
        white = shares_at(town.ground, x1 + t * (x2 - x1), y1 + t * (y2 - y1))[:, WHITE]
        assert white.mean() > 0.4
        # half a metre to either side of the 40 cm there is none
        ahead = np.array([y2 - y1, x1 - x2]) / math.hypot(x2 - x1, y2 - y1)
        for offset in (-0.5, 0.5):
            x, y = x1 + t * (x2 - x1) + offset * ahead[0], y1 + t * (y2 - y1) + offset * ahead[1]
            middle = slice(6, -6)
            assert not shares_at(town.ground, x[middle], y[middle])[:, WHITE].any()


def test_junctions_are_not_marked(ladder):
    # from the pavement of the rung into the junction at (50, 0)
    x, y = np.meshgrid(np.arange(47.0, 53.0, 0.1), np.arange(-1.5, 1.5, 0.1))
    assert not shares_at(ladder.ground, x, y)[..., [WHITE, YELLOW]].any()


def test_a_plain_network_has_neither_kerb_nor_sidewalk():
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0.0, 0.0], [60.0, 0.0]))
    ground = compile_network("street", network, allow_dead_ends=True).ground
    x = np.arange(2.0, 58.0, 0.1)
    assert (shares_at(ground, x, 0.5)[:, PAVED].sum(axis=1) == 1.0).all()
    assert (shares_at(ground, x, 2.6)[:, GRASS] == 1.0).all()
    counts = np.bincount(ground.texels, minlength=len(SHARES)) @ SHARES
    assert counts[KERB] == counts[SIDEWALK] == 0.0


if __name__ == "__main__":
    print(*digests())
