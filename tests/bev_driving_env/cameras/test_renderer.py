"""``CameraRenderer``: toy scenes on the ring road, seen where a pinhole camera says."""

import dataclasses
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from bev_driving_env.cameras.conditions import CLEAR, NIGHT, OVERCAST
from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.renderer import CameraRenderer, CameraSettings
from bev_driving_env.cameras.rig import SURROUND, Camera, CameraRig
from bev_driving_env.cameras.scenery import build_scenery
from bev_driving_env.kernels.layout import SIGNAL_GREEN, SIGNAL_OFF, SIGNAL_RED, SIGNAL_YELLOW
from bev_driving_env.towns.furniture import BUILDING, SIGNAL, Prop
from bev_driving_env.towns.ground import CODE_EIGHTHS, CODE_MATERIALS
from bev_driving_env.world.state import WorldState

SIZE = (224, 480)
EAST = (40.0, 2.0, 0.0)
"""On the ring's northern road, heading east."""
PLAIN = dataclasses.replace(
    OVERCAST,
    ambient=(1.0, 1.0),
    sight_m=(1e6, 1e6),
    clouds=(0.0, 0.0),
    noise=(0.0, 0.0),
    blur_px=(0.0, 0.0),
)
"""No sun, haze, noise or blur: what differs between two pictures is what was put there."""
SUNNY = dataclasses.replace(
    PLAIN, sun=(0.8, 0.8), ambient=(0.4, 0.4), sun_elevation_deg=(40.0, 40.0)
)
FRONT, LEFT, RIGHT, REAR = range(4)
VEHICLE = (4.5, 1.9)


@dataclasses.dataclass(frozen=True)
class Dressed(CameraSettings):
    """Settings with one condition for all episodes."""

    condition: object = PLAIN

    def look(self, episode_seed):
        return draw_look("train", episode_seed, len(self.rig.cameras), condition=self.condition)


class Scene:
    """A ring road with chosen furniture."""

    def __init__(self, ring, props=(), *, condition=PLAIN, cameras=SURROUND, size=SIZE):
        self.rig = CameraRig(cameras, size)
        scenery = build_scenery(ring, props)
        town = SimpleNamespace(ground=ring.ground, scenery=lambda dense: scenery)
        settings = Dressed(self.rig, motion=False, condition=condition)
        self.renderer = CameraRenderer(town, settings, (5.0, 2.0))
        self.signals = len(scenery.signals)

    def see(self, pose=EAST, vehicles=(), signals=(), seed=0, *, people=(), look=None, step=0):
        rows = np.array([(*v, 0.0, *VEHICLE) if len(v) == 3 else v for v in vehicles])
        state = WorldState.empty(
            1, vehicles=len(rows), pedestrians=len(people), signals=self.signals
        )
        state.ego[0, :3] = pose
        state.episode_seed[0] = seed
        state.steps[0] = step
        if len(people):
            state.pedestrians[0] = people
        if len(rows):
            state.vehicles[0] = rows
        if len(signals):
            state.signals[0] = signals
        return self.renderer.render(state, 0, look)

    def project(self, camera, points, pose=EAST):
        """Pixels (n, 2) of world points (n, 3), and their depths, by the pinhole alone."""
        x, y, heading = pose
        cos, sin = np.cos(heading), np.sin(heading)
        dx, dy, z = np.transpose(points) - np.array([[x], [y], [0.0]])
        ego = np.stack([dx * cos + dy * sin, dx * sin - dy * cos, z, np.ones_like(z)])
        seen = (self.rig.extrinsics()[camera].astype(float) @ ego)[:3]
        pixels = self.rig.intrinsics()[camera].astype(float) @ (seen / seen[2])
        return pixels[:2].T, seen[2]

    def outline(self, camera, box, grow_px, pose=EAST):
        """Mask of the silhouette of a box (x, y, heading, length, width, height), grown."""
        corners = corners_of(box)
        pixels, depth = self.project(camera, corners, pose)
        mask = np.zeros(self.rig.size, np.uint8)
        if (depth > 0.3).all():
            hull = cv2.convexHull((pixels * 16.0).round().astype(np.int32))
            cv2.fillConvexPoly(mask, hull, 1, cv2.LINE_8, 4)
        kernel = np.ones((2 * abs(grow_px) + 1,) * 2, np.uint8)
        change = cv2.dilate if grow_px >= 0 else cv2.erode
        return change(mask, kernel).astype(bool)


