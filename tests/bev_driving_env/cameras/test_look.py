import dataclasses
import hashlib

import numpy as np
import pytest

from bev_driving_env.cameras.conditions import (
    CLEAR,
    DENSE_FOG,
    HARD_CONDITIONS,
    LOW_SUN,
    NIGHT,
    TEST_CONDITIONS,
    TRAIN_CONDITIONS,
    WET,
)
from bev_driving_env.cameras.look import APPEARANCES, draw_look, single_appearances
from bev_driving_env.cameras.palettes import (
    CAR_PAINTS,
    JITTER,
    TEST_CAR_PAINTS,
    TEST_PALETTES,
    TRAIN_PALETTES,
)
from bev_driving_env.kernels import paints as paint
from bev_driving_env.settings import EnvSettings
from bev_driving_env.towns.ground import MATERIALS
from bev_driving_env.towns.registry import compiled_town

SEEDS = range(120)
WEATHER = ("sun", "ambient", "sight_m", "clouds", "wetness", "noise", "blur_px")


@pytest.fixture(scope="module")
def looks():
    """Looks of each set, one for each seed."""
    return {name: [draw_look(name, seed) for seed in SEEDS] for name in APPEARANCES}


def digest(look):
    """Hash of every number of a look."""
    seen = hashlib.sha256()
    for field in dataclasses.fields(look):
        value = getattr(look, field.name)
        seen.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return seen.hexdigest()


def digests():
    return [digest(draw_look(name, seed, 6)) for name in APPEARANCES for seed in (0, 7, 2**40)]


def test_a_set_and_a_seed_give_the_same_look_in_every_process(printed_elsewhere):
    assert printed_elsewhere(__file__) == digests()


def test_other_seeds_and_other_sets_give_other_looks(looks):
    seen = [digest(look) for drawn in looks.values() for look in drawn]
    assert len(set(seen)) == len(seen)
    # the weather of two sets does not follow one another
    pairs = zip(looks["test"], looks["hard"], strict=True)
    assert all(a.sun_azimuth_rad != b.sun_azimuth_rad for a, b in pairs)


def test_a_look_remembers_where_it_came_from_and_says_what_it_is():
    look = draw_look("test", 11)
    assert (look.appearance, look.seed) == ("test", 11)
    assert look.name == f"{look.condition.name} {look.palette.name}"


@pytest.mark.parametrize(
    ("name", "conditions", "palettes"),
    [
        ("train", TRAIN_CONDITIONS, TRAIN_PALETTES),
        ("test", TEST_CONDITIONS, TEST_PALETTES),
        ("hard", HARD_CONDITIONS, TEST_PALETTES),
    ],
)
def test_every_pair_of_a_condition_and_a_palette_of_a_set_is_drawn_and_no_other(
    looks, name, conditions, palettes
):
    expected = {f"{condition.name} {palette.name}" for condition in conditions
                for palette in palettes}  # fmt: skip
    names = [look.name for look in looks[name]]
    assert set(names) == expected
    # none is rare: a tenth of its fair share would be a bug
    assert min(names.count(each) for each in expected) > 0.1 * len(names) / len(expected)


def test_hard_adds_night_dense_fog_low_sun_and_dirt_to_test(looks):
    drawn = {name: {look.condition.name for look in looks[name]} for name in APPEARANCES}
    assert drawn["hard"] - drawn["test"] == {"night", "dense fog", "low sun"}
    assert drawn["test"] < drawn["hard"]
    assert all(look.dirty for look in looks["hard"])
    assert not any(look.dirty for look in looks["train"] + looks["test"])


def test_night_is_dark_dense_fog_hides_what_is_30_m_away_and_a_low_sun_stands_below_ten_degrees(
    looks,
):
    by_name = {}
    for look in looks["hard"]:
        by_name.setdefault(look.condition.name, []).append(look)
    assert all(look.ambient + look.sun < 0.2 for look in by_name["night"])
    assert all(look.condition.headlights > 0.0 for look in by_name["night"])
    assert all(look.sight_m <= 30.0 for look in by_name["dense fog"])
    assert all(look.sun_direction[2] < np.sin(np.radians(10.01)) for look in by_name["low sun"])
    assert all(look.sun > 0.5 for look in by_name["low sun"])


