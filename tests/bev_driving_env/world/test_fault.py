import math

import numpy as np
import pytest

from bev_driving_env.world.fault import pedestrian_fault, vehicle_fault

EGO_LENGTH_M = 5.0


def ego(speed, x=0.0, y=0.0, heading=0.0):
    return x, y, heading, speed


def car(x, y=0.0, heading=0.0, speed=0.0, length=4.0):
    return x, y, heading, speed, length, 1.8


def blame(one, other):
    return vehicle_fault(one, EGO_LENGTH_M, other)


@pytest.mark.parametrize("speed", [0.11, 1.0, 15.0])
@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi, -2.0])
def test_whoever_drives_into_a_standing_vehicle_is_at_fault_wherever_it_faces(speed, heading):
    assert blame(ego(speed), car(4.4, 0.3, heading)) == "ego"
    assert blame(ego(speed), car(0.5, 1.8, heading)) == "ego"


@pytest.mark.parametrize(("x", "y"), [(-4.4, 0.0), (4.4, 0.0), (0.0, 1.8), (0.0, -1.8)])
@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, math.pi])
def test_a_car_that_stands_is_never_at_fault_for_what_drives_into_it(x, y, heading):
    assert blame(ego(0.0), car(x, y, heading, 3.0)) == "other"
    assert blame(ego(0.09), car(x, y, heading, 0.2)) == "other"


def test_of_two_that_drive_the_same_way_the_one_behind_is_at_fault():
    assert blame(ego(6.0), car(4.4, speed=3.0)) == "ego"
    assert blame(ego(3.0), car(-4.4, speed=6.0)) == "other"


@pytest.mark.parametrize("turn", np.linspace(-math.pi, math.pi, 7))
@pytest.mark.parametrize("rounds", [-1, 0, 2])
def test_who_is_behind_depends_on_neither_the_world_axes_nor_full_turns(turn, rounds):
    cos, sin = math.cos(turn), math.sin(turn)
    heading = turn + 2.0 * math.pi * rounds
    ahead = car(10.0 + 4.4 * cos, -7.0 + 4.4 * sin, heading, 3.0)
    behind = car(10.0 - 4.4 * cos, -7.0 - 4.4 * sin, heading, 6.0)
    assert blame(ego(5.0, 10.0, -7.0, turn), ahead) == "ego"
    assert blame(ego(5.0, 10.0, -7.0, turn), behind) == "other"


@pytest.mark.parametrize(
    ("degrees", "fault"), [(44, "ego"), (-44, "ego"), (46, ""), (-46, ""), (180, "")]
)
def test_beyond_45_degrees_two_do_not_drive_the_same_way(degrees, fault):
    assert blame(ego(5.0), car(4.0, 0.5, math.radians(degrees), 5.0)) == fault


def test_side_by_side_it_cannot_be_told():
    assert blame(ego(5.0), car(0.0, 1.85, 0.05, 5.0)) == ""
    assert blame(ego(5.0), car(1.5, -1.85, -0.05, 4.0)) == ""
    # more than half of a mean length apart it is no longer the side that is hit
    assert blame(ego(5.0), car(2.3, -1.85, speed=4.0)) == "ego"
    assert blame(ego(5.0), car(-2.3, -1.85, speed=4.0)) == "other"


def test_head_on_and_crossing_it_cannot_be_told():
    assert blame(ego(5.0), car(4.4, 0.0, math.pi, 5.0)) == ""
    assert blame(ego(5.0), car(3.0, 0.0, 0.5 * math.pi, 5.0)) == ""


def test_where_both_have_stopped_the_ego_ran_into_the_other():
    assert blame(ego(0.0), car(4.4)) == "ego"


def test_a_pedestrian_is_at_fault_only_if_he_walks_into_a_car_that_stands():
    walking, standing = car(2.6, speed=1.2), car(2.6)
    assert pedestrian_fault(ego(0.0), walking) == "other"
    assert pedestrian_fault(ego(0.09), walking) == "other"
    assert pedestrian_fault(ego(0.0), standing) == "ego"
    assert pedestrian_fault(ego(0.11), walking) == "ego"
    assert pedestrian_fault(ego(8.0), walking) == "ego"