def corners_of(box):
    x, y, heading, length, width, height = box
    signs = np.array([[a, b] for a in (-0.5, 0.5) for b in (-0.5, 0.5)])
    cos, sin = np.cos(heading), np.sin(heading)
    ahead, right = signs[:, 0] * length, signs[:, 1] * width
    flat = np.stack([x + ahead * cos - right * sin, y + ahead * sin + right * cos], axis=-1)
    return np.vstack([np.column_stack([flat, np.full(4, z)]) for z in (0.0, height)])


def differing(one, other):
    return (one != other).any(axis=-1)


@pytest.fixture(scope="module")
def empty(ring):
    return Scene(ring)


HOUSE = Prop(BUILDING, 55.0, 2.0, 0.0, 4.0, 3.0, 5.0, 3)


@pytest.fixture(scope="module")
def blocked(ring):
    return Scene(ring, [HOUSE])


# --- hiding and being seen -----------------------------------------------------------------------


def test_a_building_hides_the_ground_behind_it_and_nothing_beside_it(empty, blocked):
    before, after = empty.see(), blocked.see()
    changed = differing(before, after)
    inner = blocked.outline(FRONT, (*HOUSE[1:4], *HOUSE[4:7]), -2)
    # its flat roof has an edge that stands out a little
    outer = blocked.outline(FRONT, (*HOUSE[1:4], 4.3, 3.3, 5.5), 2)
    assert inner.sum() > 500
    assert changed[FRONT][inner].mean() > 0.95
    assert not changed[FRONT][~outer].any()
    for camera in (LEFT, RIGHT, REAR):
        assert not changed[camera].any()


def test_what_stands_behind_a_building_is_not_seen_and_what_stands_before_it_is(blocked):
    alone = blocked.see()
    np.testing.assert_array_equal(blocked.see(vehicles=[(62.0, 2.0, 0.0)]), alone)
    assert differing(blocked.see(vehicles=[(49.0, 2.0, 0.0)]), alone)[FRONT].sum() > 500


@pytest.mark.parametrize(
    ("place", "camera"),
    [
        ((52.0, 2.0, 0.0), FRONT),
        ((70.0, -2.0, 3.0), FRONT),
        ((40.0, -6.0, 0.4), LEFT),
        ((41.0, 9.0, 1.2), RIGHT),
        ((30.0, 1.0, 0.0), REAR),
    ],
)
def test_a_vehicle_is_seen_where_the_projection_says_and_nowhere_else(empty, place, camera):
    changed = differing(empty.see(), empty.see(vehicles=[place]))
    outer = empty.outline(camera, (*place, *VEHICLE, 2.2), 3)
    body = empty.outline(camera, (*place, VEHICLE[0] * 0.9, VEHICLE[1] * 0.9, 0.8), -1)
    assert body.sum() > 20
    assert changed[camera][body].mean() > 0.85
    assert not changed[camera][~outer].any()
    for other in {FRONT, LEFT, RIGHT, REAR} - {camera}:
        assert not differing(empty.see(), empty.see(vehicles=[place]))[other].any()


def test_an_empty_slot_is_no_vehicle(empty):
    np.testing.assert_array_equal(
        empty.see(vehicles=[(52.0, 2.0, 0.0, 0.0, 0.0, 0.0)]), empty.see()
    )


