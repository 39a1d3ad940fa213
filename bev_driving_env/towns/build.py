"""Building a ``TownNetwork`` of straight and circular lanes from a ``GridTown`` table.

Nodes are named ``<node>.<arm>.in`` (stop line, or start of a bend) and ``<node>.<arm>.out``. Each
junction movement has its own chain of lanes between them: straight to the start of the arc, the
arc, straight to the edge.
"""

from __future__ import annotations

import math

import numpy as np
from highway_env.road.lane import CircularLane, LineType, StraightLane
from numpy.typing import NDArray

from .grid import ARMS, GridTown, Junction
from .network import CrossSection, Signal, TownNetwork

ROAD_LINES = [LineType.STRIPED, LineType.CONTINUOUS]
NO_LINES = [LineType.NONE, LineType.NONE]
SHORTEST_LANE_M = 0.05

Vector = NDArray[np.float64]


def build_grid_town(town: GridTown) -> TownNetwork:
    """Build the road network of a town: links, corners, junctions with all movements, signals.

    Args:
        town: The table.

    Returns:
        A highway-env road network, drivable in every direction, without dead ends.

    Raises:
        ValueError: The table contradicts itself: a link does not run along the grid, or a node is
            neither a corner nor a junction.
    """
    return _Builder(town).build()


class _Builder:
    """Holds what every step of building one town needs."""

    def __init__(self, town: GridTown) -> None:
        self.town = town
        self.offset_m = town.lane_width_m / 2.0
        self.network = TownNetwork(CrossSection(town.shoulder_m, town.sidewalk_m))
        self.junctions = town.junction_table()
        self.corners = town.corner_table()

    def build(self) -> TownNetwork:
        for start, arm, end, other_arm in self.town.link_list():
            self._add_road(start, arm, end, other_arm)
            self._add_road(end, other_arm, start, arm)
        for name, radius in self.corners.items():
            arms = sorted({a for n, a in self._ends() if n == name})
            if len(arms) != 2:
                raise ValueError(f"corner {name} must join two roads, got arms {', '.join(arms)}")
            first, second = arms
            for arm_in, arm_out in ((first, second), (second, first)):
                self._add_movement(name, arm_in, arm_out, radius, ROAD_LINES)
        for name, junction in self.junctions.items():
            self._add_junction(name, junction)
        return self.network

    def _ends(self) -> list[tuple[str, str]]:
        links = self.town.link_list()
        return [(n, a) for n, a, _, _ in links] + [(n, a) for _, _, n, a in links]

    def _center(self, name: str) -> Vector:
        return np.array(self.town.node(name))

    def _turn_half_size(self, name: str, arm_in: str, arm_out: str) -> float:
        """Distance from the node at which the arc of a movement starts and ends."""
        wide_radius = self.town.wide_turns.get(f"{name} {arm_in}>{arm_out}")
        if wide_radius is None:
            return self.junctions[name].half_size_m
        return wide_radius + (self.offset_m if _turns_right(arm_in, arm_out) else -self.offset_m)

    def _edge(self, name: str, arm: str) -> float:
        """Distance from a node to the edge of its junction or the start of its bend."""
        if name in self.corners:
            return self.corners[name]
        if name not in self.junctions or arm not in self.junctions[name].arms:
            raise ValueError(f"node {name} has a road to its {arm} but is no corner or junction")
        arms = self.junctions[name].arms
        others = [other for other in arms if other != arm]
        starts = [self._turn_half_size(name, arm, other) for other in others]
        starts += [self._turn_half_size(name, other, arm) for other in others]
        return max(arms[arm].edge_m, *starts)

    def _point(self, name: str, arm: str, distance_m: float, inbound: bool) -> Vector:
        """Lane centre on an arm at a distance from the node, on the right-hand side."""
        outward = np.array(ARMS[arm], dtype=np.float64)
        travel = -outward if inbound else outward
        right = np.array([-travel[1], travel[0]])
        return self._center(name) + distance_m * outward + self.offset_m * right

    def _add_road(self, start: str, arm: str, end: str, other_arm: str) -> None:
        lane = StraightLane(
            self._point(start, arm, self._edge(start, arm), inbound=False),
            self._point(end, other_arm, self._edge(end, other_arm), inbound=True),
            width=self.town.lane_width_m,
            line_types=ROAD_LINES,
            speed_limit=self.town.speed_limit_mps,
        )
        self.network.add_lane(f"{start}.{arm}.out", f"{end}.{other_arm}.in", lane)

    def _add_junction(self, name: str, junction: Junction) -> None:
        roads = {arm for node, arm in self._ends() if node == name}
        for letter in junction.arms:
            if letter not in roads:
                raise ValueError(f"junction {name} has an arm {letter} but no road leads there")
        for arm_in in junction.arms:
            for arm_out in junction.arms:
                if arm_in != arm_out:
                    half_size = self._turn_half_size(name, arm_in, arm_out)
                    self._add_movement(name, arm_in, arm_out, half_size, NO_LINES)
        for phase, (letter, arm) in enumerate(junction.arms.items()):
            end = f"{name}.{letter}.in"
            start = next(node for node, targets in self.network.graph.items() if end in targets)
            self.network.signals.append(Signal((start, end, 0), *arm.signal, phase, name))

    def _add_movement(
        self, name: str, arm_in: str, arm_out: str, half_size_m: float, lines: list[int]
    ) -> None:
        """Add the lanes that lead from one arm of a node to another."""
        edge_in, edge_out = self._edge(name, arm_in), self._edge(name, arm_out)
        start = self._point(name, arm_in, edge_in, inbound=True)
        end = self._point(name, arm_out, edge_out, inbound=False)
        style = {
            "width": self.town.lane_width_m,
            "line_types": lines,
            "speed_limit": self.town.speed_limit_mps,
        }
        if np.array_equal(ARMS[arm_out], -np.array(ARMS[arm_in])):
            lanes = [StraightLane(start, end, **style)]
        else:
            arc_start = self._point(name, arm_in, half_size_m, inbound=True)
            arc_end = self._point(name, arm_out, half_size_m, inbound=False)
            lanes = []
            if edge_in - half_size_m > SHORTEST_LANE_M:
                lanes.append(StraightLane(start, arc_start, **style))
            right = _turns_right(arm_in, arm_out)
            arms = np.array(ARMS[arm_in]) + np.array(ARMS[arm_out])
            center = self._center(name) + half_size_m * arms
            phase = math.atan2(*(arc_start - center)[::-1])
            radius = half_size_m - self.offset_m if right else half_size_m + self.offset_m
            quarter = math.pi / 2.0 if right else -math.pi / 2.0
            lanes.append(
                CircularLane(center, radius, phase, phase + quarter, clockwise=right, **style)
            )
            if edge_out - half_size_m > SHORTEST_LANE_M:
                lanes.append(StraightLane(arc_end, end, **style))
        nodes = [f"{name}.{arm_in}.in"]
        nodes += [f"{name}.{arm_in}>{arm_out}.{k}" for k in range(1, len(lanes))]
        nodes += [f"{name}.{arm_out}.out"]
        for lane, node_from, node_to in zip(lanes, nodes[:-1], nodes[1:], strict=True):
            self.network.add_lane(node_from, node_to, lane)
            if lines is NO_LINES:
                self.network.junction_lanes.add((node_from, node_to, 0))


def _turns_right(arm_in: str, arm_out: str) -> bool:
    """Whether arriving by one arm and leaving by another (not opposite) is a right turn."""
    (in_x, in_y), (out_x, out_y) = ARMS[arm_in], ARMS[arm_out]
    return (-in_x) * out_y - (-in_y) * out_x > 0
