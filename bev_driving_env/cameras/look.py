"""``Look``: one episode's appearance, drawn from a set and a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .conditions import HARD_CONDITIONS, TEST_CONDITIONS, TRAIN_CONDITIONS, Condition
from .palettes import (
    CAR_PAINTS,
    JITTER,
    TEST_CAR_PAINTS,
    TEST_PALETTES,
    TRAIN_PALETTES,
    Palette,
    paint_table,
)

APPEARANCES = ("train", "test", "hard")
_CONDITIONS = {"train": TRAIN_CONDITIONS, "test": TEST_CONDITIONS, "hard": HARD_CONDITIONS}
_SINGLE = {
    "train": TRAIN_CONDITIONS,
    "test": (*TRAIN_CONDITIONS, *TEST_CONDITIONS),
    "hard": (*TRAIN_CONDITIONS, *HARD_CONDITIONS),
}
"""What may be asked for by name. Held-out conditions are in no appearance of ``"train"``."""
MOUNT_SIGMA_DEG, MOUNT_MOST_DEG = 0.25, 0.7
MOUNT_SIGMA_M, MOUNT_MOST_M = 0.008, 0.02
EXPOSURE = (0.88, 1.12)
CAMERA_EXPOSURE = (0.95, 1.05)
BALANCE = 0.03


@dataclass(frozen=True, eq=False)
class Look:
    """Everything about an episode's appearance, as numbers.

    Attributes:
        appearance: The appearance it was drawn from.
        seed: The seed it was drawn with.
        condition: Weather and light.
        palette: Colours of the place.
        ground: (8, 3) ground colours, jittered.
        paints: (slots, 3) colours of upright things, jittered.
        sun_azimuth_rad: Direction of the sun, as a world heading.
        sun_elevation_rad: Its height.
        sun: See ``Condition``; likewise the next six.
        ambient: See there.
        sight_m: See there.
        clouds: See there.
        wetness: See there.
        noise: See there.
        blur_px: See there.
        exposure: (cameras,) brightness of each camera.
        balance: (cameras, 3) white balance of each camera.
        dirty: Whether there is dirt on the lenses.
        mount_deg: (cameras, 3) mounting error: yaw, pitch, roll.
        mount_m: (cameras, 3) mounting error: forward, left, up.
    """

    appearance: str
    seed: int
    condition: Condition
    palette: Palette
    ground: NDArray[np.float64]
    paints: NDArray[np.float64]
    sun_azimuth_rad: float
    sun_elevation_rad: float
    sun: float
    ambient: float
    sight_m: float
    clouds: float
    wetness: float
    noise: float
    blur_px: float
    exposure: NDArray[np.float64]
    balance: NDArray[np.float64]
    dirty: bool
    mount_deg: NDArray[np.float64]
    mount_m: NDArray[np.float64]

    @property
    def name(self) -> str:
        """Condition and palette, such as ``"wet harbour"``."""
        return f"{self.condition.name} {self.palette.name}"

    @property
    def sun_direction(self) -> NDArray[np.float64]:
        """Unit vector (3,) towards the sun: world x, y, and up."""
        level = np.cos(self.sun_elevation_rad)
        return np.array(
            [
                level * np.cos(self.sun_azimuth_rad),
                level * np.sin(self.sun_azimuth_rad),
                np.sin(self.sun_elevation_rad),
            ]
        )


def appearance_set(appearance: str) -> str:
    """The set that an appearance belongs to.

    >>> appearance_set("hard:low_sun")
    'hard'
    """
    return appearance.partition(":")[0]


def single_appearances(name: str) -> dict[str, Condition]:
    """The appearances of a set that have one condition each: all else is drawn as for the set.

    >>> list(single_appearances("train"))
    ['train:clear', 'train:overcast', 'train:wet']
    """
    return {f"{name}:{each.name.replace(' ', '_')}": each for each in _SINGLE[name]}


def check_appearance(appearance: object) -> None:
    """Refuse what is not the name of an appearance.

    Raises:
        ValueError: There is no such appearance; the message lists those there are.
    """
    if isinstance(appearance, str) and appearance in APPEARANCES:
        return
    name = appearance_set(appearance) if isinstance(appearance, str) else ""
    if name not in APPEARANCES:
        raise ValueError(
            f"appearance must be one of {', '.join(APPEARANCES)}, got {appearance!r} (a condition "
            "goes behind, as in 'hard:night')"
        )
    known = single_appearances(name)
    if appearance not in known:
        raise ValueError(
            f"appearance {appearance!r} has no such condition; those of {name!r}: "
            f"{', '.join(known)}"
        )


def draw_look(
    appearance: str,
    seed: int,
    cameras: int = 4,
    *,
    condition: Condition | None = None,
    palette: Palette | None = None,
) -> Look:
    """Draw a look; the same arguments give the same look in every process.

    Args:
        appearance: ``"train"``, ``"test"`` or ``"hard"``, or one of these with a single condition,
            as in ``"hard:night"``. The same seed then has the same palette, paints and mounting.
        seed: Any int of at least 0.
        cameras: Number of cameras.
        condition: Instead of one drawn from the set.
        palette: Likewise.

    Raises:
        ValueError: There is no such appearance.
    """
    check_appearance(appearance)
    name = appearance_set(appearance)
    condition = condition or single_appearances(name).get(appearance)
    rng = np.random.default_rng([seed, APPEARANCES.index(name)])
    conditions = _CONDITIONS[name]
    palettes = TRAIN_PALETTES if name == "train" else TEST_PALETTES
    drawn_condition = conditions[rng.integers(len(conditions))]
    drawn_palette = palettes[rng.integers(len(palettes))]
    weather, place = condition or drawn_condition, palette or drawn_palette
    car_paints = CAR_PAINTS if name == "train" else TEST_CAR_PAINTS
    ground = place.ground_array() + rng.uniform(-JITTER, JITTER, (8, 3))
    paints = paint_table(place, car_paints)
    paints *= rng.uniform(0.92, 1.08, paints.shape)
    mount_deg = rng.normal(0.0, MOUNT_SIGMA_DEG, (cameras, 3))
    mount_m = rng.normal(0.0, MOUNT_SIGMA_M, (cameras, 3))
    return Look(
        appearance=appearance,
        seed=seed,
        condition=weather,
        palette=place,
        ground=ground,
        paints=np.clip(paints, 0.0, 255.0),
        sun_azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
        sun_elevation_rad=float(np.radians(rng.uniform(*weather.sun_elevation_deg))),
        sun=float(rng.uniform(*weather.sun)),
        ambient=float(rng.uniform(*weather.ambient)),
        sight_m=float(rng.uniform(*weather.sight_m)),
        clouds=float(rng.uniform(*weather.clouds)),
        wetness=float(rng.uniform(*weather.wetness)),
        noise=float(rng.uniform(*weather.noise)),
        blur_px=float(rng.uniform(*weather.blur_px)),
        exposure=rng.uniform(*EXPOSURE) * rng.uniform(*CAMERA_EXPOSURE, cameras),
        balance=rng.uniform(1.0 - BALANCE, 1.0 + BALANCE, (cameras, 3)),
        dirty=name == "hard",
        mount_deg=np.clip(mount_deg, -MOUNT_MOST_DEG, MOUNT_MOST_DEG),
        mount_m=np.clip(mount_m, -MOUNT_MOST_M, MOUNT_MOST_M),
    )
