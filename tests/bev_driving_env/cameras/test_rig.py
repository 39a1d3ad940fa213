import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bev_driving_env.cameras.rig import (
    CAMERA_SIZE,
    PAPER_CAMERA_SIZE,
    SURROUND,
    Camera,
    CameraRig,
    ground_points,
    project,
    rotation,
)
from bev_driving_env.frames import BEVGeometry

cameras = st.builds(
    Camera,
    st.just("odd"),
    x_m=st.floats(-3.0, 3.0),
    y_m=st.floats(-3.0, 3.0),
    z_m=st.floats(0.3, 10.0),
    yaw_deg=st.floats(-360.0, 360.0),
    pitch_deg=st.floats(-90.0, 90.0),
    roll_deg=st.floats(-180.0, 180.0),
    fov_deg=st.floats(10.0, 150.0),
)
sizes = st.tuples(st.integers(16, 600), st.integers(16, 600))


def oracle_axes(camera):
    """Right, down, forward of a camera in the ego frame, by SciPy."""
    angles = [camera.yaw_deg, camera.pitch_deg, camera.roll_deg]
    body = Rotation.from_euler("ZYX", angles, degrees=True)
    return body.apply([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def inside(pixels, size):
    """Whether pixels lie in an image; NaN does not."""
    height, width = size
    column, row = pixels[..., 0], pixels[..., 1]
    return (column >= -0.5) & (column < width - 0.5) & (row >= -0.5) & (row < height - 0.5)


def seen_by(point, rig=None):
    """Names of the cameras in whose images an ego-frame point lies."""
    rig = rig or CameraRig()
    names = set()
    for camera in rig.cameras:
        pixel, _ = project(camera.intrinsics(rig.size), camera.extrinsics(), point)
        if inside(pixel, rig.size):
            names.add(camera.name)
    return names


@pytest.mark.parametrize(
    ("angles_deg", "body_axis", "expected"),
    [
        ((90, 0, 0), (1, 0, 0), (0, 1, 0)),  # yaw: ahead becomes left
        ((0, 90, 0), (1, 0, 0), (0, 0, -1)),  # pitch: ahead becomes down
        ((0, 0, 90), (0, -1, 0), (0, 0, -1)),  # roll: right becomes down
        ((90, 90, 0), (1, 0, 0), (0, 0, -1)),
        ((90, 0, 90), (0, -1, 0), (0, 0, -1)),
    ],
)
def test_yaw_turns_left_pitch_lowers_the_nose_and_roll_lowers_the_right_side(
    angles_deg, body_axis, expected
):
    turned = rotation(*np.radians(angles_deg)) @ np.array(body_axis, float)
    np.testing.assert_allclose(turned, expected, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(st.floats(-7.0, 7.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))
def test_a_rotation_is_scipys_of_yaw_then_pitch_then_roll(yaw, pitch, roll):
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    np.testing.assert_allclose(rotation(yaw, pitch, roll), expected, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(cameras)
def test_extrinsics_map_ego_to_camera_with_x_right_y_down_z_forward(camera):
    axes, place = oracle_axes(camera), [camera.x_m, camera.y_m, camera.z_m]
    matrix = camera.extrinsics()
    points = np.random.default_rng(0).uniform(-20.0, 20.0, (6, 3))
    seen = np.column_stack([points, np.ones(6)]) @ matrix.T
    np.testing.assert_allclose(seen[:, :3], (points - place) @ axes.T, atol=1e-9)
    np.testing.assert_array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])


@settings(max_examples=50, deadline=None)
@given(cameras)
def test_extrinsics_are_proper_rotations(camera):
    turn = camera.extrinsics()[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


@settings(max_examples=50, deadline=None)
@given(cameras, sizes)
def test_pixels_are_those_of_opencv(camera, size):
    axes, place = oracle_axes(camera), np.array([camera.x_m, camera.y_m, camera.z_m])
    ahead = np.array([[-1.0, 0.5, 3.0], [0.2, -0.7, 10.0], [0.0, 0.0, 1.0], [4.0, 4.0, 30.0]])
    points = place + ahead @ axes  # these four lie in front of the camera
    intrinsics = camera.intrinsics(size)
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(axes))
    expected, _ = cv2.projectPoints(points, turn, -axes @ place, intrinsics, None)
    pixels, depth = project(intrinsics, camera.extrinsics(), points)
    scale = max(1.0, intrinsics[0, 0])
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-6 * scale)
    np.testing.assert_allclose(depth, ahead[:, 2], atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(cameras, sizes, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_where_a_pixels_ray_meets_the_ground_projects_back_to_the_pixel(camera, size, u, v):
    intrinsics, extrinsics = camera.intrinsics(size), camera.extrinsics()
    pixel = np.array([u * (size[1] - 1), v * (size[0] - 1)])
    point = ground_points(intrinsics, extrinsics, pixel)
    assume(np.isfinite(point).all() and np.hypot(*point) < 500.0)
    back, depth = project(intrinsics, extrinsics, [*point, 0.0])
    assert depth > 0.0
    np.testing.assert_allclose(back, pixel, atol=1e-4)


@pytest.mark.parametrize("size", [CAMERA_SIZE, PAPER_CAMERA_SIZE, (97, 31)])
def test_the_grounds_pixels_of_all_four_cameras_round_trip_in_the_rigs_own_precision(size):
    rig = CameraRig(size=size)
    pixels = np.stack(np.meshgrid(np.arange(size[1]), np.arange(size[0])), axis=-1)
    for intrinsics, extrinsics in zip(rig.intrinsics(), rig.extrinsics(), strict=True):
        points = ground_points(intrinsics, extrinsics, pixels)
        assert points.shape == (*size, 2)
        below = np.isfinite(points).all(axis=-1)
        assert below[-1].all()
        assert not below[0].any()  # sky
        ground = np.concatenate([points, np.zeros((*size, 1))], axis=-1)
        back, _ = project(intrinsics, extrinsics, ground)
        near = np.hypot(points[..., 0], points[..., 1]) < 200.0
        assert near.mean() > 0.4
        np.testing.assert_allclose(back[near], pixels[near], atol=1e-3)


def test_ground_points_follow_similar_triangles():
    # level camera 2 m up with 45 degrees to each side: focal length is half the width
    camera = Camera("level", x_m=1.0, z_m=2.0, pitch_deg=0.0, fov_deg=90.0)
    intrinsics = camera.intrinsics((100, 100))
    points = ground_points(intrinsics, camera.extrinsics(), [[49.5, 59.5], [74.5, 59.5]])
    np.testing.assert_allclose(points, [[11.0, 0.0], [11.0, -5.0]], atol=1e-9)


def test_rays_at_and_above_the_horizon_meet_no_ground():
    camera = Camera("level", pitch_deg=0.0)
    points = ground_points(
        camera.intrinsics((101, 101)), camera.extrinsics(), [[50.0, 50.0], [0.0, 0.0]]
    )
    assert np.isnan(points).all()


def test_points_behind_a_camera_have_no_pixel():
    camera = Camera("front", x_m=1.0, pitch_deg=0.0)
    pixels, depth = project(
        camera.intrinsics(CAMERA_SIZE),
        camera.extrinsics(),
        [[-4.0, 0.0, 2.0], [1.0, 0.0, 2.0], [6.0, 0.0, 2.0]],
    )
    np.testing.assert_allclose(depth, [-5.0, 0.0, 5.0], atol=1e-12)
    assert np.isnan(pixels[:2]).all()
    assert np.isfinite(pixels[2]).all()


@pytest.mark.parametrize("distance_m", [4.0, 10.0, 80.0])
def test_a_point_ahead_is_in_the_centre_column_of_the_front_camera_and_higher_up_if_farther(
    distance_m,
):
    rig = CameraRig()
    ahead = [[distance_m, 0.0, 0.0], [distance_m + 1.0, 0.0, 0.0]]
    pixels, _ = project(rig.intrinsics()[0], rig.extrinsics()[0], ahead)
    assert rig.cameras[0].name == "front"
    np.testing.assert_allclose(pixels[:, 0], (rig.size[1] - 1) / 2.0, atol=1e-4)
    assert pixels[1, 1] < pixels[0, 1]


def test_what_is_left_appears_left_in_the_front_camera_and_right_in_the_rear_camera():
    rig = CameraRig()
    middle = (rig.size[1] - 1) / 2.0
    by_name = {camera.name: k for k, camera in enumerate(rig.cameras)}
    for name, x, sign in (("front", 12.0, -1.0), ("rear", -12.0, 1.0)):
        k = by_name[name]
        pixel, _ = project(rig.intrinsics()[k], rig.extrinsics()[k], [x, 3.0, 1.0])
        assert inside(pixel, rig.size)
        assert sign * (pixel[0] - middle) > 5.0


@pytest.mark.parametrize(
    ("point", "camera"),
    [
        ((12.0, 0.0, 1.0), "front"),
        ((0.0, 12.0, 1.0), "left"),
        ((0.0, -12.0, 1.0), "right"),
        ((-12.0, 0.0, 1.0), "rear"),
    ],
)
def test_each_camera_sees_its_own_side_alone(point, camera):
    assert seen_by(point) == {camera}


def test_the_four_cameras_leave_no_direction_unseen():
    for angle in np.radians(np.arange(0, 360, 3)):
        assert seen_by((15.0 * math.cos(angle), 15.0 * math.sin(angle), 1.0))


@pytest.mark.parametrize("size", [CAMERA_SIZE, PAPER_CAMERA_SIZE])
def test_the_four_cameras_see_95_percent_of_the_cells_of_the_default_bev(size):
    rig, bev = CameraRig(size=size), BEVGeometry()
    cells = np.stack(np.meshgrid(np.arange(bev.size), np.arange(bev.size)), axis=-1)
    points = bev.ego_from_pixel(cells)
    points = np.concatenate([points, np.zeros((bev.size, bev.size, 1))], axis=-1)
    seen = np.zeros((bev.size, bev.size), bool)
    for intrinsics, extrinsics in zip(rig.intrinsics(), rig.extrinsics(), strict=True):
        pixels, _ = project(intrinsics, extrinsics, points)
        seen |= inside(pixels, size)
    assert 0.95 <= seen.mean() < 1.0
    assert not seen[bev.ego_row, bev.ego_column]  # the car stands there


@settings(max_examples=50, deadline=None)
@given(st.floats(5.0, 160.0), sizes)
def test_the_horizontal_field_of_view_spans_the_image_from_border_to_border(fov_deg, size):
    matrix = Camera("any", fov_deg=fov_deg).intrinsics(size)
    borders = np.array([[-0.5, 0.0, 1.0], [size[1] - 0.5, 0.0, 1.0]])
    left, right = borders @ np.linalg.inv(matrix).T
    span = math.degrees(math.atan2(right[0], right[2]) - math.atan2(left[0], left[2]))
    assert span == pytest.approx(fov_deg)
    assert left[0] == pytest.approx(-right[0])


@settings(max_examples=20, deadline=None)
@given(sizes)
def test_pixels_are_square_and_the_optical_axis_meets_the_middle_of_the_image(size):
    matrix = Camera("any").intrinsics(size)
    assert matrix[0, 0] == matrix[1, 1] > 0.0
    assert matrix[:2, 2].tolist() == [(size[1] - 1) / 2.0, (size[0] - 1) / 2.0]
    assert matrix[0, 1] == matrix[1, 0] == 0.0
    assert matrix[2].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("size", [CAMERA_SIZE, PAPER_CAMERA_SIZE, [32, 64]])
def test_a_rig_describes_its_images_in_the_order_of_its_cameras(size):
    rig = CameraRig(SURROUND[::-1][:3], size)
    assert rig.shape == (3, *size, 3)
    assert rig.intrinsics().shape == (3, 3, 3)
    assert rig.extrinsics().shape == (3, 4, 4)
    assert rig.intrinsics().dtype == rig.extrinsics().dtype == np.float32
    for k, camera in enumerate(SURROUND[::-1][:3]):
        np.testing.assert_allclose(rig.extrinsics()[k], camera.extrinsics(), atol=1e-6)
        np.testing.assert_allclose(rig.intrinsics()[k], camera.intrinsics(tuple(size)), rtol=1e-6)


def test_the_default_rig_is_four_cameras_of_112_by_240():
    rig = CameraRig()
    assert rig.shape == (4, 112, 240, 3)
    assert [camera.name for camera in rig.cameras] == ["front", "left", "right", "rear"]


def test_matrices_are_made_anew_so_that_nobody_can_spoil_a_rig():
    rig = CameraRig()
    rig.intrinsics()[:] = 0.0
    rig.extrinsics()[:] = 0.0
    assert rig.intrinsics()[0, 0, 0] > 0.0
    assert rig.extrinsics()[0, 3, 3] == 1.0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("x_m", 20.5),
        ("y_m", -21.0),
        ("z_m", 0.1),
        ("z_m", math.nan),
        ("yaw_deg", 361.0),
        ("yaw_deg", "left"),
        ("pitch_deg", 90.1),
        ("roll_deg", math.inf),
        ("fov_deg", 4.0),
        ("fov_deg", 161.0),
        ("fov_deg", None),
        ("fov_deg", True),
    ],
)
def test_a_bad_camera_is_refused_with_its_name_and_value(field, value):
    with pytest.raises(ValueError, match=rf"'roof': {field} must be .* got {value!r}"):
        Camera("roof", **{field: value})


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"cameras": ()}, r"tuple of Camera objects, got \(\)"),
        ({"cameras": None}, "tuple of Camera objects, got None"),
        ({"cameras": ("front",)}, "tuple of Camera objects, got .*front"),
        ({"cameras": SURROUND + SURROUND[:1]}, "different names, got front.*front"),
        ({"size": (15, 240)}, r"16 to 4096 px, got \(15, 240\)"),
        ({"size": (112, 4097)}, r"16 to 4096 px, got \(112, 4097\)"),
        ({"size": (112.0, 240)}, r"16 to 4096 px, got \(112.0, 240\)"),
        ({"size": (112, 240, 3)}, r"16 to 4096 px, got \(112, 240, 3\)"),
        ({"size": 112}, "16 to 4096 px, got 112"),
        ({"size": "ab"}, "16 to 4096 px, got 'ab'"),
    ],
)
def test_a_bad_rig_is_refused_with_the_value(keywords, message):
    with pytest.raises(ValueError, match=message):
        CameraRig(**keywords)


def test_rigs_are_equal_and_hash_alike_if_their_values_are():
    assert CameraRig(list(SURROUND), [112, 240]) == CameraRig()
    assert hash(CameraRig(list(SURROUND), [112, 240])) == hash(CameraRig())
    assert CameraRig(size=PAPER_CAMERA_SIZE) != CameraRig()