def test_nearer_vehicles_hide_farther_ones_in_whatever_order_they_are_listed(ring):
    low = Scene(ring, cameras=(Camera("low", x_m=1.2, z_m=0.6, pitch_deg=0.0),))
    near, far = (50.0, 2.0, 0.0), (75.0, 2.0, 0.0)
    nobody = (0.0,) * 6
    assert differing(low.see(), low.see(vehicles=[far])).sum() > 50
    # a vehicle's paint goes with its slot
    for both, alone in (([near, far], [near, nobody]), ([far, near], [nobody, near])):
        np.testing.assert_array_equal(low.see(vehicles=both), low.see(vehicles=alone))


def test_with_the_pose_the_picture_turns(empty):
    # the same vehicle, 12 m ahead and 3 m to the left of the car, wherever that looks
    for heading in np.radians([0.0, 77.0, 180.0, 301.0]):
        pose = (100.0, 20.0, heading)
        cos, sin = np.cos(heading), np.sin(heading)
        place = (100.0 + 12.0 * cos + 3.0 * sin, 20.0 + 12.0 * sin - 3.0 * cos, heading)
        changed = differing(empty.see(pose), empty.see(pose, vehicles=[place]))[FRONT]
        rows, columns = np.nonzero(changed)
        middle, _ = empty.project(FRONT, np.array([[*place[:2], 0.75]]), pose)
        assert columns.mean() == pytest.approx(middle[0, 0], abs=6.0)
        assert rows.mean() == pytest.approx(middle[0, 1], abs=8.0)


# --- kinds of actors -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("length", "width", "height"), [(4.2, 1.8, 1.5), (5.6, 2.0, 2.15), (7.0, 2.45, 3.0)]
)
def test_cars_vans_and_trucks_are_as_high_as_their_length_says(empty, length, width, height):
    for place in ((56.0, 2.0, 0.0), (58.0, -2.0, np.pi), (54.0, 5.0, 1.2)):
        alone, seen = empty.see(), empty.see(vehicles=[(*place, 5.0, length, width)])
        changed = differing(alone, seen)[FRONT]
        box = (*place, length, width + 0.04, height)
        assert not changed[~empty.outline(FRONT, box, 2)].any()
        lower = empty.outline(FRONT, (*place, length, width, height - 0.35), 0)
        assert (changed & ~lower).sum() > 50


def test_a_standing_vehicle_shows_its_brake_lights_and_a_moving_one_does_not(empty):
    place = (50.0, 2.0, 0.0)
    standing, moving = (
        empty.see(vehicles=[(*place, speed, *VEHICLE)])[FRONT].astype(int) for speed in (0.0, 5.0)
    )
    rows, columns = np.nonzero(differing(standing, moving))
    assert 10 < len(rows) < 200
    assert (standing - moving)[rows, columns, 0].mean() > 30
    # at its rear, one on each side
    ends = np.array([[50.0 - VEHICLE[0] / 2.0, 2.0 + side * 0.72 * 0.95, 0.74] for side in (-1, 1)])
    lamps, _ = empty.project(FRONT, ends)
    distance = np.hypot(*(np.column_stack([columns, rows])[:, None] - lamps).transpose(2, 0, 1))
    assert distance.min(axis=1).max() < 9.0
    assert distance.min(axis=0).max() < 2.0


def test_the_episode_decides_the_paint_of_a_vehicle_and_the_clothes_of_a_person(empty):
    look = draw_look("train", 0, 4, condition=PLAIN)
    vehicle, person = (52.0, 2.0, 0.0), (46.0, 5.0, 0.0, 0.0, 0.5, 0.5)

    def colours(seed, step=0):
        image = empty.see(vehicles=[vehicle], people=[person], seed=seed, look=look, step=step)
        points = np.array([[52.0 - VEHICLE[0] / 2.0, 2.0, 0.6], [46.0, 5.0, 1.15]])
        pixels, _ = empty.project(FRONT, points)
        return tuple(tuple(image[FRONT, round(v), round(u)].tolist()) for u, v in pixels)

    seen = [colours(seed) for seed in range(24)]
    assert len({paint for paint, _ in seen}) >= 5
    assert len({clothes for _, clothes in seen}) >= 5
    assert [colours(seed, step=9) for seed in range(24)] == seen


