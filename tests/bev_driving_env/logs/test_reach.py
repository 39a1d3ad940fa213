"""Leaving out actors changes no picture."""

import numpy as np
import pytest

from bev_driving_env.cameras.conditions import LOW_SUN
from bev_driving_env.cameras.look import draw_look
from bev_driving_env.cameras.renderer import CameraRenderer, CameraSettings
from bev_driving_env.cameras.rig import SURROUND, Camera, CameraRig
from bev_driving_env.frames import BEVGeometry
from bev_driving_env.logs.reach import (
    PERSON_REACH_M,
    VEHICLE_REACH_M,
    require_bev_within,
    require_rig_within,
    within_sight,
)
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.world.state import WorldState

SIZE = (112, 240)


def crowd(kind, radii_m, towards):
    """State with actors around the ego at many distances in some directions."""
    places = [(r * np.cos(a), r * np.sin(a)) for r in radii_m for a in towards]
    count = len(places)
    state = WorldState.empty(1, **{kind: count}, signals=24)
    state.ego[0, :3] = 100.0, 105.0, 0.0
    table = getattr(state, kind)[0]
    table[:, :2] = state.ego[0, :2] + np.array(places)
    table[:, 4:] = (4.5, 1.9) if kind == "vehicles" else (0.6, 0.6)
    return state


def without_far(state):
    """The state as a log keeps it."""
    kept = state.copy()
    seen = within_sight(state.ego[0], state.vehicles[0], state.pedestrians[0])
    split = state.vehicles.shape[1]
    kept.vehicles[0, ~seen[:split]] = 0.0
    kept.pedestrians[0, ~seen[split:]] = 0.0
    return kept, seen


class OpenPlain(CameraRenderer):
    """Renders a town without buildings in the way."""

    def __init__(self, settings):
        super().__init__(compiled_town("Town02"), settings, (5.0, 2.0))
        empty = {name: getattr(self._scenery, name)[:1] * 0.0 - 1e4 for name in ("boxes", "gables")}
        self._scenery = self._scenery._replace(**empty)


@pytest.mark.parametrize(
    ("kind", "reach_m"), [("vehicles", VEHICLE_REACH_M), ("pedestrians", PERSON_REACH_M)]
)
def test_who_is_left_out_is_in_no_picture_even_in_the_lowest_sun(kind, reach_m):
    rig = CameraRig((*SURROUND[:1], Camera("ahead", x_m=4.9, z_m=1.5, pitch_deg=0.0)), SIZE)
    renderer = OpenPlain(CameraSettings(rig, "hard"))
    left_out = 0
    # one distance at a time, so that nobody hides anybody
    for radius_m in np.arange(reach_m - 16.0, reach_m + 20.0, 4.0):
        state = crowd(kind, [radius_m], np.radians(np.arange(-50, 51, 5)))
        kept, seen = without_far(state)
        left_out += int((~seen).sum())
        for seed in range(6):
            look = draw_look("hard", seed, 2, condition=LOW_SUN)
            whole = renderer.render(state, 0, look)
            np.testing.assert_array_equal(renderer.render(kept, 0, look), whole)
    assert left_out > 0


def test_a_person_whom_only_the_shadow_shows_is_kept():
    renderer = OpenPlain(CameraSettings(CameraRig(SURROUND[:1], SIZE), "hard"))
    # beyond the 60 m up to which people are drawn
    state = crowd("pedestrians", np.arange(66.0, 90.0, 2.0), np.radians(np.arange(-40, 41, 4)))
    nobody = state.copy()
    nobody.pedestrians[:] = 0.0
    looks = [draw_look("hard", seed, 1, condition=LOW_SUN) for seed in range(20)]
    assert any(
        (renderer.render(state, 0, look) != renderer.render(nobody, 0, look)).any()
        for look in looks
    )
    assert without_far(state)[1].all()


def test_empty_slots_are_never_kept():
    state = crowd("vehicles", [5.0], [0.0])
    state.vehicles[0, 0, 4] = 0.0
    assert not without_far(state)[1].any()


def test_a_long_vehicle_is_kept_from_farther_away():
    state = crowd("vehicles", [VEHICLE_REACH_M + 6.0], [0.0])
    assert not without_far(state)[1].any()
    state.vehicles[0, 0, 4] = 7.0
    assert without_far(state)[1].all()


def test_views_that_look_too_far_are_refused():
    require_bev_within(BEVGeometry())
    with pytest.raises(ValueError, match="192 pixels at 1 px/m"):
        require_bev_within(BEVGeometry(px_per_m=1.0))
    require_rig_within(CameraRig(SURROUND, SIZE))
    with pytest.raises(ValueError, match=r"'drone' sits 8\.0 m"):
        require_rig_within(CameraRig((Camera("drone", x_m=-8.0),), SIZE))
