"""All that traffic needs to know of a town: rails, sidewalks, crossings, and its signals' plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..kernels.signals import SignalPlan
from .rails import RailNetwork, build_rails
from .sidewalks import Sidewalks, build_sidewalks

if TYPE_CHECKING:
    from .compiled import CompiledTown

GREEN_S, YELLOW_S, ALL_RED_S = 10.0, 3.0, 2.0
"""CARLA's defaults."""


@dataclass(frozen=True, eq=False)
class TrafficMap:
    """Where traffic moves in a town.

    Attributes:
        network: The rails of its vehicles.
        sidewalks: The walks and crossings of its pedestrians.
        plan: How its signals take turns.
        no_plan: A plan without signals.
    """

    network: RailNetwork
    sidewalks: Sidewalks
    plan: SignalPlan
    no_plan: SignalPlan


def build_traffic_map(town: CompiledTown, *, dense: bool = False) -> TrafficMap:
    """Find out where traffic moves.

    Args:
        town: The town.
        dense: Whether its dense furniture stands on the sidewalks.
    """
    sidewalks = build_sidewalks(town, town.solids(dense=dense))
    return TrafficMap(
        network=build_rails(town, sidewalks.crossings.ends),
        sidewalks=sidewalks,
        plan=_signal_plan(town, len(town.signals)),
        no_plan=_signal_plan(town, 0),
    )


def _signal_plan(town: CompiledTown, count: int) -> SignalPlan:
    signals = town.signals[:count]
    names = list(dict.fromkeys(signal.junction for signal in signals))
    phases: dict[str, int] = {}
    for signal in signals:
        phases[signal.junction] = max(phases.get(signal.junction, 0), signal.phase + 1)

    def column(values: list[int]) -> NDArray[np.int64]:
        return np.array(values, np.int64)

    return SignalPlan(
        junction=column([names.index(signal.junction) for signal in signals]),
        phase=column([signal.phase for signal in signals]),
        phases=column([phases[signal.junction] for signal in signals]),
        green_s=GREEN_S,
        yellow_s=YELLOW_S,
        all_red_s=ALL_RED_S,
    )
