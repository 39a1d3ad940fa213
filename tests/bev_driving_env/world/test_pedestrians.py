import numpy as np
import pytest

from bev_driving_env.kernels.layout import LENGTH, SPEED, WIDTH, X, Y
from bev_driving_env.kernels.walks import (
    DIRECTION,
    FREE_FROM_M,
    FREE_TO_M,
    KERB_M,
    MODE,
    PACE_MPS,
    WALK,
    WALK_STATION,
    WALKING,
    walk_point,
    walk_row,
)
from bev_driving_env.towns.sidewalks import build_sidewalks
from bev_driving_env.world.pedestrians import capacity, place_pedestrians


@pytest.fixture(scope="module")
def sidewalks(ladder):
    return build_sidewalks(ladder)


def gaps(rows):
    """Distances between centres, less the radii at which footprints are kept apart."""
    distance = np.hypot(*(rows[:, None, [X, Y]] - rows[None, :, [X, Y]]).T)
    gap = distance - 0.75 * (rows[:, None, LENGTH] + rows[None, :, LENGTH])
    return gap[np.triu_indices(len(rows), 1)]


def test_there_is_room_for_one_on_every_three_metres(sidewalks):
    length_m = sidewalks.walks.length.sum()
    assert length_m / 3.0 - 3 <= capacity(sidewalks) <= length_m / 3.0


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_nobody_touches_another_even_when_the_town_is_full(sidewalks, share):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        rows, _, _ = place_pedestrians(sidewalks, int(share * capacity(sidewalks)), rng)
        assert gaps(rows).min() >= 0.0


def test_everybody_stands_where_his_track_says_and_in_the_free_band(sidewalks):
    walks = sidewalks.walks
    rows, track, motion = place_pedestrians(sidewalks, 100, np.random.default_rng(3))
    assert (track[:, MODE] == WALKING).all()
    assert set(track[:, DIRECTION]) == {-1, 1}
    assert (rows[:, SPEED] == 0.0).all()
    for row, (walk, *_), place in zip(rows, track, motion, strict=True):
        station, kerb_m = place[[WALK_STATION, KERB_M]]
        assert 0.0 <= station < walks.length[walk]
        np.testing.assert_allclose(row[[X, Y]], walk_point(walks, walk, station, kerb_m), atol=5e-4)
        sample = walk_row(walks, walk, station)[0]
        low, high = walks.samples[sample, [FREE_FROM_M, FREE_TO_M]]
        assert low - 1e-9 <= kerb_m <= high + 1e-9


def test_a_fifth_are_children_who_are_small_and_everybody_is_square(town):
    rows, _, motion = place_pedestrians(build_sidewalks(town), 600, np.random.default_rng(5))
    assert (rows[:, LENGTH] == rows[:, WIDTH]).all()
    child = rows[:, LENGTH] == 0.35
    assert 0.13 < child.mean() < 0.27
    assert rows[~child, LENGTH].min() >= 0.45
    assert rows[~child, LENGTH].max() <= 0.6
    pace = motion[:, PACE_MPS]
    assert pace[child].min() >= 0.9
    assert pace[child].max() <= 1.8
    assert pace[~child].min() >= 0.7
    assert pace[~child].max() <= 1.6
    assert 0.05 < np.mean(pace[~child] < 1.0) < 0.25


def test_walks_get_pedestrians_by_their_length(town):
    sidewalks = build_sidewalks(town)
    counts = np.zeros(len(sidewalks.walks.length))
    for seed in range(20):
        _, track, _ = place_pedestrians(sidewalks, 250, np.random.default_rng(seed))
        counts += np.bincount(track[:, WALK], minlength=len(counts))
    share = sidewalks.walks.length / sidewalks.walks.length.sum()
    np.testing.assert_allclose(counts / counts.sum(), share, atol=0.03)


def test_the_generator_alone_decides(sidewalks):
    first, again, other = (
        place_pedestrians(sidewalks, 50, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    for a, b, c in zip(first, again, other, strict=True):
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()


def test_nobody_may_be_asked_for(sidewalks):
    rows, track, motion = place_pedestrians(sidewalks, 0, np.random.default_rng(0))
    assert (len(rows), len(track), len(motion)) == (0, 0, 0)


def test_too_many_are_refused_with_both_numbers(sidewalks):
    most = capacity(sidewalks)
    with pytest.raises(ValueError, match=rf"{most + 1} pedestrians .* 0 to {most};"):
        place_pedestrians(sidewalks, most + 1, np.random.default_rng(0))


def test_a_share_of_children_beyond_all_is_refused(sidewalks):
    with pytest.raises(ValueError, match=r"child_share must be from 0 to 1, got 1\.5"):
        place_pedestrians(sidewalks, 1, np.random.default_rng(0), child_share=1.5)
