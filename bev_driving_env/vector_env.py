"""``BEVTownVectorEnv``: many cars in as many copies of one town, stepped together."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from .checks import require_count
from .episodes import choose_route
from .info import REWARD_TERM_NAMES, episode_summary, reward_terms, step_info
from .kernels.layout import LATERAL, ROUTE_DONE, X
from .sensors import Sensors
from .settings import EnvSettings
from .sources.policy_view import PolicySnapshot, PolicyView
from .sources.protocol import SensorFrame
from .spaces import action_space, checked_actions, observation_space
from .towns.registry import compiled_town
from .world.core import World, WorldSnapshot
from .world.infractions import names_of

BatchedObservation = dict[str, NDArray[Any]]
Mask = NDArray[np.bool_]


@dataclasses.dataclass(frozen=True, eq=False)
class VectorSnapshot:
    """State of all worlds, which of them wait for their automatic reset, and the BEV sources."""

    world: WorldSnapshot
    ended: Mask
    policy_view: PolicySnapshot | None = None


class BEVTownVectorEnv(VectorEnv[Any, Any, Any]):
    """Vectorised ``BEVTownEnv``: same spaces, same keywords, same numbers, one kernel call a step.

    ``gym.make_vec("BEVTown01-v0", num_envs=8)`` builds this class. World ``i`` with seed ``s + i``
    is bit-equal to a ``BEVTownEnv`` with that seed.

    Args:
        num_envs: Number of worlds, at least 1.
        town: Name of a registered town.
        autoreset_mode: ``AutoresetMode.NEXT_STEP`` (default), ``SAME_STEP`` or ``DISABLED``, or
            the value of one, such as ``"SameStep"``. With ``DISABLED``, reset ended worlds by
            ``reset(options={"reset_mask": mask})``.
        max_episode_steps: Control steps after which a world is truncated, on top of the time
            limit of its route; what ``TimeLimit`` does for a single environment.
        render_mode: None or ``"rgb_array"``: ``render()`` then gives a tuple of frames.
        **keywords: Those of ``BEVTownEnv``.

    Raises:
        ValueError: A value is not valid; the message names it and the valid ones.
        TypeError: A keyword does not exist.
    """

    metadata = {
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        town: str = "Town01",
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **keywords: Any,
    ) -> None:
        require_count("num_envs", num_envs)
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        if max_episode_steps is not None:
            require_count("max_episode_steps", max_episode_steps)
        self.num_envs = int(num_envs)
        self.render_mode = render_mode
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.settings = EnvSettings.from_keywords(keywords)
        compiled = compiled_town(town)
        config = self.settings.world_config(compiled)
        self.world = World(compiled, config, num_envs)
        self.sensors = Sensors(self.world, self.settings.camera_settings())
        self.policy_view = PolicyView(self.settings.bev_source, self.num_envs, config.bev)
        self._max_episode_steps = max_episode_steps
        self.single_action_space = action_space()
        if self.settings.cameras or self.policy_view.needs_frame:
            self.sensors.prepare()
        images = self.sensors.settings.rig.shape if self.settings.cameras else None
        self.single_observation_space = observation_space(
            config.bev, config.top_speed_mps, images=images
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._ended = np.ones(num_envs, np.bool_)
        self._placed = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[BatchedObservation, dict[str, Any]]:
        """Start an episode in every world, or in those of ``options["reset_mask"]``.

        Args:
            seed: World ``i`` gets ``seed + i``; or one seed a world.
            options: As for ``BEVTownEnv``, for all worlds alike, and ``reset_mask``.
        """
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        seeds = self._seeds(seed)
        # Gymnasium seeds a generator at random on first use, and keeps it from then on
        for i in np.flatnonzero(mask):
            if seeds[i] is not None or not self._placed[i]:
                self.world.rngs[i], _ = seeding.np_random(seeds[i])
            self._start(int(i), options)
        return self._observe(mask), self._infos(np.zeros(self.num_envs, np.bool_), mask)

    def _reset_mask(self, mask: Any) -> Mask:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"reset_mask must be a bool array of shape ({self.num_envs},) with at least one "
                f"True, got {mask!r}"
            )
        return mask

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + i for i in range(self.num_envs)]
        seeds = [None if one is None else int(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"expected {self.num_envs} seeds, one a world, got {len(seeds)}")
        return seeds

    def _start(self, i: int, options: dict[str, Any] | None = None) -> None:
        route, episode_id = choose_route(self.world.town, options, self.world.rngs[i])
        self.world.place(i, route, episode_id)
        if self._max_episode_steps is not None:
            limit = min(self.world.state.time_limit[i], self._max_episode_steps)
            self.world.state.time_limit[i] = limit
        self._ended[i] = False
        self._placed[i] = True
        self.policy_view.reset(i, int(self.world.state.episode_seed[i]))

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[BatchedObservation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Drive all worlds for a tenth of a second, resetting ended ones as the mode says.

        Args:
            actions: (num_envs, 2).

        Raises:
            ValueError: The actions are not (num_envs, 2) finite numbers.
            gymnasium.error.ResetNeeded: A world was never reset, or, with ``DISABLED``, ended.
        """
        world = self.world
        commands = checked_actions(actions, (self.num_envs, 2))
        if not self._placed.all():
            raise gym.error.ResetNeeded("call reset() before step()")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"worlds {np.flatnonzero(self._ended).tolist()} have ended: reset them with "
                f'reset(options={{"reset_mask": mask}}), or choose another autoreset_mode'
            )
        running = ~self._ended
        world.step(commands, running)
        for i in np.flatnonzero(self._ended):
            self._start(int(i))
        terminated = world.terminated()
        truncated = world.truncated()
        rewards = world.rewards.copy()
        ended = terminated | truncated
        finals = self._finish(ended) if ended.any() else {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            running &= ~ended
        else:
            self._ended = ended
        infos = {**self._infos(running, np.ones(self.num_envs, np.bool_)), **finals}
        return self._observe(), rewards, terminated, truncated, infos

    def _finish(self, ended: Mask) -> dict[str, Any]:
        """Report ended episodes; in SAME_STEP mode also start the next ones."""
        world = self.world
        indices = [int(i) for i in np.flatnonzero(ended)]
        finals: dict[str, Any] = {}
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            for i in indices:
                finals = self._add_info(finals, {"episode_summary": episode_summary(world, i)}, i)
            return finals
        last = self._observe(ended, seen=ended)
        for i in indices:
            info = step_info(world, i)
            info["reward_terms"] = reward_terms(world, i)
            info["episode_summary"] = episode_summary(world, i)
            observation = {key: array[i].copy() for key, array in last.items()}
            finals = self._add_info(finals, {"final_obs": observation, "final_info": info}, i)
            self._start(i)
        return finals

    def _observe(self, fresh: Mask | None = None, seen: Mask | None = None) -> BatchedObservation:
        """What the policies are given now.

        Args:
            fresh: Worlds in which time has passed, all if None. In the others the policy sees what
                it saw last, so that no source is asked twice about one moment.
            seen: Worlds whose cameras are wanted, all if None.
        """
        frames: dict[int, SensorFrame] = {}
        worlds = range(self.num_envs) if fresh is None else np.flatnonzero(fresh).tolist()
        if self.settings.cameras or self.policy_view.needs_frame:
            rendered = self._placed.copy()
            if not self.settings.cameras:
                rendered[[n for n in range(self.num_envs) if n not in worlds]] = False
            elif seen is not None:
                rendered &= seen
            frames = self.sensors.frames(np.flatnonzero(rendered).tolist())
        observation: BatchedObservation = {}
        if self.settings.cameras:
            size = self.world.config.bev.size
            shapes = {"cameras": self.sensors.settings.rig.shape, "route_map": (size, size)}
            for key, shape in shapes.items():
                observation[key] = np.zeros((self.num_envs, *shape), np.uint8)
            for n, frame in frames.items():
                observation["cameras"][n] = frame.images
                observation["route_map"][n] = frame.route_map
        observation["bev"] = self._policy_bev(list(worlds), frames)
        observation["measurements"] = self.sensors.measurements()
        return observation

    def _policy_bev(self, worlds: list[int], frames: dict[int, SensorFrame]) -> NDArray[np.uint8]:
        view = self.policy_view
        if view.is_truth:
            return self.ground_truth_bev()
        truth = self.ground_truth_bev() if view.needs_truth else None
        return view.observe(worlds, frames.__getitem__, truth)

    def _infos(self, stepped: Mask, reported: Mask) -> dict[str, Any]:
        """Arrays over the worlds, each with the mask of the worlds it holds for."""
        world, state = self.world, self.world.state
        infractions = np.empty(self.num_envs, object)
        infractions[:] = [list(names_of(bits)) if bits else [] for bits in world.began.tolist()]
        arrays: dict[str, Any] = {
            "route_m": state.progress[:, ROUTE_DONE].copy(),
            "route_length_m": state.route_length.copy(),
            "infractions": infractions,
            "success": world.success.copy(),
            "lateral_error_m": state.progress[:, LATERAL].copy(),
            "episode_id": np.array(world.episode_ids, object),
        }
        infos = dict(arrays)
        for key in arrays:
            infos[f"_{key}"] = reported.copy()
        if stepped.any():
            terms: dict[str, Any] = {}
            for column, name in enumerate(REWARD_TERM_NAMES):
                terms[name] = world.reward_terms[:, column].copy()
                terms[f"_{name}"] = stepped.copy()
            infos["reward_terms"], infos["_reward_terms"] = terms, stepped.copy()
        return infos

    @property
    def ego_poses(self) -> NDArray[np.float64]:
        """World poses (num_envs, 3): x, y, heading; a copy."""
        return self.world.state.ego[:, X : X + 3].copy()

    def ground_truth_bev(self) -> NDArray[np.uint8]:
        """The true BEVs (num_envs, 6, size, size) uint8 of this moment, newly made."""
        bev = np.empty((self.num_envs, *self.world.bev_shape), np.uint8)
        self.world.render(bev)
        return bev

    def sensor_frames(self) -> list[SensorFrame]:
        """What each car senses at this moment.

        Raises:
            gymnasium.error.ResetNeeded: A world was never reset.
        """
        if not self._placed.all():
            raise gym.error.ResetNeeded("call reset() before sensor_frames()")
        return list(self.sensors.frames(range(self.num_envs)).values())

    def snapshot(self) -> VectorSnapshot:
        """Copy the state of all worlds, random generators included.

        Raises:
            gymnasium.error.ResetNeeded: A world was never reset.
        """
        if not self._placed.all():
            raise gym.error.ResetNeeded("call reset() before snapshot()")
        view = None if self.policy_view.is_truth else self.policy_view.snapshot()
        return VectorSnapshot(self.world.snapshot(), self._ended.copy(), view)

    def restore(self, snapshot: VectorSnapshot) -> BatchedObservation:
        """Go back to a snapshot and return the observations there.

        Raises:
            TypeError: It is not a ``VectorSnapshot``.
            ValueError: It is of another town, configuration or number of worlds.
        """
        if not isinstance(snapshot, VectorSnapshot):
            raise TypeError(f"expected a VectorSnapshot, got {type(snapshot).__name__}")
        self.world.restore(snapshot.world)
        self._ended = snapshot.ended.copy()
        self._placed[:] = True
        if self.policy_view.restore(snapshot.policy_view):
            return self._observe(np.zeros(self.num_envs, np.bool_))
        for n in range(self.num_envs):
            self.policy_view.reset(n, int(self.world.state.episode_seed[n]))
        return self._observe()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One RGB frame (H, W, 3) a world, with ``render_mode="rgb_array"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make_vec(..., render_mode="rgb_array")')
            return None
        from .render import draw_panel

        view = self.policy_view
        bev = self.ground_truth_bev() if view.is_truth else view.last()
        return tuple(draw_panel(self.sensors, i, bev[i]) for i in range(self.num_envs))


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        modes = ", ".join(repr(known.value) for known in AutoresetMode)
        raise ValueError(f"autoreset_mode must be one of {modes}, got {mode!r}") from None
