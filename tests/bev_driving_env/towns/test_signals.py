import math
import re
from collections import Counter

import numpy as np
import pytest

# junction centre, then for each approach: distance of the stop line, and the signal head's x, y
APPROACHES = {
    "Town01": """
        B1 90.37,-0.05   E 12.3 102.4,-4.4   S 11.3 95.0,12.9    W 11.0 77.2,4.8
        B2 90.38,57.5    N 11.3 85.7,45.5    E 11.0 103.0,52.9   S 10.6 95.0,70.7
        B3 90.39,131.41  N 11.6 85.7,119.4   E 11.0 103.0,126.8  S 10.4 95.0,144.7
        B4 90.4,197.14   N 10.8 85.7,185.0   E 11.0 103.0,192.6  S 11.2 95.0,210.2
        B5 90.42,328.59  N 11.3 85.6,316.0   E 11.2 106.4,324.1  W 10.8 75.4,333.3
        C1 156.08,-0.04  E 12.0 168.1,-4.4   S 11.1 160.7,12.9   W 11.1 142.8,4.8
        C2 156.01,57.49  N 11.3 151.3,45.0   E 11.2 169.2,53.0   W 11.0 143.9,62.3
        D1 336.9,-0.01   E 11.3 348.8,-4.5   S 10.8 341.4,13.0   W 11.3 323.5,5.0
        D2 336.87,57.47  N 11.1 332.0,44.6   S 11.6 341.2,69.8   W 11.7 321.4,62.4
        D3 336.82,131.52 N 10.9 332.0,118.6  S 12.2 341.2,143.7  W 11.2 321.4,136.1
        D4 336.78,197.16 N 11.5 332.0,184.2  S 12.0 341.2,209.2  W 11.1 323.1,202.0
        D5 336.7,328.61  N 11.2 332.0,316.0  E 11.0 349.9,324.1  W 11.0 324.6,333.3
    """,
    "Town02": """
        A2 -5.45,189.55  N 8.3 -10.1,177.6   E 8.9 7.2,185.0     S 9.7 -0.8,202.8
        B2 43.85,189.57  E 8.9 58.4,185.3    S 9.6 48.5,203.6    W 9.2 30.6,194.3
        B3 43.85,238.87  N 11.3 39.3,226.8   E 10.9 56.6,234.2   S 9.0 48.5,252.1
        B4 43.86,304.53  N 8.6 39.1,289.2    E 8.8 57.0,300.0    W 9.2 31.7,309.4
        C2 134.16,189.61 E 10.9 146.3,184.8  S 9.6 138.9,202.1   W 11.0 121.0,194.1
        C3 134.11,238.93 N 8.8 129.6,226.2   E 8.9 147.4,234.2   W 9.1 122.2,243.8
        D2 191.69,189.64 N 8.5 186.9,176.4   S 9.4 196.2,201.7   W 9.2 178.9,194.3
        D3 191.7,238.96  N 8.6 186.9,225.9   S 9.4 196.2,251.1   W 9.2 178.9,243.7
    """,
}
OUTWARD = {"N": (0, -1), "E": (1, 0), "S": (0, 1), "W": (-1, 0)}


def approaches(name):
    """Junction, its centre, outward unit vector, stop distance and signal head of each approach."""
    for line in APPROACHES[name].strip().splitlines():
        node, center, rest = line.split(maxsplit=2)
        for arm, edge, head in re.findall(r"([NESW]) (\S+) (\S+)", rest):
            yield node, xy(center), np.array(OUTWARD[arm]), float(edge), xy(head)


def xy(text):
    return np.array([float(part) for part in text.split(",")])


def signal_at(town, head):
    (match,) = [k for k, s in enumerate(town.signals) if math.dist((s.x, s.y), head) < 0.06]
    return match


def test_there_is_one_signal_head_per_approach_where_carla_has_it(town):
    heads = [head for *_, head in approaches(town.name)]
    assert len(heads) == len(town.signals) == {"Town01": 36, "Town02": 24}[town.name]
    assert len({signal_at(town, head) for head in heads}) == len(heads)


def test_stop_lines_lie_across_the_approach_lane_at_the_junction_edge(town):
    for node, center, outward, edge, head in approaches(town.name):
        x0, y0, x1, y1 = town.stop_lines[signal_at(town, head)]
        middle = np.array([x0 + x1, y0 + y1]) / 2.0
        assert outward @ (middle - center) == pytest.approx(edge, abs=0.2), node
        # traffic drives inward on the right-hand side: the lane centre is 2 m right of the axis
        right = np.array([outward[1], -outward[0]])
        assert right @ (middle - center) == pytest.approx(2.0, abs=0.2), node
        assert outward @ (x1 - x0, y1 - y0) == pytest.approx(0.0, abs=1e-6), node
        assert 2.5 <= math.dist((x0, y0), (x1, y1)) <= 4.0


def test_a_signals_lane_ends_at_its_stop_line_and_leads_into_its_junction(town):
    numbers = {lane.index: number for number, lane in enumerate(town.lanes)}
    for signal, (x0, y0, x1, y1) in zip(town.signals, town.stop_lines, strict=True):
        number = numbers[signal.lane]
        end = town.lanes[number].points[-1]
        np.testing.assert_allclose(end[:2], [(x0 + x1) / 2.0, (y0 + y1) / 2.0], atol=1e-9)
        assert not town.lanes[number].in_junction
        assert len(town.successors[number]) == 2
        # the head faces traffic from the right-hand kerb
        ahead = end[2:] @ ([signal.x, signal.y] - end[:2])
        right = np.array([-end[3], end[2]]) @ ([signal.x, signal.y] - end[:2])
        assert -7.0 <= ahead <= 0.3
        assert 2.0 <= right <= 3.5


def test_each_approach_of_a_junction_has_a_green_phase_of_its_own(town):
    phases = Counter((signal.junction, signal.phase) for signal in town.signals)
    junctions = {signal.junction for signal in town.signals}
    assert phases == Counter((name, phase) for name in junctions for phase in range(3))