@pytest.mark.parametrize("name", ["test", "hard"])
def test_no_held_out_weather_occurs_in_training(looks, name):
    fields = ("sun_elevation_rad", "ambient", "sight_m")
    assert not {c.name for c in HARD_CONDITIONS} & {c.name for c in TRAIN_CONDITIONS}
    train = np.array([[getattr(look, f) for f in fields] for look in looks["train"]])
    for look in looks[name]:
        values = np.array([getattr(look, f) for f in fields])
        assert ((values < train.min(axis=0)) | (values > train.max(axis=0))).any(), look.name


def test_held_out_palettes_share_no_colour_with_those_of_training():
    for kind in ("walls", "roofs", "leaves"):
        train = {colour for palette in TRAIN_PALETTES for colour in getattr(palette, kind)}
        test = {colour for palette in TEST_PALETTES for colour in getattr(palette, kind)}
        assert not train & test
    assert not set(CAR_PAINTS) & set(TEST_CAR_PAINTS)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("test", TEST_PALETTES, ids=lambda palette: palette.name)
def test_a_held_out_ground_colour_cannot_be_drawn_in_training(test, material):
    held_out = np.array(test.ground[material])
    for train in TRAIN_PALETTES:
        apart = np.abs(held_out - train.ground[material]).max()
        assert apart > 2.0 * JITTER, (
            f"{material} of {test.name} {test.ground[material]} is within twice the jitter of "
            f"{train.name}'s {train.ground[material]}"
        )


def test_ground_colours_stay_within_the_jitter_of_their_palette_and_use_all_of_it(looks):
    for drawn in looks.values():
        off = np.array([look.ground - look.palette.ground_array() for look in drawn])
        assert off.shape == (len(drawn), len(MATERIALS), 3)
        assert np.abs(off).max() <= JITTER
        # each channel by itself, to both sides
        assert (off.min(axis=0) < -0.8 * JITTER).all()
        assert (off.max(axis=0) > 0.8 * JITTER).all()


def test_paints_are_colours_and_cars_wear_those_of_their_set(looks):
    for name, cars in (("train", CAR_PAINTS), ("test", TEST_CAR_PAINTS), ("hard", TEST_CAR_PAINTS)):
        paints = np.array([look.paints for look in looks[name]])
        assert paints.shape == (len(SEEDS), paint.PAINTS, 3)
        assert paints.min() >= 0.0
        assert paints.max() <= 255.0
        mean = paints[:, paint.CAR : paint.CAR + paint.CARS].mean(axis=0)
        np.testing.assert_allclose(mean, cars, rtol=0.05)


def test_the_palette_decides_walls_roofs_and_leaves():
    for palette in TRAIN_PALETTES + TEST_PALETTES:
        paints = draw_look("train", 3, palette=palette).paints
        for slot, colours in (
            (paint.WALL, palette.walls),
            (paint.ROOF, palette.roofs),
            (paint.LEAF, palette.leaves),
        ):
            drawn = paints[slot : slot + len(colours)]
            np.testing.assert_allclose(drawn, colours, rtol=0.081)


def test_mounting_errors_are_small_but_there(looks):
    every = [look for drawn in looks.values() for look in drawn]
    degrees = np.array([look.mount_deg for look in every])
    metres = np.array([look.mount_m for look in every])
    assert degrees.shape == metres.shape == (len(every), 4, 3)
    assert np.abs(degrees).max() <= 0.7
    assert np.abs(metres).max() <= 0.02
    assert (degrees.std(axis=0) > 0.15).all()
    assert (metres.std(axis=0) > 0.004).all()
    # no systematic error: within four standard errors of none
    assert (np.abs(degrees.mean(axis=0)) < 4.0 * degrees.std(axis=0) / len(every) ** 0.5).all()