def extent(scene, mask, camera, x, pose=EAST):
    """Lowest and highest z, and the breadth across the view, of what is seen at some x."""
    pixels, _ = scene.project(camera, np.array([[x, pose[1], 0.0], [x, pose[1], 1.0]]), pose)
    px_per_m = pixels[0, 1] - pixels[1, 1]
    rows, columns = np.nonzero(mask[camera])
    return (
        (pixels[0, 1] - rows.max()) / px_per_m,
        (pixels[0, 1] - rows.min()) / px_per_m,
        (columns.max() - columns.min() + 1) / px_per_m,
    )


@pytest.mark.parametrize(
    ("width", "least", "most"), [(0.35, 1.1, 1.35), (0.45, 1.5, 1.75), (0.6, 1.7, 1.95)]
)
def test_people_are_as_tall_as_their_footprint_says(empty, width, least, most):
    heights = []
    for seed in range(12):
        seen = empty.see(people=[(47.0, 2.0, np.pi / 2, 0.0, width, width)], seed=seed)
        low, high, _ = extent(empty, differing(seen, empty.see(seed=seed)), FRONT, 47.0)
        assert low == pytest.approx(0.0, abs=0.06)
        assert least - 0.08 < high < most + 0.08
        heights.append(high)
    assert max(heights) - min(heights) > 0.08
    assert np.mean(heights) == pytest.approx((least + most) / 2.0, abs=0.07)


def test_legs_swing_with_the_metres_walked_and_stand_still_without(empty):
    breadths = {1.3: [], 0.0: []}
    for speed, found in breadths.items():
        for walked in np.arange(0.0, 1.5, 0.05):
            person = (47.0, 1.0 + walked, np.pi / 2, speed, 0.5, 0.5)
            changed = differing(empty.see(people=[person]), empty.see())
            # the shins
            pixels, _ = empty.project(FRONT, np.array([[47.0, 2.0, 0.15]]))
            changed[:, : round(pixels[0, 1])] = False
            found.append(extent(empty, changed, FRONT, 47.0)[2])
    assert max(breadths[1.3]) - min(breadths[1.3]) > 0.4
    assert max(breadths[0.0]) - min(breadths[0.0]) < 0.1
    # the stance depends on the place alone
    person = (47.0, 1.35, np.pi / 2, 1.3, 0.5, 0.5)
    np.testing.assert_array_equal(empty.see(people=[person]), empty.see(people=[person], step=31))


def test_of_actors_beside_and_behind_a_house_the_part_beside_it_is_seen(empty, blocked):
    house = differing(empty.see(), blocked.see())[FRONT]
    partly = 0
    for y in np.arange(-8.0, 12.0, 0.25):
        actors = {
            "vehicles": [(70.0, y, 0.3, 5.0, 7.0, 2.4)],
            "people": [(58.0, y, 0.0, 1.0, 0.5, 0.5)],
        }
        free = differing(empty.see(**actors), empty.see())[FRONT]
        seen = differing(blocked.see(**actors), blocked.see())[FRONT]
        assert (seen != (free & ~house)).sum() == 0
        partly += (free & house).any() and (free & ~house).any()
    assert partly > 10


# --- signals -------------------------------------------------------------------------------------


