"""Conditions: weather and light. Those of ``test`` and ``hard`` do not occur in ``train``."""

from __future__ import annotations

from dataclasses import dataclass

Range = tuple[float, float]
Tint = tuple[float, float, float]


@dataclass(frozen=True)
class Condition:
    """Weather and light, with the ranges that an episode's are drawn from.

    Attributes:
        name: What it is called.
        sun_elevation_deg: Height of the sun.
        sun: Brightness of a surface that faces the sun; 0 casts no shadows.
        ambient: Brightness of a surface in the shade.
        sun_tint: Colour of the sun's light.
        ambient_tint: Colour of the sky's light.
        sight_m: Distance at which haze has taken 63 % of the contrast.
        haze_rgb: Colour of haze and horizon.
        zenith_rgb: Colour of the sky overhead.
        clouds: Share of the sky under clouds.
        cloud_rgb: Their colour.
        wetness: How much wet asphalt darkens and mirrors.
        headlights: Strength of the ego's headlights.
        lit_windows: Share of windows with light behind them.
        glare: How much a sun in the picture veils it.
        noise: Standard deviation of the sensor noise, in grey levels of 255.
        blur_px: Standard deviation of the lens blur on images of 240 columns.
    """

    name: str
    sun_elevation_deg: Range
    sun: Range
    ambient: Range
    sun_tint: Tint
    ambient_tint: Tint
    sight_m: Range
    haze_rgb: Tint
    zenith_rgb: Tint
    clouds: Range
    cloud_rgb: Tint
    wetness: Range = (0.0, 0.0)
    headlights: float = 0.0
    lit_windows: float = 0.0
    glare: float = 0.0
    noise: Range = (1.5, 3.0)
    blur_px: Range = (0.0, 0.4)


CLEAR = Condition(
    "clear",
    sun_elevation_deg=(30.0, 65.0),
    sun=(0.55, 0.8),
    ambient=(0.42, 0.55),
    sun_tint=(1.0, 0.97, 0.9),
    ambient_tint=(0.94, 0.99, 1.08),
    sight_m=(700.0, 1500.0),
    haze_rgb=(204.0, 218.0, 232.0),
    zenith_rgb=(84.0, 136.0, 206.0),
    clouds=(0.0, 0.45),
    cloud_rgb=(244.0, 246.0, 250.0),
)
OVERCAST = Condition(
    "overcast",
    sun_elevation_deg=(35.0, 65.0),
    sun=(0.0, 0.0),
    ambient=(0.8, 1.0),
    sun_tint=(1.0, 1.0, 1.0),
    ambient_tint=(0.98, 1.0, 1.02),
    sight_m=(300.0, 900.0),
    haze_rgb=(206.0, 210.0, 214.0),
    zenith_rgb=(164.0, 170.0, 178.0),
    clouds=(0.5, 0.9),
    cloud_rgb=(190.0, 194.0, 200.0),
)
WET = Condition(
    "wet",
    sun_elevation_deg=(35.0, 65.0),
    sun=(0.0, 0.12),
    ambient=(0.66, 0.86),
    sun_tint=(1.0, 1.0, 1.0),
    ambient_tint=(0.96, 1.0, 1.04),
    sight_m=(180.0, 500.0),
    haze_rgb=(182.0, 188.0, 196.0),
    zenith_rgb=(140.0, 148.0, 160.0),
    clouds=(0.6, 1.0),
    cloud_rgb=(158.0, 164.0, 172.0),
    wetness=(0.4, 0.85),
    noise=(2.0, 4.0),
    blur_px=(0.2, 0.6),
)
LIGHT_FOG = Condition(
    "light fog",
    sun_elevation_deg=(30.0, 60.0),
    sun=(0.0, 0.0),
    ambient=(0.82, 1.0),
    sun_tint=(1.0, 1.0, 1.0),
    ambient_tint=(1.0, 1.0, 1.0),
    sight_m=(60.0, 110.0),
    haze_rgb=(208.0, 211.0, 213.0),
    zenith_rgb=(198.0, 202.0, 206.0),
    clouds=(0.0, 0.0),
    cloud_rgb=(205.0, 208.0, 210.0),
    noise=(1.5, 3.5),
    blur_px=(0.3, 0.7),
)
DUSK = Condition(
    "dusk",
    sun_elevation_deg=(14.0, 24.0),
    sun=(0.35, 0.55),
    ambient=(0.3, 0.42),
    sun_tint=(1.12, 0.86, 0.6),
    ambient_tint=(0.94, 0.96, 1.16),
    sight_m=(250.0, 700.0),
    haze_rgb=(232.0, 188.0, 150.0),
    zenith_rgb=(92.0, 104.0, 154.0),
    clouds=(0.1, 0.5),
    cloud_rgb=(214.0, 168.0, 156.0),
    lit_windows=0.2,
    glare=0.12,
    noise=(2.5, 5.0),
    blur_px=(0.0, 0.5),
)
NIGHT = Condition(
    "night",
    sun_elevation_deg=(40.0, 60.0),
    sun=(0.0, 0.0),
    ambient=(0.13, 0.19),
    sun_tint=(1.0, 1.0, 1.0),
    ambient_tint=(0.92, 0.95, 1.2),
    sight_m=(300.0, 800.0),
    haze_rgb=(26.0, 28.0, 40.0),
    zenith_rgb=(10.0, 12.0, 24.0),
    clouds=(0.0, 0.4),
    cloud_rgb=(30.0, 30.0, 40.0),
    headlights=1.0,
    lit_windows=0.35,
    noise=(4.0, 7.0),
    blur_px=(0.2, 0.7),
)
DENSE_FOG = Condition(
    "dense fog",
    sun_elevation_deg=(30.0, 60.0),
    sun=(0.0, 0.0),
    ambient=(0.75, 0.95),
    sun_tint=(1.0, 1.0, 1.0),
    ambient_tint=(1.0, 1.0, 1.0),
    sight_m=(16.0, 30.0),
    haze_rgb=(196.0, 198.0, 200.0),
    zenith_rgb=(190.0, 192.0, 195.0),
    clouds=(0.0, 0.0),
    cloud_rgb=(196.0, 198.0, 200.0),
    wetness=(0.0, 0.3),
    noise=(2.0, 4.0),
    blur_px=(0.5, 1.0),
)
LOW_SUN = Condition(
    "low sun",
    sun_elevation_deg=(5.0, 10.0),
    sun=(0.7, 0.95),
    ambient=(0.3, 0.4),
    sun_tint=(1.12, 0.92, 0.7),
    ambient_tint=(0.94, 0.98, 1.12),
    sight_m=(250.0, 600.0),
    haze_rgb=(244.0, 216.0, 176.0),
    zenith_rgb=(118.0, 150.0, 200.0),
    clouds=(0.0, 0.3),
    cloud_rgb=(250.0, 220.0, 190.0),
    wetness=(0.0, 0.5),
    glare=0.6,
    noise=(1.5, 3.5),
)

TRAIN_CONDITIONS = (CLEAR, OVERCAST, WET)
TEST_CONDITIONS = (LIGHT_FOG, DUSK)
HARD_CONDITIONS = (*TEST_CONDITIONS, NIGHT, DENSE_FOG, LOW_SUN)
