import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from bev_driving_env.cameras.textures import (
    NEUTRAL,
    WINDOW,
    code_table,
    grain_tile,
    pack,
    smooth_tile,
    texture_pages,
)
from bev_driving_env.kernels.shapes import (
    BRICKS,
    EMISSIVE,
    FACADE,
    FOLIAGE,
    GLASS,
    PATTERNS,
    PLAIN,
    POSTER,
    SLATS,
    TILES,
)

SIDE = 128


def pages():
    return texture_pages().reshape(PATTERNS, SIDE, SIDE)


def unpack(packed):
    """Bytes of 32-bit numbers, lowest first, by arithmetic."""
    numbers = packed.astype(np.int64) % 2**32
    return np.stack([numbers // 256**k % 256 for k in range(4)], axis=-1)


def table(lit_share=0.0):
    return unpack(
        code_table(np.array([40.0, 50.0, 60.0]), np.array([255.0, 214.0, 140.0]), lit_share)
    )


def digests():
    arrays = (texture_pages(), grain_tile(), smooth_tile())
    return [hashlib.sha256(array.tobytes()).hexdigest() for array in arrays]


def test_pages_and_tiles_are_the_same_in_every_process():
    done = subprocess.run(
        [sys.executable, __file__],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONHASHSEED": "5"},
        timeout=120,
        check=True,
    )
    assert done.stdout.split() == digests()


def test_there_is_a_page_of_bytes_for_every_pattern_that_nobody_can_spoil():
    assert texture_pages().shape == (PATTERNS * SIDE * SIDE,)
    assert texture_pages().dtype == np.uint8
    with pytest.raises(ValueError, match="read-only"):
        texture_pages()[0] = 1


def test_only_facades_and_glass_have_windows():
    windows = {k for k in range(PATTERNS) if (pages()[k] >= WINDOW).any()}
    assert windows == {GLASS, *range(FACADE, PATTERNS)}
    assert (pages()[GLASS] >= WINDOW).all()


def test_plain_and_shining_faces_keep_their_colour():
    assert (pages()[[PLAIN, EMISSIVE]] == NEUTRAL).all()


@pytest.mark.parametrize("pattern", [BRICKS, SLATS, FOLIAGE, TILES, POSTER])
def test_patterns_vary_around_the_plain_colour(pattern):
    page = pages()[pattern].astype(float)
    assert page.std() > 4.0
    assert page.mean() == pytest.approx(NEUTRAL, rel=0.16)


@pytest.mark.parametrize("style", range(PATTERNS - FACADE))
def test_a_facade_has_sixteen_windows_and_a_door_at_its_foot(style):
    page = pages()[FACADE + style]
    glazed = page >= WINDOW
    floors = [glazed[32 * k : 32 * k + 32] for k in range(4)]
    for k, floor in enumerate(floors):
        columns = floor.any(axis=0).astype(int)
        panes = int((np.diff(np.concatenate([[0], columns])) == 1).sum())
        assert panes in ((3, 4) if k == 0 else (4,))  # the door takes the place of one
        assert 0.1 < floor.mean() < 0.5
    assert (page[:22] < 0.5 * NEUTRAL).sum() > 150
    assert not (page[32:] < 0.5 * NEUTRAL).any()


def test_facades_differ():
    facades = {page.tobytes() for page in pages()[FACADE:]}
    assert len(facades) == PATTERNS - FACADE


@pytest.mark.parametrize(("tile", "most"), [(grain_tile, 1.5), (smooth_tile, 1.0)])
def test_tiles_are_noise_to_both_sides_within_their_limits(tile, most):
    noise = tile()
    assert noise.shape == (SIDE * SIDE,)
    assert noise.dtype == np.float32
    assert np.abs(noise).max() <= most
    assert np.quantile(noise, 0.1) < -0.3
    assert np.quantile(noise, 0.9) > 0.3
    assert 0.3 < noise.std() < 0.7


def test_the_smooth_tile_repeats_without_a_seam():
    tile = smooth_tile().reshape(SIDE, SIDE)
    for rows in (tile, tile.T):
        steps = np.abs(np.diff(rows, axis=0)).mean(axis=1)
        seam = np.abs(rows[0] - rows[-1]).mean()
        assert seam < 1.5 * steps.max()
        assert steps.max() < 0.5 * tile.std()


def test_packed_rows_come_apart_again():
    rows = np.random.default_rng(0).integers(0, 256, (300, 4))
    packed = pack(rows.astype(float))
    assert packed.dtype == np.int32
    assert packed.shape == (300,)
    np.testing.assert_array_equal(unpack(packed), rows)


def test_packing_puts_the_first_number_lowest_and_rounds_and_clips():
    assert pack(np.array([[1.0, 2.0, 3.0, 4.0]])).tolist() == [0x04030201]
    assert pack(np.array([[255.0, 255.0, 255.0, 255.0]])).tolist() == [-1]
    assert unpack(pack(np.array([[-3.0, 1.6, 300.0, 254.4]]))).tolist() == [[0, 2, 255, 254]]


def test_codes_below_the_windows_multiply_and_add_nothing():
    codes = table()
    assert codes.shape == (256, 4)
    assert codes[:WINDOW, 3].tolist() == list(range(WINDOW))
    assert not codes[:WINDOW, :3].any()


def test_dark_windows_mirror_the_sky_in_slightly_different_tones():
    panes = table()[WINDOW:]
    np.testing.assert_allclose(panes[:, :3].mean(axis=0), [40.0, 50.0, 60.0], rtol=0.05)
    assert len(np.unique(panes[:, 0])) > 5
    assert (panes[:, 3] < 0.5 * NEUTRAL).all()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.35, 1.0])
def test_as_many_windows_are_lit_as_asked(share):
    panes = table(share)[WINDOW:]
    lit = (panes == [255, 214, 140, 0]).all(axis=1)
    assert lit.mean() == pytest.approx(share, abs=1.0 / 64.0)


def test_windows_that_are_lit_stay_lit_when_more_are():
    few, more = ((table(share)[WINDOW:, 3] == 0) for share in (0.2, 0.6))
    assert (more | ~few).all()


if __name__ == "__main__":
    print(*digests())