def test_a_lit_lamp_shows_its_colour_in_its_place(ring):
    # beside the road, facing west: at the traffic that comes from there
    post = Prop(SIGNAL, 50.0, 5.0, 0.0, 0.2, 0.2, 3.0, 0)
    scene = Scene(ring, [post])
    states = (SIGNAL_OFF, SIGNAL_RED, SIGNAL_YELLOW, SIGNAL_GREEN)
    off, red, yellow, green = (scene.see(signals=[state])[FRONT].astype(int) for state in states)
    lamps = {}
    for name, image in (("red", red), ("yellow", yellow), ("green", green)):
        rows, columns = np.nonzero(differing(image, off))
        assert 5 <= len(rows) < 200, name
        lamps[name] = rows.mean(), columns.mean(), image[rows, columns].mean(axis=0)
    assert lamps["red"][0] < lamps["yellow"][0] < lamps["green"][0]
    pixel, _ = scene.project(FRONT, np.array([[50.0, 5.0, 3.0]]))
    for row, column, _ in lamps.values():
        assert column == pytest.approx(pixel[0, 0], abs=3.0)
        assert row == pytest.approx(pixel[0, 1], abs=15.0)
    (r, g, b), (r2, g2, b2), (r3, g3, b3) = (lamps[name][2] for name in ("red", "yellow", "green"))
    assert r > 1.5 * max(g, b)
    assert min(r2, g2) > 1.4 * b2
    assert g3 > 1.3 * r3
    assert g3 > b3


def test_a_lamp_is_not_seen_from_behind(ring):
    scene = Scene(ring, [Prop(SIGNAL, 50.0, 5.0, np.pi, 0.2, 0.2, 3.0, 0)])
    np.testing.assert_array_equal(
        scene.see(signals=[SIGNAL_RED])[FRONT], scene.see(signals=[SIGNAL_GREEN])[FRONT]
    )


# --- light ---------------------------------------------------------------------------------------


def shadow_scene(ring, condition, seed, height_m=8.0):
    """A house whose shadow falls on the road ahead, and that point of the road."""
    target = np.array([50.0, 2.0])
    sun = draw_look("train", seed, 4, condition=SUNNY).sun_direction
    middle = target + sun[:2] / sun[2] * height_m * 0.5
    house = Prop(BUILDING, *middle, np.arctan2(sun[1], sun[0]), 3.0, 5.0, height_m, 3)
    return Scene(ring, [house], condition=condition), target


def brightness(scene, image, target):
    """Mean grey of half a metre of ground around a world point, as the front camera sees it."""
    corners = np.array(
        [[target[0] + a, target[1] + b, 0.0] for a in (-0.25, 0.25) for b in (-0.25, 0.25)]
    )
    pixels, _ = scene.project(FRONT, corners)
    low, high = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
    return image[FRONT, low[1] : high[1] + 1, low[0] : high[0] + 1].mean()


def seeds_with_sun_ahead(count):
    """Looks whose sun stands ahead, so that a house throws its shadow towards the car."""
    looks = ((seed, draw_look("train", seed, 4, condition=SUNNY)) for seed in range(300))
    found = [seed for seed, look in looks if 0.2 < abs(look.sun_azimuth_rad) < 0.9]
    return found[:count]


def test_a_house_throws_its_shadow_away_from_the_sun_when_it_shines(ring):
    seeds = seeds_with_sun_ahead(4)
    assert len(seeds) == 4
    bare = {condition: Scene(ring, condition=condition) for condition in (SUNNY, PLAIN)}
    for seed in seeds:
        sunny, target = shadow_scene(ring, SUNNY, seed)
        overcast, _ = shadow_scene(ring, PLAIN, seed)
        lit = brightness(sunny, bare[SUNNY].see(seed=seed), target)
        shaded = brightness(sunny, sunny.see(seed=seed), target)
        assert shaded < 0.75 * lit
        even = brightness(overcast, bare[PLAIN].see(seed=seed), target)
        assert brightness(overcast, overcast.see(seed=seed), target) == pytest.approx(even, rel=0.1)
        # beside the shadow the sun still shines
        sun = sunny.renderer.look(seed).sun_direction
        across = 4.5 * np.array([-sun[1], sun[0]]) / np.hypot(*sun[:2])
        beside = min((target - across, target + across), key=lambda point: point[0])
        before = brightness(sunny, bare[SUNNY].see(seed=seed), beside)
        assert brightness(sunny, sunny.see(seed=seed), beside) == pytest.approx(before, rel=0.05)


