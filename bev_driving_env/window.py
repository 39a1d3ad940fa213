"""A window for ``render_mode="human"``; the only place that needs a display."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

KEY_NAMES = (
    *("up", "down", "left", "right", "space", "escape"),
    *("w", "a", "s", "d", "q", "r", "n"),
)
"""The keys that are asked for."""

UNSEEN = ("offscreen", "dummy")


class Window:
    """Shows RGB frames with pygame, at no more than a given rate.

    Args:
        title: Caption of the window.
        fps: Greatest number of frames a second; ``show`` waits as long as it takes.

    Raises:
        RuntimeError: No display could be opened.
    """

    def __init__(self, title: str, fps: int) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame: Any = pygame
        self._title = title
        self._fps = fps
        self._clock = pygame.time.Clock()
        self._screen: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame (H, W, 3)."""
        pygame = self._pygame
        if self._screen is None:
            try:
                pygame.display.init()
                self._screen = pygame.display.set_mode(frame.shape[1::-1])
                driver = pygame.display.get_driver()
                if driver in UNSEEN and "SDL_VIDEODRIVER" not in os.environ:
                    # SDL falls back to a window that nobody sees
                    raise pygame.error(f"SDL found only its driver {driver!r}")
            except pygame.error as error:
                raise RuntimeError(
                    f"render_mode='human' needs a display ({error}); "
                    f"use render_mode='rgb_array' without one"
                ) from error
            pygame.display.set_caption(self._title)
        pygame.event.pump()
        surface = pygame.image.frombuffer(np.ascontiguousarray(frame), frame.shape[1::-1], "RGB")
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()
        self._clock.tick(self._fps)

    def pressed(self) -> set[str]:
        """Names of the keys held down; ``"escape"`` too once the window's cross was clicked."""
        pygame = self._pygame
        closing = any(event.type == pygame.QUIT for event in pygame.event.get())
        held = pygame.key.get_pressed()
        names = {name for name in KEY_NAMES if held[pygame.key.key_code(name)]}
        return names | {"escape"} if closing else names

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
