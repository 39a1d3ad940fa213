"""Column names of the world's state arrays, shared by the kernels and by Python."""

from __future__ import annotations

from typing import NamedTuple

# ego (N, 4), and the first columns of every actor row
X, Y, HEADING, SPEED = 0, 1, 2, 3
EGO_COLUMNS = 4

# vehicles (N, V, 6) and pedestrians (N, P, 6); a row of length 0 is an empty slot
LENGTH, WIDTH = 4, 5
ACTOR_COLUMNS = 6

# vehicle_track (N, V, 6): rail a vehicle is on, the two it goes on to, the one it came from, how
# often it has chosen a way, and whether it may enter the junction ahead
RAIL, NEXT_RAIL, AFTER_RAIL, LAST_RAIL, CHOICES, ADMITTED = range(6)
TRACK_COLUMNS = 6
# vehicle_motion (N, V, 3): metres of its centre along the rail, the speed it would like to drive,
# and how long it has been waiting at a stop line
STATION, WANTED_MPS, WAITED_S = range(3)
MOTION_COLUMNS = 3

# command (N, 2): what the driver asked for in [-1, 1]
ACCELERATION, STEERING = 0, 1

# route_points (N, R, 4): position and unit direction of the planned lane centre
DIRECTION_X, DIRECTION_Y = 2, 3
ROUTE_COLUMNS = 4

# progress (N, 5)
ROUTE_POSITION, ROUTE_DONE, LATERAL, HEADING_ERROR, DISTANCE = 0, 1, 2, 3, 4
PROGRESS_COLUMNS = 5

# attitude (N, 2): radians, nose down and right side down
PITCH, ROLL = 0, 1

# timers (N, 6): seconds in an opposing lane, standing, standing with nothing to wait for, and, for
# each kind of collision, how much longer a contact counts as the last one
WRONG_LANE_S, STOPPED_S, BLOCKED_S, VEHICLE_HOLD_S, PEDESTRIAN_HOLD_S, STATIC_HOLD_S = range(6)
TIMERS = 6

# travelled (N, 2): metres driven, and of them off the road or against the lane's direction
TRAVELLED_M, OUTSIDE_M = range(2)
DISTANCES = 2

# involved (N, 3): number of the vehicle, pedestrian and signal of the last infraction with one
INVOLVED_VEHICLE, INVOLVED_PEDESTRIAN, INVOLVED_SIGNAL = range(3)
INVOLVED = 3

# signals (N, S)
SIGNAL_OFF, SIGNAL_GREEN, SIGNAL_YELLOW, SIGNAL_RED = 0, 1, 2, 3

# static raster: one bit per class
ROAD_BIT, LANE_BIT, SIDEWALK_BIT, JUNCTION_BIT = 1, 2, 4, 8
NO_LANE = 0
"""Lane-direction code off the lanes and inside junctions."""
DIRECTION_CODES = 255
"""Directions are stored as 1 + round(heading / 2 pi * 255) modulo 255."""

# infraction bits, in the order of the contract's table
(
    OFF_ROAD,
    WRONG_LANE,
    ROUTE_DEVIATION,
    COLLISION_VEHICLE,
    COLLISION_PEDESTRIAN,
    COLLISION_STATIC,
    RED_LIGHT,
    BLOCKED,
) = (1 << bit for bit in range(8))

# reward_terms (N, 5)
REWARD_PROGRESS, REWARD_LATERAL, REWARD_HEADING, REWARD_COMFORT, REWARD_INFRACTIONS = range(5)
REWARD_TERMS = 5


class Physics(NamedTuple):
    """Numbers the step kernel needs; built by ``WorldConfig.physics()``."""

    dt_s: float
    substeps: int
    half_length_m: float
    half_width_m: float
    max_acceleration_mps2: float
    max_steering_rad: float
    speed_limit_mps: float
    cruise_speed_mps: float
    deviation_m: float
    wrong_lane_after_s: float
    blocked_after_s: float
    blocked_speed_mps: float
    success_fraction: float
    success_distance_m: float
    reward_progress: float
    reward_lateral: float
    reward_heading: float
    reward_comfort: float
    reward_infraction: float


class RasterGrid(NamedTuple):
    """Where a raster lies in the world: pixel (r, c) covers x0 + [c, c + 1) / px_per_m."""

    x0_m: float
    y0_m: float
    px_per_m: float


class Pose(NamedTuple):
    """A place and a direction in the world frame."""

    x: float
    y: float
    cos: float
    sin: float


class Window(NamedTuple):
    """The BEV window in pixels; built from ``BEVGeometry``."""

    size: int
    ego_row: int
    ego_column: int
    px_per_m: float
    route_ahead_m: float
    route_half_width_m: float
    pedestrian_half_extent_m: float
    stop_line_half_px: float
