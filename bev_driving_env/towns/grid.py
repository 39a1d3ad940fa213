"""``GridTown``: a town of straight roads, junctions and corners as a compact table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..checks import require_positive

ARMS: dict[str, tuple[int, int]] = {"N": (0, -1), "E": (1, 0), "S": (0, 1), "W": (-1, 0)}
"""Unit vector (x east, y south) from a node towards each of its arms."""


@dataclass(frozen=True)
class Arm:
    """One approach of a junction.

    Attributes:
        edge_m: Distance from the junction's centre to its edge, where the stop line is.
        signal: World (x, y) of the signal head that faces this approach.
    """

    edge_m: float
    signal: tuple[float, float]


@dataclass(frozen=True)
class Junction:
    """A junction of three or four arms.

    Attributes:
        half_size_m: Right turns have radius ``half_size_m - 2``, left turns ``half_size_m + 2``,
            both about the point ``half_size_m`` along each of the two arms.
        arms: Approaches by compass letter.
    """

    half_size_m: float
    arms: Mapping[str, Arm]


@dataclass(frozen=True)
class GridTown:
    """The table a town is built from; see ``town01.py`` for one.

    World x points east, y south; all lengths are in metres. A node lies where a column crosses a
    row, and is a corner, where two roads meet at a right angle, or a junction of three or four.

    Attributes:
        columns: World x of each grid column, by letter.
        rows: World y of each grid row, by number.
        links: Two-way roads between nodes, as ``"A1-B1 B1-C1 ..."``.
        junctions: One line a junction: node, half size, then for each arm its letter, its edge
            distance and its signal head as ``x,y``.
        corners: Radius of the road axis at each 90 degree bend, as ``"A1 8.9 ..."``.
        wide_turns: Radius of single movements that differ, as ``{"B3 N>E": 12.9}``: arriving by
            the northern arm and leaving by the eastern one.
        speed_limit_mps: Speed limit of every lane.
        lane_width_m: Width of every lane; the lane centre lies half of it right of the axis.
        shoulder_m: Paved strip outside each lane.
        sidewalk_m: Sidewalk outside the shoulder.

    Raises:
        ValueError: An entry cannot be read, names an unknown node, or a number is out of range.
            What contradicts another entry is found when the town is built.
    """

    columns: Mapping[str, float]
    rows: Mapping[str, float]
    links: str
    junctions: str
    corners: str
    wide_turns: Mapping[str, float] = field(default_factory=dict)
    speed_limit_mps: float = 11.18
    lane_width_m: float = 4.0
    shoulder_m: float = 0.3
    sidewalk_m: float = 4.0

    def __post_init__(self) -> None:
        for letter in self.columns:
            if len(letter) != 1:
                raise ValueError(f"columns must be named by one letter each, got {letter!r}")
        for name in ("speed_limit_mps", "lane_width_m"):
            require_positive(name, getattr(self, name))
        self.link_list()
        for name in (*self.junction_table(), *self.corner_table()):
            self.node(name)
        for movement, radius in self.wide_turns.items():
            require_positive(f"wide_turns[{movement!r}]", radius)

    def node(self, name: str) -> tuple[float, float]:
        """World position of a node such as ``"B3"``."""
        try:
            return self.columns[name[0]], self.rows[name[1:]]
        except (KeyError, IndexError):
            raise ValueError(
                f"unknown node {name!r}: columns are {''.join(self.columns)}, "
                f"rows {''.join(self.rows)}"
            ) from None

    def link_list(self) -> list[tuple[str, str, str, str]]:
        """Links as (node, arm, other node, other arm), each once."""
        opposite = {"N": "S", "S": "N", "E": "W", "W": "E"}
        links = []
        for text in self.links.split():
            start, _, end = text.partition("-")
            (x0, y0), (x1, y1) = self.node(start), self.node(end)
            if (x0 == x1) == (y0 == y1):
                raise ValueError(f"link {text!r} must run along one row or one column")
            arm = ("E" if x1 > x0 else "W") if y0 == y1 else ("S" if y1 > y0 else "N")
            links.append((start, arm, end, opposite[arm]))
        return links

    def junction_table(self) -> dict[str, Junction]:
        """Junctions by node name."""
        return dict(_junction(line) for line in self.junctions.strip().splitlines())

    def corner_table(self) -> dict[str, float]:
        """Radius of the road axis at each corner, by node name."""
        words = self.corners.split()
        try:
            table = {
                name: float(radius) for name, radius in zip(words[0::2], words[1::2], strict=True)
            }
        except ValueError:
            raise ValueError(
                f"corners must be pairs of node and radius such as 'A1 8.9', got {self.corners!r}"
            ) from None
        for name, radius in table.items():
            require_positive(f"radius of corner {name}", radius)
        return table


def _junction(line: str) -> tuple[str, Junction]:
    """Node and junction of one line of the table."""
    arms = {}
    try:
        name, half_size, *rest = line.split()
        for letter, edge, head in zip(rest[0::3], rest[1::3], rest[2::3], strict=True):
            x, y = head.split(",")
            arms[letter] = Arm(float(edge), (float(x), float(y)))
        junction = Junction(float(half_size), arms)
    except ValueError:
        raise ValueError(
            "a junction must be one line such as 'B1 8  E 10 62,-4  S 11 54,12  W 12 38,4' (node, "
            f"half size, then arm, edge distance and signal head x,y), got {line.strip()!r}"
        ) from None
    unknown = [letter for letter in arms if letter not in ARMS]
    if unknown or len(arms) < 3:
        raise ValueError(
            f"junction {name} must have three or four arms of {', '.join(ARMS)}, "
            f"got {', '.join(arms) or 'none'}"
        )
    return name, junction
