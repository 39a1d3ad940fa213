"""``render_mode="human"``: a window, through SDL's dummy display, or a clear error without one."""

import gymnasium as gym
import numpy as np
import pytest

from bev_driving_env.window import Window

pygame = pytest.importorskip("pygame")


@pytest.fixture
def dummy_display(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.fixture
def no_display(monkeypatch):
    pygame.display.quit()
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")


def test_human_rendering_shows_every_step_and_closes_its_window(dummy_display):
    env = gym.make("BEVTown02-v0", render_mode="human")
    env.reset(seed=0)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    for _ in range(5):
        env.step([1.0, 0.0])
    assert env.render() is None
    later = pygame.surfarray.array3d(pygame.display.get_surface())
    assert not np.array_equal(shown, later)
    assert "Town02" in pygame.display.get_caption()[0]
    env.close()
    assert not pygame.display.get_init()
    env.close()


def test_the_window_has_the_pixels_of_the_frame(dummy_display):
    frame = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    window = Window("test", fps=100)
    window.show(frame)
    shown = pygame.surfarray.array3d(pygame.display.get_surface())
    np.testing.assert_array_equal(shown.transpose(1, 0, 2), frame)
    window.close()


def test_without_a_display_the_error_says_what_to_use_instead(no_display):
    env = gym.make("BEVTown02-v0", render_mode="human")
    with pytest.raises(RuntimeError, match=r"needs a display.*rgb_array"):
        env.reset(seed=0)
    env.close()


def test_rgb_array_needs_no_display(no_display):
    env = gym.make("BEVTown02-v0", render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().any()


def press(monkeypatch, *names):
    held = {pygame.key.key_code(name) for name in names}
    keys = type("Keys", (), {"__getitem__": lambda self, code: code in held})()
    monkeypatch.setattr(pygame.key, "get_pressed", lambda: keys)


def test_held_keys_are_told_by_name(dummy_display, monkeypatch):
    env = gym.make("BEVTown02-v0", render_mode="human")
    env.reset(seed=0)
    assert env.unwrapped.pressed_keys() == set()
    press(monkeypatch, "up", "a", "space")
    assert env.unwrapped.pressed_keys() == {"up", "a", "space"}
    press(monkeypatch, "z")
    assert env.unwrapped.pressed_keys() == set()
    env.close()


def test_a_click_on_the_cross_is_an_escape(dummy_display):
    window = Window("test", fps=100)
    window.show(np.zeros((40, 60, 3), np.uint8))
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert window.pressed() == {"escape"}
    assert window.pressed() == set()
    window.close()


def test_keys_are_asked_of_a_window_only():
    for env in (
        gym.make("BEVTown02-v0", render_mode="rgb_array").unwrapped,
        gym.make("BEVTown02-v0", render_mode="human").unwrapped,
    ):
        with pytest.raises(RuntimeError, match=r"human.*reset"):
            env.pressed_keys()


def test_a_click_on_the_cross_during_a_frame_is_not_lost(dummy_display):
    window = Window("test", fps=100)
    frame = np.zeros((40, 60, 3), np.uint8)
    window.show(frame)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    window.show(frame)
    assert "escape" in window.pressed()
    window.close()
