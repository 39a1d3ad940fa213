"""Small integers for the numbers of a drive, and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bev_driving_env.logs.packing import (
    differences,
    on_grid,
    pack_signals,
    summed,
    unpack_signals,
)

POSITIONS = st.lists(st.integers(-(2**28), 2**28), max_size=40)


@given(POSITIONS, st.sampled_from([1, 2]))
def test_a_column_survives_being_differenced(values, order):
    column = np.array(values, np.int32)
    folded = differences(column, order)
    assert folded.dtype == np.int32
    assert (folded >= 0).all()
    np.testing.assert_array_equal(summed(folded, order), column)


def test_steady_motion_becomes_zeros():
    steady = (1000 + 61 * np.arange(50)).astype(np.int32)
    assert not differences(steady, 2)[2:].any()


def test_changes_of_either_sign_become_small():
    assert differences(np.array([0, -1, 0, 1], np.int32), 1).tolist() == [0, 1, 2, 2]


def test_a_change_that_does_not_fit_is_an_error():
    with pytest.raises(ValueError, match="31 bits"):
        differences(np.array([2**30, -(2**30)], np.int32), 2)


@pytest.mark.parametrize("count", [0, 1, 31, 32, 70])
def test_signals_survive_being_packed(count):
    signals = np.random.default_rng(0).integers(0, 4, (6, count)).astype(np.uint8)
    words = pack_signals(signals)
    assert len(words) == -(-count // 31)
    assert (words >= 0).all()
    np.testing.assert_array_equal(unpack_signals(words, count), signals)


def test_rows_on_the_grid_are_kept_exactly():
    rows = np.array([[1.0 + 1 / 1024, -2.5, 3 / 4096, 0.0]])
    assert on_grid(rows).tolist() == [[1025, -2560, 3, 0]]


def test_a_row_between_the_steps_of_the_grid_is_refused_by_number():
    rows = np.zeros((3, 4))
    rows[2, 1] = 0.1
    with pytest.raises(ValueError, match="actor 2 is not on the grid"):
        on_grid(rows)
