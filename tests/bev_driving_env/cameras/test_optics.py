import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bev_driving_env.cameras.conditions import (
    CLEAR,
    DENSE_FOG,
    DUSK,
    HARD_CONDITIONS,
    LIGHT_FOG,
    LOW_SUN,
    NIGHT,
    OVERCAST,
    TEST_CONDITIONS,
    TRAIN_CONDITIONS,
    WET,
)
from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.optics import build_optics, mounts, noise_tile
from bev_driving_env.cameras.rig import Camera, CameraRig, project
from bev_driving_env.kernels import paints as paint
from bev_driving_env.kernels.shading import HAZE_STEPS
from bev_driving_env.towns.ground import MATERIALS

RIG = CameraRig(size=(56, 120))
CONDITIONS = TRAIN_CONDITIONS + HARD_CONDITIONS


def optics_of(appearance="train", seed=3, rig=RIG, *, misaligned=False, **keywords):
    look = draw_look(appearance, seed, len(rig.cameras), **keywords)
    return build_optics(look, rig, misaligned=misaligned), look


def at_distance(table, distance_m):
    """Entry of a table by inverse depth, 0 to 1 per metre."""
    return float(table[round((HAZE_STEPS - 1) / distance_m)])


def ground_colours(optics):
    """Lit colours (8, 3) of the pure materials, which are the first eight codes."""
    codes = optics.atmosphere.ground[: len(MATERIALS)].astype(np.int64)
    return np.stack([codes // 256**k % 256 for k in range(3)], axis=-1)


def test_aligned_cameras_sit_where_the_nominal_rig_says():
    optics, _ = optics_of(misaligned=False)
    np.testing.assert_allclose(optics.axes, RIG.extrinsics()[:, :3, :3], atol=1e-6)
    expected = [(camera.x_m, camera.y_m, camera.z_m) for camera in RIG.cameras]
    np.testing.assert_allclose(optics.places, expected, atol=1e-12)
    for turn, place, matrix in zip(optics.axes, optics.places, RIG.extrinsics(), strict=True):
        np.testing.assert_allclose(-turn @ place, matrix[:3, 3], atol=1e-6)


def test_misaligned_cameras_are_turned_and_moved_by_the_looks_errors():
    optics, look = optics_of(misaligned=True)
    for k, camera in enumerate(RIG.cameras):
        nominal = (camera.yaw_deg, camera.pitch_deg, camera.roll_deg)
        body = Rotation.from_euler("ZYX", nominal + look.mount_deg[k], degrees=True)
        expected = body.apply([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        np.testing.assert_allclose(optics.axes[k], expected, atol=1e-9)
        place = np.array([camera.x_m, camera.y_m, camera.z_m]) + look.mount_m[k]
        np.testing.assert_allclose(optics.places[k], place, atol=1e-12)


def test_misalignment_moves_what_is_20_m_ahead_by_less_than_four_pixels_but_visibly():
    rig = CameraRig()
    point, moved = np.array([20.0, 1.0, 0.5]), []
    nominal, _ = project(rig.intrinsics()[0], rig.extrinsics()[0], point)
    for seed in range(20):
        axes, places = mounts(draw_look("train", seed), rig, misaligned=True)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = axes[0], -axes[0] @ places[0]
        pixel, _ = project(rig.intrinsics()[0], matrix, point)
        moved.append(np.hypot(*(pixel - nominal)))
    assert max(moved) < 4.0
    assert np.median(moved) > 0.2


@pytest.mark.parametrize(
    "camera",
    [
        Camera("down", pitch_deg=90.0),
        Camera("turned", yaw_deg=360.0, roll_deg=-180.0),
        Camera("corner", x_m=20.0, y_m=-20.0, z_m=0.2),
    ],
    ids=lambda camera: camera.name,
)
def test_a_camera_at_the_limit_of_what_a_rig_accepts_can_be_misaligned_in_every_episode(camera):
    rig = CameraRig((camera,))
    for seed in range(8):
        axes, _ = mounts(draw_look("train", seed, 1), rig, misaligned=True)
        np.testing.assert_allclose(axes[0] @ axes[0].T, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("appearance", ["train", "test", "hard"])
@pytest.mark.parametrize("size", [(56, 120), (112, 240), (33, 47)])
def test_lens_tables_are_bytes_for_every_pixel_of_every_camera(appearance, size):
    rig = CameraRig(size=size)
    optics, _ = optics_of(appearance, 1, rig)
    for table in (optics.gain, optics.veil, optics.beam):
        assert table.shape == (4, *size)
        assert table.dtype == np.uint8
    assert optics.balance.shape == (4, 3)
    assert len(optics.veil_rgb) == 3
    assert optics.balance.dtype == np.float32
    assert optics.axes.shape == (4, 3, 3)
    assert optics.places.shape == (4, 3)


def test_a_clean_lens_exposes_the_middle_as_drawn_and_darkens_towards_the_corners():
    optics, look = optics_of()
    height, width = RIG.size
    for gain, exposure in zip(optics.gain.astype(float), look.exposure, strict=True):
        middle = gain[height // 2, width // 2]
        assert middle == pytest.approx(128.0 * exposure, abs=1.5)
        assert gain.max() <= middle + 1.0
        assert gain[0, 0] < 0.95 * middle
        # the same to all sides, falling outwards
        np.testing.assert_array_equal(gain, gain[:, ::-1])
        np.testing.assert_array_equal(gain, gain[::-1])
        assert (np.diff(gain[height // 2, width // 2 :]) <= 0.0).all()


def test_a_clean_lens_in_clear_weather_has_no_veil_and_a_low_sun_puts_an_even_one():
    assert not optics_of(condition=CLEAR)[0].veil.any()
    dusk = optics_of(condition=DUSK)[0].veil
    low = optics_of(condition=LOW_SUN)[0].veil
    assert len(np.unique(dusk)) == len(np.unique(low)) == 1
    assert 0 < dusk.max() < low.max() < 128


def test_dirt_darkens_and_veils_some_of_every_lens_and_differs_by_camera_and_seed():
    seen = set()
    for seed in (1, 2):
        dirty, look = optics_of("hard", seed, condition=DENSE_FOG)
        clean = 128.0 * look.exposure[:, None, None]
        assert (dirty.gain <= clean).all()
        for gain, veil in zip(dirty.gain, dirty.veil, strict=True):
            assert 0.01 < (veil > 40).mean() < 0.5
            assert (veil == 0).mean() > 0.2
            # where there is dirt, less light comes through
            assert gain[veil > 60].mean() < 0.85 * gain[veil == 0].mean()
            seen.add(veil.tobytes())
    assert len(seen) == 8


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.name)
def test_headlights_shine_at_night_only(condition):
    optics, _ = optics_of(condition=condition)
    lit = condition is NIGHT
    assert optics.beam.any() == lit
    assert (optics.atmosphere.beam > 0.0) == lit


def test_headlights_fall_mostly_into_the_front_image_on_what_is_straight_ahead_and_low():
    optics, _ = optics_of(condition=NIGHT)
    shares = dict(zip([c.name for c in RIG.cameras], optics.beam.mean(axis=(1, 2)), strict=True))
    assert shares["front"] > 5.0 * max(shares["left"], shares["right"])
    assert shares["rear"] < 1.0
    beam = optics.beam[0].astype(float)
    (ahead, wide, high), _ = project(
        RIG.intrinsics()[0],
        RIG.extrinsics()[0],
        [[15.0, 0.0, 0.3], [10.0, 9.0, 0.3], [15.0, 0.0, 7.0]],
    )
    brightness = [beam[round(row), round(column)] for column, row in (ahead, wide, high)]
    assert brightness[0] > 230.0
    assert max(brightness[1:]) < 0.5 * brightness[0]


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.name)
def test_haze_grows_with_distance_and_takes_63_percent_at_the_sight_distance(condition):
    optics, look = optics_of(condition=condition)
    haze = optics.atmosphere.haze
    assert haze.shape == (HAZE_STEPS,)
    assert (np.diff(haze) <= 0.0).all()  # by inverse depth: far comes first
    assert 0.0 <= haze.min() <= haze.max() <= 1.0
    distances = [2.0, 5.0, 20.0]
    for distance in distances:
        expected = 1.0 - math.exp(-distance / look.sight_m)
        assert at_distance(haze, distance) == pytest.approx(expected, rel=0.03, abs=1e-3)
    if look.sight_m < 120.0:
        assert at_distance(haze, look.sight_m) == pytest.approx(0.632, abs=0.03)


def test_fog_hides_more_than_clear_air_and_dense_fog_hides_most():
    hazes = [at_distance(optics_of(condition=c)[0].atmosphere.haze, 25.0)
             for c in (CLEAR, LIGHT_FOG, DENSE_FOG)]  # fmt: skip
    assert hazes[0] < 0.05 < 0.2 < hazes[1] < 0.4 < 0.5 < hazes[2]


def test_shadows_darken_where_the_sun_shines_and_only_there():
    clear, _ = optics_of(condition=CLEAR)
    assert clear.sunny
    assert max(clear.atmosphere.shadow) < 0.75
    assert min(clear.atmosphere.shadow) > 0.1
    # sky light is bluer than sunlight, so shadows are too
    assert clear.atmosphere.shadow[2] > clear.atmosphere.shadow[0]
    for condition in (OVERCAST, LIGHT_FOG, NIGHT, DENSE_FOG):
        grey, _ = optics_of(condition=condition)
        assert not grey.sunny
        np.testing.assert_allclose(grey.atmosphere.shadow, 1.0)


@pytest.mark.parametrize("condition", [CLEAR, DUSK, LOW_SUN], ids=lambda c: c.name)
def test_whoever_sees_a_sun_sees_shadows(condition):
    assert all(optics_of(seed=seed, condition=condition)[0].sunny for seed in range(5))


def test_only_wet_ground_mirrors_the_sky_the_more_the_farther():
    assert not optics_of(condition=CLEAR)[0].atmosphere.sheen.any()
    wet = optics_of(condition=WET)[0].atmosphere.sheen
    assert 0.0 < at_distance(wet, 3.0) < at_distance(wet, 12.0) < at_distance(wet, 100.0) < 1.0


def test_the_ground_has_the_looks_colours_in_the_light_of_the_weather():
    optics, look = optics_of(condition=OVERCAST)
    light = look.ambient * np.array(OVERCAST.ambient_tint)
    expected = np.clip(look.ground * light, 0.0, 255.0)
    np.testing.assert_allclose(ground_colours(optics), expected, atol=0.51)


def test_a_mixed_texel_has_a_colour_between_those_of_its_two_materials():
    from bev_driving_env.towns.ground import CODE_EIGHTHS, CODE_MATERIALS

    optics, _ = optics_of(condition=OVERCAST)
    pure = ground_colours(optics)
    codes = optics.atmosphere.ground.astype(np.int64)
    for code in (9, 60, 100, 203):
        (a, b), share = CODE_MATERIALS[code], CODE_EIGHTHS[code] / 8.0
        seen = [codes[code] // 256**k % 256 for k in range(3)]
        np.testing.assert_allclose(seen, pure[a] * (1.0 - share) + pure[b] * share, atol=1.5)


def test_rain_darkens_the_asphalt_more_than_the_grass():
    dry_look = draw_look("train", 3, condition=OVERCAST)
    dry, wet = optics_of(condition=OVERCAST)[0], optics_of(condition=WET)[0]
    wet_look = draw_look("train", 3, condition=WET)
    fade = (ground_colours(wet) / ground_colours(dry)).mean(axis=1)
    fade *= dry_look.ambient / wet_look.ambient
    by_name = dict(zip(MATERIALS, fade, strict=True))
    assert by_name["asphalt"] < 0.9 * by_name["grass"]
    assert by_name["sidewalk"] < by_name["grass"]


def test_lamps_are_lit_when_it_is_dark():
    day, night = optics_of(condition=CLEAR)[0], optics_of(condition=NIGHT)[0]
    for slot in (paint.LAMP, paint.HEADLIGHT):
        assert (night.lighting.paints[slot] > 185.0).all()
        assert night.lighting.paints[slot].sum() != day.lighting.paints[slot].sum()
    assert night.lighting.paints[paint.LAMP].sum() > 1.3 * day.lighting.paints[paint.LAMP].sum()


def test_the_night_is_darker_than_the_day_and_its_sky_than_its_lamps():
    day, night = optics_of(condition=CLEAR)[0], optics_of(condition=NIGHT)[0]
    assert ground_colours(night).mean() < 0.25 * ground_colours(day).mean()
    assert max(night.atmosphere.zenith_rgb) < 40.0 < min(day.atmosphere.zenith_rgb)


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.name)
def test_all_parts_agree_on_where_the_sun_stands(condition):
    optics, look = optics_of(condition=condition)
    light = optics.lighting
    np.testing.assert_allclose([light.sun_x, light.sun_y, light.sun_z], look.sun_direction)
    np.testing.assert_allclose(optics.atmosphere.sun, look.sun_direction, atol=1e-6)
    assert np.isfinite(optics.atmosphere.shadow).all()
    assert optics.atmosphere.ground.dtype == optics.atmosphere.codes.dtype == np.int32


def test_optics_do_not_change_the_look_they_are_built_from():
    look = draw_look("hard", 3, condition=NIGHT)
    before = look.ground.copy(), look.paints.copy(), look.balance.copy()
    optics = build_optics(look, RIG, misaligned=True)
    optics.balance[:] = 0.0
    for array, copy in zip((look.ground, look.paints, look.balance), before, strict=True):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("tenths", [15, 40, 70])
def test_sensor_noise_has_the_asked_deviation_and_no_bias(tenths):
    tile = noise_tile(tenths)
    assert tile.shape == (65536,)
    assert tile.dtype == np.int16
    # rounding to whole grey levels adds a variance of 1 / 12
    expected = math.sqrt((tenths / 10.0) ** 2 + 1.0 / 12.0)
    assert tile.std() == pytest.approx(expected, rel=0.02)
    assert abs(tile.mean()) < 4.0 * expected / 256.0


def test_the_held_out_and_the_trained_conditions_are_these():
    # what the other tests here take for granted
    assert TRAIN_CONDITIONS == (CLEAR, OVERCAST, WET)
    assert TEST_CONDITIONS == (LIGHT_FOG, DUSK)
    assert set(HARD_CONDITIONS) == {LIGHT_FOG, DUSK, NIGHT, DENSE_FOG, LOW_SUN}
