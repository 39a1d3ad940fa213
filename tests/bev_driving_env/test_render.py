"""Pictures: the panel of ``render()``, the BEV in colour, town maps."""

import dataclasses

import cv2
import gymnasium as gym
import numpy as np
import pytest

from bev_driving_env import CorruptedBEV
from bev_driving_env.cameras.rig import Camera
from bev_driving_env.frames import CHANNELS
from bev_driving_env.render import BEV_COLOURS, GROUND, ROAD, TownMap, bev_image
from bev_driving_env.towns.registry import compiled_town

RED = (255, 0, 0)


@pytest.fixture(scope="module")
def env():
    made = gym.make("BEVTown02-v0", render_mode="rgb_array")
    yield made
    made.close()


@pytest.fixture(scope="module")
def town():
    return compiled_town("Town02")


def state_bytes(env):
    snapshot = env.unwrapped.snapshot()
    arrays = [getattr(snapshot.state, item.name) for item in dataclasses.fields(snapshot.state)]
    return [array.tobytes() for array in arrays], snapshot.rng_states, snapshot.events


def test_render_gives_an_rgb_frame_that_follows_the_car(env):
    env.reset(seed=0, options={"episode": 0})
    first = env.render()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert first.shape[0] >= 192
    for _ in range(10):
        env.step([0.8, 0.0])
    second = env.render()
    assert second.shape == first.shape
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(second, env.render())


def test_rendering_changes_nothing_in_the_world(env):
    env.reset(seed=1)
    env.step([0.8, 0.05])
    before = state_bytes(env)
    reward = env.unwrapped.world.rewards.copy()
    env.render()
    assert state_bytes(env) == before
    np.testing.assert_array_equal(env.unwrapped.world.rewards, reward)


def test_infractions_show_on_the_panel():
    env = gym.make("BEVTown02-v0", render_mode="rgb_array", terminate_on=())
    env.reset(seed=0, options={"episode": 0})
    while not env.unwrapped.world.events[0]:
        env.step([1.0, 0.2])
    with_event = env.render()
    env.unwrapped.world.events[0] = ()
    assert not np.array_equal(env.render(), with_event)


def pictures_of(panel, bev):
    """How many times the picture of a BEV stands in a panel, and the columns it stands in."""
    # its upper part, clear of the ego and of the label in the corner
    wanted = cv2.resize(bev_image(bev), (420, 420), interpolation=cv2.INTER_NEAREST)
    wanted = wanted[40:280, 20:400]
    scores = cv2.matchTemplate(panel, wanted, cv2.TM_SQDIFF)
    # OpenCV rounds its sums; what is nearly equal is looked at again
    close = np.argwhere(scores < 1e-4 * np.square(wanted.astype(float)).sum())
    equal = [
        column
        for row, column in close
        if np.array_equal(panel[row : row + 240, column : column + 380], wanted)
    ]
    return len(equal), equal


def test_the_panel_shows_what_the_policy_sees_beside_the_truth():
    blurred = CorruptedBEV("ground_truth", rotation=1.0, blob_dropout=0.3, seed=2)
    env = gym.make("BEVTown02-v0", render_mode="rgb_array", bev_source=blurred)
    observation, _ = env.reset(seed=0, options={"episode": 0})
    for _ in range(10):
        observation, *_ = env.step([0.5, 0.0])
    panel, truth = env.render(), env.unwrapped.ground_truth_bev()
    assert not np.array_equal(observation["bev"], truth)
    seen, seen_at = pictures_of(panel, observation["bev"])
    true, true_at = pictures_of(panel, truth)
    assert (seen, true) == (1, 1)
    assert seen_at[0] < true_at[0]
    np.testing.assert_array_equal(panel, env.unwrapped.draw())


def test_without_errors_both_pictures_are_the_same(env):
    observation, _ = env.reset(seed=0, options={"episode": 0})
    count, columns = pictures_of(env.render(), observation["bev"])
    assert count == 2
    assert np.ptp(columns) >= 420


def test_the_panel_shows_every_camera_of_the_rig():
    shapes, panels = [], []
    for count in (1, 4, 5):
        rig = [Camera(f"c{k}", yaw_deg=70.0 * k) for k in range(count)]
        env = gym.make(
            "BEVTown02-v0", render_mode="rgb_array", camera_rig=rig, camera_size=(40, 64)
        )
        env.reset(seed=0, options={"episode": 0})
        panels.append(env.render())
        shapes.append(panels[-1].shape)
    assert len({shape[1] for shape in shapes}) == 1
    # three tiles a row: cameras, route map, channels
    heights = [shape[0] for shape in shapes]
    assert heights[0] < heights[1] < heights[2]