def test_vehicles_and_the_car_itself_throw_shadows_in_the_sun_only(ring):
    sunny, plain = Scene(ring, condition=SUNNY), Scene(ring, condition=PLAIN)
    place = (50.0, 2.0, 0.0)
    grown = sunny.outline(FRONT, (*place, *VEHICLE, 2.2), 3)
    outside = []
    for seed in range(4):
        dark = sunny.see(seed=seed).astype(int) - sunny.see(vehicles=[place], seed=seed)
        outside.append((dark[FRONT].sum(axis=-1) > 30)[~grown].sum())
        assert not differing(plain.see(seed=seed), plain.see(vehicles=[place], seed=seed))[FRONT][
            ~grown
        ].any()
    assert max(outside) > 100


def test_night_is_darker_than_day_and_headlights_light_the_road_ahead(ring):
    day, night = Scene(ring, condition=CLEAR), Scene(ring, condition=NIGHT)
    dark = Scene(ring, condition=dataclasses.replace(NIGHT, headlights=0.0))
    for seed in range(3):
        bright, dim = day.see(seed=seed), night.see(seed=seed)
        assert dim.mean() < 0.4 * bright.mean()
        ahead = slice(130, 200), slice(180, 300)
        lit, unlit = (scene.see(seed=seed)[FRONT][ahead].mean() for scene in (night, dark))
        assert lit > 1.5 * unlit


# --- far away ------------------------------------------------------------------------------------


def nearest_ground(scene, ring, pose, look, camera=FRONT):
    """The bare ground as sampling its nearest texel would show it: grey (H, W), and (x, y)."""
    height, width = scene.rig.size
    v, u = np.mgrid[:height, :width]
    matrix = scene.rig.extrinsics()[camera].astype(float)
    rays = np.linalg.inv(scene.rig.intrinsics()[camera].astype(float)) @ np.stack(
        [u.ravel(), v.ravel(), np.ones(u.size)]
    )
    rays = matrix[:3, :3].T @ rays
    place = -matrix[:3, :3].T @ matrix[:3, 3]
    down = rays[2] < -1e-3
    reach = np.where(down, -place[2] / np.where(down, rays[2], -1.0), np.nan)
    ahead, left = place[0] + reach * rays[0], place[1] + reach * rays[1]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + ahead * cos + left * sin, pose[1] + ahead * sin - left * cos
    ground = ring.ground
    rows, columns = ground.shapes[0]
    texels = ground.texels[: rows * columns].reshape(rows, columns)
    r = np.floor((y - ground.grid.y0_m) * ground.grid.px_per_m)
    c = np.floor((x - ground.grid.x0_m) * ground.grid.px_per_m)
    inside = down & (r >= 0) & (c >= 0) & (r < rows) & (c < columns)
    codes = texels[np.where(inside, r, 0).astype(int), np.where(inside, c, 0).astype(int)]
    share = CODE_EIGHTHS[codes] / 8.0
    first, second = look.ground[CODE_MATERIALS[codes]].mean(axis=-1).T
    grey = np.where(inside, first * (1.0 - share) + second * share, 0.0)
    return grey.reshape(height, width), x.reshape(height, width), y.reshape(height, width)