@pytest.mark.parametrize("field", WEATHER)
def test_weather_stays_within_the_ranges_of_its_condition(looks, field):
    for drawn in looks.values():
        for look in drawn:
            low, high = getattr(look.condition, field)
            assert low <= getattr(look, field) <= high


def test_the_sun_stands_as_high_as_the_condition_says_in_any_direction(looks):
    for drawn in looks.values():
        for look in drawn:
            x, y, z = look.sun_direction
            assert np.hypot(np.hypot(x, y), z) == pytest.approx(1.0)
            low, high = look.condition.sun_elevation_deg
            assert low - 1e-9 <= np.degrees(np.arcsin(z)) <= high + 1e-9
            assert np.arctan2(y, x) == pytest.approx(look.sun_azimuth_rad)
        quadrants = {int(look.sun_azimuth_rad // (np.pi / 2.0)) for look in drawn}
        assert quadrants == {-2, -1, 0, 1}


@pytest.mark.parametrize("cameras", [1, 4, 7])
def test_every_camera_has_its_own_exposure_balance_and_mounting(cameras):
    look = draw_look("train", 2, cameras)
    assert look.exposure.shape == (cameras,)
    assert look.balance.shape == look.mount_deg.shape == look.mount_m.shape == (cameras, 3)
    for table in (look.exposure, look.balance, look.mount_deg, look.mount_m):
        assert len(np.unique(table, axis=0)) == cameras
    assert 0.8 < look.exposure.min() <= look.exposure.max() < 1.2
    assert 0.95 < look.balance.min() <= look.balance.max() < 1.05


def test_a_given_condition_and_palette_replace_the_drawn_ones_and_leave_the_rest():
    free = draw_look("train", 4)
    fixed = draw_look("train", 4, condition=NIGHT, palette=TEST_PALETTES[0])
    assert (fixed.condition, fixed.palette) == (NIGHT, TEST_PALETTES[0])
    jitter = fixed.ground - fixed.palette.ground_array()
    np.testing.assert_allclose(jitter, free.ground - free.palette.ground_array())
    np.testing.assert_array_equal(fixed.mount_deg, free.mount_deg)
    assert fixed.sun_azimuth_rad == free.sun_azimuth_rad
    for condition in (CLEAR, WET, DENSE_FOG, LOW_SUN):
        assert draw_look("train", 4, condition=condition).condition is condition


@pytest.mark.parametrize("name", ["Train", "", None, 3])
def test_an_unknown_set_is_refused_with_the_known_ones(name):
    with pytest.raises(ValueError, match=rf"one of train, test, hard, got {name!r}"):
        draw_look(name, 0)


if __name__ == "__main__":
    print(*digests())


@pytest.mark.parametrize("name", APPEARANCES)
def test_a_single_condition_leaves_all_else_as_the_set_draws_it(name):
    for appearance, condition in single_appearances(name).items():
        for seed in range(5):
            single, whole = draw_look(appearance, seed), draw_look(name, seed)
            assert single.condition == condition
            assert single.palette == whole.palette
            assert single.dirty == whole.dirty
            np.testing.assert_array_equal(single.paints, whole.paints)
            np.testing.assert_array_equal(single.mount_deg, whole.mount_deg)


def test_no_held_out_condition_is_an_appearance_of_training():
    conditions = single_appearances("train").values()
    assert set(conditions) == set(TRAIN_CONDITIONS)
    assert not set(conditions) & set(HARD_CONDITIONS)
    for condition in HARD_CONDITIONS:
        with pytest.raises(ValueError, match="no such condition"):
            draw_look(f"train:{condition.name.replace(' ', '_')}", 0)


def test_a_single_hard_condition_has_what_hard_has_besides():
    settings = [EnvSettings(appearance=look) for look in ("hard", "hard:night", "test:dusk")]
    town = compiled_town("Town01")
    assert [each.world_config(town).dense_furniture for each in settings] == [True, True, False]
