"""The keywords of ``gym.make``, validated in one place for both environments."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from .cameras.look import APPEARANCES, check_appearance
from .cameras.renderer import CameraSettings
from .cameras.rig import CAMERA_SIZE, SURROUND, Camera, CameraRig
from .checks import configured, is_int, require_positive
from .frames import BEVGeometry
from .sources.policy_view import channel_specs
from .world.config import RewardWeights, Rules, VehicleModel, WorldConfig
from .world.infractions import INFRACTIONS
from .world.traffic import Traffic, check_traffic, traffic_config

if TYPE_CHECKING:
    from .towns.compiled import CompiledTown


@dataclass(frozen=True)
class EnvSettings:
    """Keywords of the environments; the table in ``BEVTownEnv`` explains them.

    Attributes:
        bev_source: What the policy sees: a name, checkpoint path or object, or a dict per channel.
        traffic: Other road users: a preset, or a mapping of numbers.
        traffic_lights: Working signals.
        appearance: Look of the world for the cameras.
        cameras: Whether camera images are observed.
        camera_size: Height and width of each image.
        camera_motion: Whether the body pitches and rolls and the mounting is a little off.
        camera_rig: The cameras, in the order of the images.
        terminate_on: Infractions that end the episode; None for all.
        max_speed_mps: Cruising speed of the expert and the reward.
        time_limit_s: Simulated seconds until truncation; None for 30 s plus 0.8 s a route metre.
        bev: BEV geometry, or a mapping of its fields.
        vehicle: The ego car, or a mapping of its fields.
        rules: Infraction thresholds, or a mapping of its fields.
        reward: Reward weights, or a mapping of its fields.
    """

    bev_source: Any = "ground_truth"
    traffic: Traffic = "none"
    traffic_lights: bool = False
    appearance: str | int = "train"
    cameras: bool = False
    camera_size: tuple[int, int] = CAMERA_SIZE
    camera_motion: bool = True
    camera_rig: Sequence[Camera] = SURROUND
    terminate_on: Collection[str] | None = None
    max_speed_mps: float = 6.0
    time_limit_s: float | None = None
    bev: BEVGeometry | Mapping[str, Any] = field(default_factory=BEVGeometry)
    vehicle: VehicleModel | Mapping[str, Any] = field(default_factory=VehicleModel)
    rules: Rules | Mapping[str, Any] = field(default_factory=Rules)
    reward: RewardWeights | Mapping[str, Any] = field(default_factory=RewardWeights)

    @classmethod
    def from_keywords(cls, keywords: Mapping[str, Any]) -> EnvSettings:
        """Build settings from keyword arguments.

        Raises:
            TypeError: A keyword does not exist; the message suggests the nearest.
            ValueError: A value is not valid; the message names it and the valid ones.
        """
        names = [item.name for item in fields(cls)]
        for keyword in keywords:
            if keyword not in names:
                close = get_close_matches(keyword, names, 1)
                hint = f"; did you mean {close[0]!r}?" if close else ""
                # worded as Python words it: TorchRL looks for this text
                raise TypeError(
                    f"got an unexpected keyword argument {keyword!r}{hint} "
                    f"(keywords: town, render_mode, {', '.join(names)})"
                )
        return cls(**keywords)

    def __post_init__(self) -> None:
        channel_specs(self.bev_source)
        check_traffic(self.traffic)
        if not isinstance(self.traffic_lights, bool):
            raise ValueError(f"traffic_lights must be True or False, got {self.traffic_lights!r}")
        self._check_cameras()
        require_positive("max_speed_mps", self.max_speed_mps)
        names = self.terminate_on
        if isinstance(names, str) or not (names is None or isinstance(names, Collection)):
            raise ValueError(
                f"terminate_on must be a collection of infractions, got {names!r}; "
                f"name them as in ('off_road', 'blocked'), of: {', '.join(INFRACTIONS)}"
            )

    def _check_cameras(self) -> None:
        if isinstance(self.appearance, str):
            check_appearance(self.appearance)
        elif not (is_int(self.appearance) and int(self.appearance) >= 0):
            raise ValueError(
                f"appearance must be an int seed of at least 0 or one of {', '.join(APPEARANCES)}, "
                f"got {self.appearance!r}"
            )
        for name in ("cameras", "camera_motion"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} must be True or False, got {getattr(self, name)!r}")
        self.camera_settings()

    def camera_settings(self) -> CameraSettings:
        """How the cameras see, as these settings ask for."""
        appearance = self.appearance
        return CameraSettings(
            rig=CameraRig(self.camera_rig, self.camera_size),
            appearance=appearance if isinstance(appearance, str) else int(appearance),
            motion=self.camera_motion,
        )

    def world_config(self, town: CompiledTown) -> WorldConfig:
        """The configuration of the world core that these settings ask for in a town."""
        return WorldConfig(
            cruise_speed_mps=self.max_speed_mps,
            terminate_on=tuple(INFRACTIONS if self.terminate_on is None else self.terminate_on),
            time_limit_s=self.time_limit_s,
            dense_furniture=self.camera_settings().set_name == "hard",
            traffic=traffic_config(self.traffic, self.traffic_lights, town),
            vehicle=configured(VehicleModel, self.vehicle),
            rules=configured(Rules, self.rules),
            reward=configured(RewardWeights, self.reward),
            bev=configured(BEVGeometry, self.bev),
        )
