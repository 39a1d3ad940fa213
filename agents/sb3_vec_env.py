"""``BEVTownVectorEnv`` as Stable-Baselines3 wants its vector environments.

Gymnasium's vector environments and Stable-Baselines3's are different interfaces; between these two
nothing is copied and no process is started, so ``PPO(BetaPolicy, SB3VecEnv(envs))`` steps all
worlds in one kernel call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from bev_driving_env.vector_env import BEVTownVectorEnv


class SB3VecEnv(VecEnv):
    """Many worlds as one ``VecEnv``.

    Infos carry what Stable-Baselines3 looks for: ``terminal_observation``,
    ``TimeLimit.truncated`` and, like its ``Monitor``, ``episode`` with return and length; and
    BEVTown's own ``episode_summary``.

    Args:
        envs: The worlds; they must reset themselves in the step in which an episode ends.

    Raises:
        ValueError: They do not.
    """

    def __init__(self, envs: BEVTownVectorEnv) -> None:
        if envs.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "Stable-Baselines3 resets worlds in the step in which they end: make the envs "
                f'with autoreset_mode="SameStep", got {envs.autoreset_mode.value!r}'
            )
        self.envs = envs
        self._actions: NDArray[np.float32] | None = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> dict[str, NDArray[Any]]:
        """Start an episode in every world, from the seeds given to ``seed`` if there are any."""
        given = any(seed is not None for seed in self._seeds)
        observations, _ = self.envs.reset(seed=self._seeds if given else None)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take note of the actions (n, 2)."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Step; observations, rewards (n,), ends (n,) and a list of n infos."""
        if self._actions is None:
            raise RuntimeError("step_wait() needs step_async() before it")
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        self._actions = None
        ended = terminated | truncated
        listed: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(ended):
            summary = infos["final_info"]["episode_summary"]
            listed[i] = {
                "terminal_observation": infos["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode_summary": {key: summary[key][i] for key in summary if key[0] != "_"},
            }
            own = listed[i]["episode_summary"]
            listed[i]["episode"] = {
                "r": float(own["return"]),
                "l": int(own["steps"]),
                "t": float(own["time_s"]),
            }
        return observations, rewards.astype(np.float32), ended, listed

    def close(self) -> None:
        """Close the worlds."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the worlds' environment, once for each world asked for."""
        return [getattr(self.envs, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not possible for one world alone.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("worlds of BEVTownVectorEnv have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Not possible for one world alone.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("worlds of BEVTownVectorEnv have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Whether each world has a wrapper; ``Monitor`` is built in, any other is not there."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor] * len(self._chosen(indices))

    def _chosen(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
