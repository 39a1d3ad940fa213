"""How traffic flows: contacts, standstills, and vehicles through each junction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bev_driving_env.kernels.contacts import count_contacts
from bev_driving_env.kernels.layout import DISTANCE, LAST_RAIL, RAIL, SPEED
from bev_driving_env.kernels.walks import MODE, ON_CROSSING
from bev_driving_env.towns.registry import compiled_town
from bev_driving_env.towns.route import random_route
from bev_driving_env.world.config import WorldConfig
from bev_driving_env.world.core import World
from bev_driving_env.world.traffic import Traffic, traffic_config

STANDING_MPS = 0.1
FAR_M = 1e5


@dataclass(frozen=True)
class TrafficFlow:
    """What some minutes of a town's traffic came to, with no ego in it.

    Attributes:
        town: Name of the town.
        lights: Whether its signals worked.
        seed: Seed of the episode.
        vehicles: Number of vehicles.
        pedestrians: Number of pedestrians.
        minutes: Simulated minutes.
        contacts: Pairs of footprints that overlapped, summed over steps.
        longest_stand_s: Longest time that any vehicle stood still.
        longest_wait_s: Longest time that any pedestrian stood still.
        mean_speed_mps: Mean speed of all vehicles.
        crossings_per_minute: Crossings of a road by pedestrians.
        per_hour: Vehicles through each junction, per hour.
    """

    town: str
    lights: bool
    seed: int
    vehicles: int
    pedestrians: int
    minutes: float
    contacts: int
    longest_stand_s: float
    longest_wait_s: float
    mean_speed_mps: float
    crossings_per_minute: float
    per_hour: Mapping[str, float]


def measure_flow(
    town: str, traffic: Traffic, *, lights: bool, seed: int, minutes: float
) -> TrafficFlow:
    """Let a town's traffic run without an ego and watch it.

    Args:
        town: Name of a registered town.
        traffic: As the environments' keyword.
        lights: Whether the signals work.
        seed: Seed of the episode.
        minutes: Simulated minutes.
    """
    compiled = compiled_town(town)
    config = WorldConfig(traffic=traffic_config(traffic, lights, compiled))
    world = World(compiled, config)
    world.rngs[0] = np.random.default_rng(seed)
    world.place(0, random_route(compiled, world.rngs[0], 100.0, 400.0))
    network = compiled.traffic(dense=config.dense_furniture).network
    state, step_s = world.state, config.step_s
    # out of everybody's way, and off its route
    state.ego[0, :2] = -FAR_M
    state.progress[0, DISTANCE] = FAR_M
    vehicles, people = state.vehicles[0], state.pedestrians[0]
    stood, longest_stood = np.zeros(len(vehicles)), np.zeros(len(vehicles))
    waited, longest_waited = np.zeros(len(people)), np.zeros(len(people))
    passed = np.zeros(len(network.junctions), np.int64)
    steps = round(60.0 * minutes / step_s)
    contacts = crossings = 0
    speeds = 0.0
    for _ in range(steps):
        rails = state.vehicle_track[0, :, RAIL].copy()
        crossing = state.pedestrian_track[0, :, MODE] == ON_CROSSING
        world.step_traffic()
        state.steps += 1
        contacts += count_contacts(vehicles, vehicles, True)
        contacts += count_contacts(vehicles, people, False) + count_contacts(people, people, True)
        moved = state.vehicle_track[0, :, RAIL] != rails
        left = state.vehicle_track[0, moved, LAST_RAIL]
        left = left[network.tables.movement[left]]
        np.add.at(passed, network.junction[left], 1)
        crossings += int((~crossing & (state.pedestrian_track[0, :, MODE] == ON_CROSSING)).sum())
        stood = np.where(vehicles[:, SPEED] < STANDING_MPS, stood + step_s, 0.0)
        waited = np.where(people[:, SPEED] < STANDING_MPS, waited + step_s, 0.0)
        longest_stood, longest_waited = (
            np.maximum(longest_stood, stood),
            np.maximum(longest_waited, waited),
        )
        speeds += float(vehicles[:, SPEED].mean()) if len(vehicles) else 0.0
    return TrafficFlow(
        town=town,
        lights=lights,
        seed=seed,
        vehicles=len(vehicles),
        pedestrians=len(people),
        minutes=minutes,
        contacts=contacts,
        longest_stand_s=float(longest_stood.max(initial=0.0)),
        longest_wait_s=float(longest_waited.max(initial=0.0)),
        mean_speed_mps=speeds / steps,
        crossings_per_minute=crossings / minutes,
        per_hour={
            name: 60.0 * count / minutes
            for name, count in zip(network.junctions, passed.tolist(), strict=True)
        },
    )