@pytest.mark.parametrize(
    ("size", "nearest_m", "farthest_m"), [((112, 240), 45.0, 80.0), ((224, 480), 60.0, 100.0)]
)
def test_far_lane_paint_does_not_flicker(ring, size, nearest_m, farthest_m):
    scene = Scene(ring, size=size)
    look = scene.renderer.look(0)
    edge_y = 4.0  # of the lane that heads east along y = 2: a solid white line
    ours, naive = [], []
    for k in range(40):
        pose = (20.0 + 0.2 * k, 2.0, 0.0)
        grey, x, y = nearest_ground(scene, ring, pose, look)
        reach = x - pose[0]
        region = (np.abs(y - edge_y) < 0.5) & (reach > nearest_m) & (reach < farthest_m)
        assert region.sum() >= 5
        ours.append(scene.see(pose)[FRONT].mean(axis=-1)[region].mean())
        naive.append(grey[region].mean())
    # relative to the brightness, and from frame to frame: what an eye sees as flicker
    flicker = [np.abs(np.diff(series)).mean() / np.mean(series) for series in (ours, naive)]
    assert flicker[1] > 0.008
    assert flicker[0] < 0.3 * flicker[1]
    # and the paint is there: brighter than the asphalt beside it
    asphalt = (np.abs(y - 3.0) < 0.4) & (reach > nearest_m) & (reach < farthest_m)
    assert ours[-1] > scene.see(pose)[FRONT].mean(axis=-1)[asphalt].mean() + 3.0


# --- nothing is left behind ----------------------------------------------------------------------


def test_a_picture_depends_on_nothing_that_was_drawn_before(ring, blocked):
    noisy = Scene(ring, [HOUSE], condition=CLEAR)
    for scene in (blocked, noisy):
        first = scene.see(vehicles=[(49.0, -2.0, 3.0)], seed=5)
        kept = first.copy()
        scene.see((120.0, 62.0, 3.0), vehicles=[(110.0, 60.0, 0.0), (115.0, 58.0, 1.0)], seed=6)
        scene.see()
        again = scene.see(vehicles=[(49.0, -2.0, 3.0)], seed=5)
        np.testing.assert_array_equal(first, kept)
        np.testing.assert_array_equal(again, kept)
        assert not np.shares_memory(first, again)


def test_rendering_changes_nothing_in_the_state_and_only_its_own_world(ring, blocked):
    state = WorldState.empty(3, vehicles=2, signals=0)
    state.ego[:, :3] = [EAST, (60.0, -2.0, np.pi), (150.0, 62.0, np.pi)]
    state.episode_seed[:] = 1, 2, 3
    state.vehicles[1, 0] = (52.0, -2.0, np.pi, 0.0, *VEHICLE)
    before = state.copy()
    images = [blocked.renderer.render(state, n) for n in (0, 1, 2, 1)]
    for item in dataclasses.fields(state):
        np.testing.assert_array_equal(getattr(state, item.name), getattr(before, item.name))
    np.testing.assert_array_equal(images[1], images[3])
    np.testing.assert_array_equal(images[0], blocked.see(seed=1))


def test_outside_the_town_and_upside_down_there_is_still_a_picture(blocked):
    for pose in [(-5000.0, 3000.0, 1.0), (1e6, -1e6, 50.0), (*EAST[:2], -400.0)]:
        images = blocked.see(pose)
        assert images.shape == (4, *SIZE, 3)
        assert images.dtype == np.uint8


@pytest.mark.parametrize("size", [(16, 16), (17, 31), (112, 240), (300, 64)])
def test_any_size_shows_the_same_scene(ring, size):
    wide = (Camera("front", x_m=1.2),)
    image = Scene(ring, [HOUSE], cameras=wide, size=size).see()[0]
    assert image.shape == (*size, 3)
    # the sky is brighter than the ground and the house stands in the middle
    assert image[0].mean() > image[-1].mean()
    bare = Scene(ring, cameras=wide, size=size).see()[0]
    columns = np.nonzero(differing(image, bare).any(axis=0))[0]
    assert columns.mean() == pytest.approx((size[1] - 1) / 2.0, abs=0.06 * size[1] + 1.0)


def test_the_picture_does_not_depend_on_the_type_of_sequence_a_rig_is_given(ring):
    one, other = (Scene(ring, cameras=kind(SURROUND), size=(32, 64)) for kind in (list, tuple))
    np.testing.assert_array_equal(one.see(), other.see())
