import math

import numpy as np
import pytest

from bev_driving_env.towns.solids import index_solids


def listed(solids, cell):
    begin, end = solids.cell_start[cell : cell + 2]
    return solids.cell_items[begin:end].tolist()


@pytest.mark.parametrize("cell_m", [0.9, 8.0, 500.0])
def test_every_cell_lists_the_boxes_whose_surrounding_square_it_touches(cell_m):
    rng = np.random.default_rng(2)
    boxes = np.column_stack(
        [rng.uniform(-30.0, 50.0, (25, 2)), rng.uniform(-4, 4, 25), rng.uniform(0.15, 9, (25, 2))]
    )
    solids = index_solids(boxes, cell_m)
    grid = solids.grid
    assert solids.cell_start.shape == (grid.columns * grid.rows + 1,)
    assert solids.cell_start[-1] == len(solids.cell_items)
    for cell in range(grid.columns * grid.rows):
        row, column = divmod(cell, grid.columns)
        left, top = grid.x0_m + column * cell_m, grid.y0_m + row * cell_m
        expected = []
        for item, (x, y, _, length, width) in enumerate(boxes):
            reach = math.hypot(length, width) / 2.0
            beside = x + reach < left or x - reach >= left + cell_m
            if not (beside or y + reach < top or y - reach >= top + cell_m):
                expected.append(item)
        assert listed(solids, cell) == expected


def test_the_grid_just_covers_the_boxes():
    solids = index_solids([[10.0, 20.0, 1.0, 6.0, 8.0], [30.0, 24.0, 0.0, 0.6, 0.8]], 4.0)
    grid = solids.grid
    assert (grid.x0_m, grid.y0_m, grid.cell_m) == (5.0, 15.0, 4.0)
    # from 5 to 30.5 and from 15 to 25
    assert (grid.columns, grid.rows) == (7, 3)


def test_a_pole_is_in_one_cell_and_a_long_wall_in_many():
    pole, wall = [2.0, 2.0, 0.0, 0.15, 0.15], [32.0, 32.0, 0.7, 60.0, 0.3]
    solids = index_solids([pole, wall])
    assert np.count_nonzero(solids.cell_items == 0) == 1
    assert np.count_nonzero(solids.cell_items == 1) >= 49


def test_no_boxes_make_a_grid_of_one_empty_cell():
    solids = index_solids(np.zeros((0, 5)))
    assert (solids.grid.columns, solids.grid.rows) == (1, 1)
    assert solids.boxes.shape == (0, 5)
    assert solids.cell_start.tolist() == [0, 0]
    assert listed(solids, 0) == []


def test_the_arrays_have_the_types_the_kernel_is_compiled_for():
    for boxes in ([[1, 2, 0, 3, 4]], np.zeros((0, 5), np.float32)):
        solids = index_solids(boxes)
        assert [solids.boxes.dtype, solids.cell_start.dtype, solids.cell_items.dtype] == [
            np.float64,
            np.int64,
            np.int64,
        ]


def test_the_boxes_are_a_copy():
    boxes = np.ones((1, 5))
    solids = index_solids(boxes)
    boxes[:] = 7.0
    assert (solids.boxes == 1.0).all()


@pytest.mark.parametrize(
    "boxes", [[], [[1.0, 2.0, 0.0, 3.0]], [[1.0, math.nan, 0.0, 3.0, 1.0]], np.zeros(5)]
)
def test_what_is_not_a_table_of_boxes_is_refused_with_its_shape(boxes):
    with pytest.raises(ValueError, match=r"shape \(F, 5\), got shape"):
        index_solids(boxes)


@pytest.mark.parametrize("cell_m", [0.0, -1.0, math.nan])
def test_cells_must_have_a_size(cell_m):
    with pytest.raises(ValueError, match=r"larger than 0 m, got"):
        index_solids(np.zeros((0, 5)), cell_m)
