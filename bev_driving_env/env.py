"""``BEVTownEnv``: one car in one town as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .episodes import choose_route
from .info import episode_summary, reward_terms, step_info
from .kernels.layout import HEADING, SPEED, X, Y
from .settings import EnvSettings
from .spaces import action_space, checked_actions, observation_space
from .towns.registry import compiled_town
from .towns.route import Route
from .world.core import World, WorldSnapshot

Observation = dict[str, NDArray[Any]]


class BEVTownEnv(gym.Env[Any, Any]):
    __doc__ = """TODO"""

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    def __init__(
        self, town: str = "Town01", *, render_mode: str | None = None, **keywords: Any
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(
                f"render_mode must be None, 'rgb_array' or 'human', got {render_mode!r}"
            )
        self.render_mode = render_mode
        self.settings = EnvSettings.from_keywords(keywords)
        config = self.settings.world_config()
        self.world = World(compiled_town(town), config)
        self.action_space = action_space()
        self.observation_space = observation_space(config.bev, config.vehicle.max_speed_mps)
        self._placed = False
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; the table in the class docstring lists the options."""
        super().reset(seed=seed)
        self.world.rngs[0] = self.np_random
        route, episode_id = choose_route(self.world.town, options, self.np_random)
        self.world.place(0, route, episode_id)
        self._placed = True
        if self.render_mode == "human":
            self.render()
        return self._observe(), step_info(self.world, 0)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for a tenth of a second.

        Raises:
            ValueError: The action is not two finite numbers.
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        if not self._placed:
            raise gym.error.ResetNeeded("call reset() before step()")
        world = self.world
        world.step(checked_actions(action, (2,))[None])
        terminated = bool(world.terminated()[0])
        truncated = not terminated and bool(world.truncated()[0])
        info = step_info(world, 0)
        info["reward_terms"] = reward_terms(world, 0)
        if terminated or truncated:
            info["episode_summary"] = episode_summary(world, 0)
        if self.render_mode == "human":
            self.render()
        return self._observe(), float(world.rewards[0]), terminated, truncated, info

    def _observe(self) -> Observation:
        ego, command = self.world.state.ego[0], self.world.state.command[0]
        measurements = np.array([ego[SPEED], command[0], command[1]], dtype=np.float32)
        return {"bev": self.ground_truth_bev(), "measurements": measurements}

    def ground_truth_bev(self) -> NDArray[np.uint8]:
        """The true BEV (6, size, size) uint8 of this moment, newly made."""
        bev = np.empty((1, *self.world.bev_shape), np.uint8)
        self.world.render(bev)
        return bev[0]

    @property
    def ego_pose(self) -> tuple[float, float, float]:
        """World x, y (metres) and heading (radians) of the ego's centre."""
        ego = self.world.state.ego[0]
        return float(ego[X]), float(ego[Y]), float(ego[HEADING])

    @property
    def vehicle_states(self) -> NDArray[np.float64]:
        """Other vehicles (n, 6): x, y, heading, speed, length, width; a copy."""
        vehicles = self.world.state.vehicles[0]
        return vehicles[vehicles[:, -1] > 0.0].copy()

    @property
    def route(self) -> Route:
        """The route being driven.

        Raises:
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        route = self.world.routes[0]
        if route is None:
            raise gym.error.ResetNeeded("call reset() first: there is no route yet")
        return route

    def snapshot(self) -> WorldSnapshot:
        """Copy the state of the world, random generator included."""
        return self.world.snapshot()

    def restore(self, snapshot: WorldSnapshot) -> Observation:
        """Go back to a snapshot and return the observation there.

        Raises:
            ValueError: The snapshot is of another town or number of worlds.
        """
        self.world.restore(snapshot)
        return self._observe()

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the town map and the BEV: an RGB image (H, W, 3), or a window for ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array" or "human")')
            return None
        from .render import draw_panel

        frame = draw_panel(self.world, 0)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            from .window import Window

            self._window = Window(f"BEVTown: {self.world.town.name}", self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None
