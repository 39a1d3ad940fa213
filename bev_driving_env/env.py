"""``BEVTownEnv``: one car in one town as a Gymnasium environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .episodes import choose_route
from .info import episode_summary, reward_terms, step_info
from .kernels.layout import HEADING, X, Y
from .sensors import Sensors
from .settings import EnvSettings
from .sources.policy_view import PolicySnapshot, PolicyView
from .sources.protocol import SensorFrame
from .spaces import action_space, checked_actions, observation_space
from .towns.registry import compiled_town
from .towns.route import Route
from .world.core import World, WorldSnapshot

Observation = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class EnvSnapshot(WorldSnapshot):
    """State of the world, and of what stands between it and the policy.

    Attributes:
        policy_view: What the BEV sources remember; None if the policy sees the ground truth.
    """

    policy_view: PolicySnapshot | None = None


class BEVTownEnv(gym.Env[Any, Any]):
    """One car in one town, seen through a bird's-eye view.

    ## Description
    The car follows a planned route through CARLA's Town01 or Town02, rebuilt as a highway-env road
    network: two-lane roads, T junctions, right-hand traffic. World frame: metres, x east, y south,
    heading clockwise from east. Ten actions a second; physics (a kinematic bicycle, 5 m x 2 m) at
    20 Hz.

    ## Action Space
    `Box(-1, 1, (2,), float32)`; values beyond are clipped, NaN and wrong shapes are errors.

    | Num | Action       | -1                           | 1                       |
    |-----|--------------|------------------------------|-------------------------|
    | 0   | acceleration | brake, 5 m/s^2, to a stop    | accelerate, 5 m/s^2     |
    | 1   | steering     | wheels 70 degrees to the left | 70 degrees to the right |

    ## Observation Space
    A `Dict`:

    | Key            | Space                               | Meaning                               |
    |----------------|-------------------------------------|---------------------------------------|
    | `bev`          | `Box(0, 255, (6, 192, 192), uint8)` | bird's-eye view, 255 certainly there  |
    | `measurements` | `Box((3,), float32)`                | speed in m/s and the last action      |
    | `cameras`      | `Box(0, 255, (4, H, W, 3), uint8)`  | RGB; only with `cameras=True`         |
    | `route_map`    | `Box(0, 255, (192, 192), uint8)`    | sparse plan; only with `cameras=True` |

    The BEV has 5 px/m and row 0 farthest ahead; the ego's centre is at row 152, column 96, heading
    up: 30.4 m are visible ahead, 8 m behind, 19.2 m to each side.

    | Channel | Name          | 255 where                                                        |
    |---------|---------------|------------------------------------------------------------------|
    | 0       | `road`        | paved surface, junctions included, sidewalks not                 |
    | 1       | `route`       | planned lane centre, 3.2 m wide, up to 80 m ahead, nothing behind |
    | 2       | `lane`        | lane boundaries: centre line and both edges, none inside junctions |
    | 3       | `vehicles`    | other vehicles' footprints (parked ones are scenery)             |
    | 4       | `pedestrians` | pedestrians' footprints, half extent at least 0.8 m              |
    | 5       | `lights`      | stop lines whose signal says stop: yellow or red                 |

    That is the ground truth. With another `bev_source`, the policy sees what the source makes of
    the cameras, and nothing else: images of `front`, `left`, `right`, `rear`, nominal intrinsics
    and extrinsics (`camera_from_ego`), the route map and the measurements (`SensorFrame`). The
    route map shows the next five points of the sparse plan (junction entries and exits, else at
    most 50 m apart) as discs of 4 m, displaced by the error of a GPS; where the way to the first
    one out of view crosses the border, a disc of half the brightness.

    ## Rewards
    The sum of five terms, also in `info["reward_terms"]`. Weights by `reward={...}`.

    | Term          | Value per step                                                 | Weight |
    |---------------|----------------------------------------------------------------|--------|
    | `progress`    | new route metres over those of cruising, at most 1             | 1.0    |
    | `lateral`     | -min(distance to the side of the lane centre / 3.5 m, 1)       | 0.5    |
    | `heading`     | -abs(heading error) / pi                                       | 0.5    |
    | `comfort`     | -mean change of the two commands / 2                           | 0.1    |
    | `infractions` | -1 for each infraction that begins                             | 10.0   |

    ## Starting State
    Standing at the start of a route, on the lane centre. `reset(options=...)` chooses the route:

    | Options                                           | Route                                    |
    |---------------------------------------------------|------------------------------------------|
    | `{"episode": k}`                                  | episode 0 to 4, the paper's 1 to 5       |
    | `{"route": k}`                                    | long route 0 to 9                        |
    | `{"split": "val" or "test", "index": k}`          | route 0 to 49 of a split                 |
    | `{"start": (x, y), "goal": (x, y)}`               | shortest way; a third number: heading |
    | nothing                                           | random, 100 to 400 m, from the seed      |

    ## Episode End
    Terminated on success (99 % of the route and within 10 m of its end) or on an infraction in
    `terminate_on`. Truncated at the time limit.

    | Infraction             | When                                                              |
    |------------------------|-------------------------------------------------------------------|
    | `off_road`             | the centre, or a quarter of the footprint, leaves the pavement    |
    | `wrong_lane`           | more than 1 s in a lane against the car's heading, no junction    |
    | `route_deviation`      | more than 3.5 m from the planned lane centre                      |
    | `collision_vehicle`    | the footprint overlaps another vehicle's                          |
    | `collision_pedestrian` | the footprint overlaps a pedestrian's                             |
    | `collision_static`     | the footprint overlaps a building, tree, pole or other furniture  |
    | `red_light`            | the front bumper crosses a stop line while its signal is red      |
    | `blocked`              | slower than 0.1 m/s for 30 s with nothing to wait for             |

    There is something to wait for where, within 10 m of the front bumper, the other vehicles'
    rules ask to stop: a leader, a red or yellow signal, a junction that is not free, people on a
    crossing. Touching the same kind of thing again within 2 s is still the same collision.

    ## Info
    Every reset and step: `route_m` (route metres driven), `route_length_m`, `infractions` (names of
    those that began in this step), `success`, `lateral_error_m` (positive to the right),
    `episode_id`; every step also `reward_terms`; at the end also `episode_summary` (but not where
    `gym.make(..., max_episode_steps=n)` cuts an episode from outside): `episode_id`, `route_m`,
    `route_length_m`, `success`, `truncated`, `steps`, `time_s`, `return`, `travelled_m` (metres
    driven), `outside_m` (of them off the road or against the lane), and `infractions`, a list of
    dicts with `name`, `time_s`, `x`, `y`, `heading`, `speed_mps`, `route_m`, `actor` (such as
    `"vehicle 12"`, or `""`) and `fault` (`"ego"`, `"other"`, or `""` where it cannot be told).

    ## Arguments
    ```python
    import gymnasium as gym
    import bev_driving_env

    env = gym.make("BEVTown01-v0", max_speed_mps=6.0)
    ```

    | Keyword          | Default          | Meaning                                               |
    |------------------|------------------|-------------------------------------------------------|
    | `town`           | from the id      | name of a registered town, or `module:name`           |
    | `render_mode`    | `None`           | `"rgb_array"` or `"human"`: map, BEVs, cameras        |
    | `bev_source`     | `"ground_truth"` | what the policy sees; see below                       |
    | `traffic`        | `"none"`         | `"light"`, `"dense"`, or a dict of numbers; see below |
    | `traffic_lights` | `False`          | working signals at every junction that has them       |
    | `appearance`     | `"train"`        | look of the world: also `"test"`, `"hard"`, or an int |
    | `cameras`        | `False`          | also observe `cameras` and `route_map`                |
    | `camera_size`    | `(112, 240)`     | height, width of images; (224, 480) in the paper      |
    | `camera_motion`  | `True`           | the cameras move a little against the nominal rig     |
    | `camera_rig`     | four on the roof | sequence of `cameras.rig.Camera`                      |
    | `terminate_on`   | all              | names of the infractions that end an episode          |
    | `max_speed_mps`  | `6.0`            | cruising speed that the reward and the expert aim for |
    | `time_limit_s`   | `None`           | seconds to truncation; None: 30 + 0.8 a route metre   |
    | `bev`            | 192, 5.0, 152    | dict of `size`, `px_per_m`, `ego_row`; `BEVGeometry`  |
    | `vehicle`        | see below        | dict of fields, or `world.config.VehicleModel`        |
    | `rules`          | see below        | dict of fields, or `world.config.Rules`               |
    | `reward`         | see above        | dict of weights, or `world.config.RewardWeights`      |

    Fields and defaults of `vehicle`: `length_m` 5, `width_m` 2, `max_acceleration_mps2` 5,
    `max_steering_rad` 1.22, `speed_limit_mps` 40. Of `rules`: `deviation_m` 3.5, `wrong_lane_s` 1,
    `blocked_s` 30, `blocked_mps` 0.1, `success_fraction` 0.99, `success_distance_m` 10.

    `bev_source` is `"ground_truth"`, `"ipm"` (projected cameras and colours, no learning), a name
    given to `register_bev_source`, `"module:factory"`, the path of a checkpoint, a `BEVSource`
    object, or a dict per channel such as `{"route": "ground_truth", "default": "ipm"}`. Channels
    that a source does not predict are 0.

    `traffic` is `"none"`, `"light"`, `"dense"`, or `{"vehicles": 30, "pedestrians": 20}`. The
    presets are NoCrash's empty, regular and dense: 20 vehicles and 50 pedestrians, or 100 and 250,
    in Town01; 15 and 50, or 70 and 150, in Town02; as many per metre of road elsewhere. Vehicles
    follow the Intelligent Driver Model along the lanes, give way at junctions and stop for
    signals, people and the ego. Pedestrians walk on the sidewalks and cross at junctions and now
    and then between them; they step on to the road only where nobody would have to brake hard.
    With `traffic_lights` one approach of a junction after the other has green for 10 s.

    Each episode draws its look from the set `appearance`: `"train"`; `"test"` with other palettes,
    weather and light; `"hard"` with night, fog, low sun, dirty lenses and more to hide behind.
    `"hard:night"` and the like keep to one condition of weather and light. An int is the seed of
    one look of `"train"` for all episodes. With `camera_motion` the body pitches and rolls by up
    to 2 degrees and each camera is mounted a little wrongly; sources are told the nominal rig all
    the same.

    ## Beyond Gymnasium
    On `env.unwrapped`: `ground_truth_bev()`, `sensor_frame()`, `snapshot()` and `restore(s)`,
    `draw()`, `ego_pose` (x, y, heading), `vehicle_states` (n, 6), `route` (its `points`,
    `length_m`, `turns`).

    Raises:
        ValueError: A value is not valid; the message names it and the valid ones.
        TypeError: A keyword does not exist.
        BEVSourceError: In `reset` or `step`: a BEV source failed, or returned no BEV.

    ## Version History
    * v0: ground-truth BEV, cameras, BEV sources, traffic.
    """

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
        compiled = compiled_town(town)
        config = self.settings.world_config(compiled)
        self.world = World(compiled, config)
        self.sensors = Sensors(self.world, self.settings.camera_settings())
        self.policy_view = PolicyView(self.settings.bev_source, 1, config.bev)
        self.action_space = action_space()
        if self.settings.cameras or self.policy_view.needs_frame:
            self.sensors.prepare()
        images = self.sensors.settings.rig.shape if self.settings.cameras else None
        self.observation_space = observation_space(config.bev, config.top_speed_mps, images=images)
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
        self._restart_view()
        observation = self._observe()
        if self.render_mode == "human":
            self.render()
        return observation, step_info(self.world, 0)

    def _restart_view(self) -> None:
        self.policy_view.reset(0, int(self.world.state.episode_seed[0]))

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for a tenth of a second.

        Raises:
            ValueError: The action is not two finite numbers.
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        self._require_reset("step()")
        world = self.world
        world.step(checked_actions(action, (2,))[None])
        terminated = bool(world.terminated()[0])
        truncated = bool(world.truncated()[0])
        info = step_info(world, 0)
        info["reward_terms"] = reward_terms(world, 0)
        if terminated or truncated:
            info["episode_summary"] = episode_summary(world, 0)
        observation = self._observe()
        if self.render_mode == "human":
            self.render()
        return observation, float(world.rewards[0]), terminated, truncated, info

    def _require_reset(self, what: str) -> None:
        if not self._placed:
            raise gym.error.ResetNeeded(f"call reset() before {what}")

    def _observe(self, bev: NDArray[np.uint8] | None = None) -> Observation:
        """What the policy is given now; a BEV that is known already is not asked for again."""
        frame = None
        if self.settings.cameras or (bev is None and self.policy_view.needs_frame):
            frame = self.sensors.frame(0)
        observation: Observation = {}
        if self.settings.cameras:
            assert frame is not None
            # a copy if a source gets the frame: what it does to it must not reach the policy
            seen = frame.copy() if self.policy_view.needs_frame else frame
            observation["cameras"], observation["route_map"] = seen.images, seen.route_map
        observation["bev"] = self._policy_bev(frame) if bev is None else bev
        observation["measurements"] = self.sensors.measurements()[0]
        return observation

    def _policy_bev(self, frame: SensorFrame | None) -> NDArray[np.uint8]:
        view = self.policy_view
        if view.is_truth:
            return self.ground_truth_bev()
        truth = self.ground_truth_bev()[None] if view.needs_truth else None

        def frame_of(_: int) -> SensorFrame:
            assert frame is not None
            return frame

        return view.observe([0], frame_of, truth)[0]

    def ground_truth_bev(self) -> NDArray[np.uint8]:
        """The true BEV (6, size, size) uint8 of this moment, newly made."""
        self._require_reset("ground_truth_bev()")
        bev = np.empty((1, *self.world.bev_shape), np.uint8)
        self.world.render(bev)
        return bev[0]

    def sensor_frame(self) -> SensorFrame:
        """What the car senses at this moment: all that a predictor is given.

        Raises:
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        self._require_reset("sensor_frame()")
        return self.sensors.frame(0)

    @property
    def ego_pose(self) -> tuple[float, float, float]:
        """World x, y (metres) and heading (radians) of the ego's centre."""
        self._require_reset("ego_pose")
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
        self._require_reset("route")
        route = self.world.routes[0]
        assert route is not None
        return route

    def snapshot(self) -> EnvSnapshot:
        """Copy the state of the world, random generator included, and of the BEV sources.

        Raises:
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        self._require_reset("snapshot()")
        view = None if self.policy_view.is_truth else self.policy_view.snapshot()
        return EnvSnapshot(**vars(self.world.snapshot()), policy_view=view)

    def restore(self, snapshot: WorldSnapshot) -> Observation:
        """Go back to a snapshot and return the observation there.

        Gymnasium's wrappers know nothing of it: a fresh ``gym.make`` environment wants ``reset``
        once before, and ``TimeLimit`` goes on counting (use ``time_limit_s`` instead). A snapshot
        taken with another ``bev_source`` can be restored too: its sources start anew here.

        Raises:
            TypeError: It is not a snapshot of a ``BEVTownEnv``.
            ValueError: The snapshot is of another town, configuration or number of worlds.
        """
        self.world.restore(snapshot)
        self._np_random = self.world.rngs[0]
        self._placed = True
        if self.policy_view.restore(getattr(snapshot, "policy_view", None)):
            return self._observe(self.policy_view.last()[0])
        self._restart_view()
        return self._observe()

    def draw(self) -> NDArray[np.uint8]:
        """Draw map, cameras, route map, the policy's BEV and the true one: RGB (H, W, 3).

        Raises:
            gymnasium.error.ResetNeeded: ``reset`` was never called.
        """
        self._require_reset("draw()")
        from .render import draw_panel

        bev = self.ground_truth_bev() if self.policy_view.is_truth else self.policy_view.last()[0]
        return draw_panel(self.sensors, 0, bev)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of ``draw()``, or the same in a window for ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array" or "human")')
            return None
        self._require_reset("render()")
        frame = self.draw()
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            from .window import Window

            self._window = Window(f"BEVTown: {self.world.town.name}", self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def pressed_keys(self) -> set[str]:
        """Names of the keys held down in the window of ``render_mode="human"``.

        Raises:
            RuntimeError: There is no window yet: nothing has been rendered, or not for a person.
        """
        if self._window is None:
            raise RuntimeError('pressed_keys() needs render_mode="human" and a first reset()')
        pressed: set[str] = self._window.pressed()
        return pressed

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None