def test_the_frames_of_many_worlds_show_what_each_policy_sees():
    source = CorruptedBEV("ground_truth", rotation=1.0)
    envs = gym.make_vec("BEVTown02-v0", num_envs=2, render_mode="rgb_array", bev_source=source)
    observations, _ = envs.reset(seed=0)
    for frame, bev in zip(envs.render(), observations["bev"], strict=True):
        assert frame.dtype == np.uint8
        assert pictures_of(frame, bev)[0] == 1


def test_drawing_needs_no_render_mode_but_a_reset():
    env = gym.make("BEVTown02-v0").unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="draw"):
        env.draw()
    env.reset(seed=0)
    assert env.draw().shape[2] == 3


def test_render_without_a_mode_warns_and_gives_nothing():
    env = gym.make("BEVTown02-v0").unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


@pytest.mark.parametrize("channel", range(6))
def test_the_colour_of_a_bev_pixel_is_that_of_its_channel(channel):
    bev = np.zeros((6, 4, 5), np.uint8)
    bev[channel, 1, 2] = 255
    image = bev_image(bev)
    assert image.shape == (4, 5, 3)
    assert image.dtype == np.uint8
    assert tuple(image[1, 2]) == BEV_COLOURS[CHANNELS[channel]]
    background = image[0, 0]
    image[1, 2] = background
    assert (image == background).all()


def test_later_channels_cover_earlier_ones_and_probabilities_blend():
    bev = np.zeros((6, 1, 2), np.uint8)
    bev[:, 0, 0] = 255
    bev[1, 0, 1] = 128
    covered, blended = bev_image(bev)[0]
    assert tuple(covered) == BEV_COLOURS["lights"]
    dark, full = np.array([24.0] * 3), np.array(BEV_COLOURS["route"])
    np.testing.assert_allclose(blended, (dark + full) / 2, atol=2)


@pytest.mark.parametrize(("px_per_m", "margin_m"), [(2.0, 14.0), (3.3, 5.0), (2.0, 60.0)])
def test_a_town_map_draws_in_world_coordinates(town, px_per_m, margin_m):
    plain, drawn = TownMap(town, px_per_m, margin_m), TownMap(town, px_per_m, margin_m)
    lane = max(
        (lane for lane in town.lanes if not lane.in_junction), key=lambda lane: lane.length_m
    )
    x, y, _ = lane.pose_at(lane.length_m / 3.0)
    drawn.dot((x, y), RED, 1.5, border=RED)
    rows, columns = np.nonzero((drawn.image != plain.image).any(axis=2))
    # the pixel that covers a world point, from the map's corner and resolution alone
    x0, y0, _, _ = town.bounds
    column, row = (x - x0 + margin_m) * px_per_m, (y - y0 + margin_m) * px_per_m
    assert columns.mean() + 0.5 == pytest.approx(column, abs=1.0)
    assert rows.mean() + 0.5 == pytest.approx(row, abs=1.0)
    assert tuple(plain.image[int(row), int(column)]) == ROAD


def test_a_town_map_shows_the_whole_town_and_the_ground_around_it(town):
    image = TownMap(town, px_per_m=1.0, margin_m=10.0).image
    x0, y0, x1, y1 = town.bounds
    assert image.shape == (round(y1 - y0 + 20.0), round(x1 - x0 + 20.0), 3)
    assert tuple(image[0, 0]) == GROUND
    for lane in town.lanes:
        x, y, _ = lane.pose_at(lane.length_m / 2.0)
        assert tuple(image[int(y - y0 + 10.0), int(x - x0 + 10.0)]) != GROUND


def test_lines_polygons_arrows_and_labels_land_where_they_are_told(town):
    x0, y0, x1, y1 = town.bounds
    x, y = (x0 + x1) / 2.0, (y0 + y1) / 2.0
    drawings = {
        "line": lambda m: m.line(np.array([[x - 3.0, y], [x + 3.0, y]]), RED),
        "polygon": lambda m: m.polygon(
            np.array([[x - 3.0, y - 3.0], [x + 3.0, y - 3.0], [x, y + 3.0]]), RED
        ),
        "arrow": lambda m: m.arrow((x, y, 0.3), RED),
        "label": lambda m: m.label((x, y), "B2"),
    }
    for name, draw in drawings.items():
        plain, drawn = TownMap(town), TownMap(town)
        draw(drawn)
        rows, columns = np.nonzero((drawn.image != plain.image).any(axis=2))
        assert len(rows) > 5, name
        assert abs(columns.mean() / 2.0 + x0 - 14.0 - x) < 15.0, name
        assert abs(rows.mean() / 2.0 + y0 - 14.0 - y) < 15.0, name


def test_a_line_of_one_point_is_not_drawn(town):
    plain, drawn = TownMap(town), TownMap(town)
    drawn.line(np.array([[50.0, 150.0]]), RED)
    np.testing.assert_array_equal(plain.image, drawn.image)
