"""Looks for training that vary far more than those of ``"train"``."""

import numpy as np

from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.randomisation import FULL_DAY, PAINTED, randomised_look
from bev_driving_env.kernels import paints as paint
from bev_driving_env.towns.ground import ASPHALT, GRASS, WHITE, YELLOW

SEEDS = range(200)


def test_a_seed_always_gives_the_same_look():
    one, other = randomised_look(3), randomised_look(3)
    np.testing.assert_array_equal(one.ground, other.ground)
    np.testing.assert_array_equal(one.paints, other.paints)
    assert one.condition == other.condition
    assert (randomised_look(4).ground != one.ground).any()


def test_colours_spread_far_beyond_those_of_train():
    for material in (ASPHALT, GRASS):
        wild = np.std([randomised_look(seed).ground[material] for seed in SEEDS], axis=0)
        plain = np.std([draw_look("train", seed).ground[material] for seed in SEEDS], axis=0)
        assert (wild > 1.5 * plain).all()


def test_marks_stand_out_from_the_road_and_the_ground_is_lit():
    for seed in SEEDS:
        look = randomised_look(seed)
        darkest = look.ground[[WHITE, YELLOW]].mean(axis=1).min()
        assert darkest >= 1.249 * look.ground[ASPHALT].mean()
        assert look.sun + look.ambient >= FULL_DAY - 1e-9
        assert (look.ground >= 0.0).all()
        assert (look.ground <= 255.0).all()


def test_signals_and_mounting_stay_as_they_are():
    look, plain = randomised_look(5), draw_look("train", 5)
    lamps = [paint.LENS_RED, paint.LENS_YELLOW, paint.LENS_GREEN, paint.HEADLIGHT, paint.TAILLIGHT]
    np.testing.assert_array_equal(look.paints[lamps], plain.paints[lamps])
    assert not set(lamps) & set(PAINTED)
    np.testing.assert_array_equal(look.mount_deg, plain.mount_deg)
    np.testing.assert_array_equal(look.mount_m, plain.mount_m)
