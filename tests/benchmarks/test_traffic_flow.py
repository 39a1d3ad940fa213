"""Traffic on its own: nobody touches anybody, and nobody is stuck."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.cli import main
from benchmarks.traffic_command import summary_table
from benchmarks.traffic_flow import TrafficFlow, measure_flow
from bev_driving_env.frames import footprint
from bev_driving_env.kernels.contacts import count_contacts

from ..polygons import overlap

MOST_S = 180.0


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_ten_minutes_of_dense_traffic_without_a_contact_or_a_deadlock(town, seed):
    # every other seed without signals, where vehicles give way
    flow = measure_flow(town, "dense", lights=seed % 2 == 0, seed=seed, minutes=10.0)
    assert flow.contacts == 0
    assert flow.longest_stand_s < MOST_S
    assert flow.longest_wait_s < MOST_S
    assert flow.mean_speed_mps > 1.0
    assert flow.crossings_per_minute > 10.0
    assert len(flow.per_hour) == {"Town01": 12, "Town02": 8}[town]
    assert min(flow.per_hour.values()) > 200.0


def test_the_same_seed_gives_the_same_flow_and_another_does_not():
    first, again, other = (
        measure_flow("Town02", "light", lights=True, seed=seed, minutes=0.5) for seed in (1, 1, 2)
    )
    assert first == again
    assert first.mean_speed_mps != other.mean_speed_mps


def test_no_traffic_has_nothing_to_report():
    flow = measure_flow("Town02", "none", lights=False, seed=0, minutes=0.1)
    assert flow.contacts == flow.vehicles == flow.pedestrians == 0
    assert flow.longest_stand_s == flow.mean_speed_mps == 0.0


def test_contacts_are_the_pairs_whose_polygons_overlap():
    rng = np.random.default_rng(3)
    rows = np.zeros((40, 6))
    rows[:, :2] = rng.uniform(0.0, 25.0, (40, 2))
    rows[:, 2] = rng.uniform(-np.pi, np.pi, 40)
    rows[:, 4], rows[:, 5] = rng.uniform(1.0, 6.0, 40), rng.uniform(0.5, 2.5, 40)
    rows[7, 4] = 0.0  # an empty slot
    polygons = [footprint(row[:3], *row[4:]) for row in rows]
    expected = sum(
        overlap(polygons[i], polygons[j]) for i in range(40) for j in range(i) if 7 not in (i, j)
    )
    assert expected > 10
    assert count_contacts(rows, rows, True) == expected
    assert count_contacts(rows[:20], rows[20:], False) < expected


FLOW = TrafficFlow(
    "Town09", True, 0, 5, 6, 2.0, 0, 30.0, 12.0, 3.25, 4.0, {"A1": 100.0, "B1": 300.0}
)


def test_the_table_sums_up_seeds():
    other = TrafficFlow(
        "Town09", True, 1, 5, 6, 2.0, 2, 50.0, 12.0, 2.75, 6.0, {"A1": 200.0, "B1": 400.0}
    )
    cells = [cell.strip() for cell in summary_table([FLOW, other]).splitlines()[2].split("|")[1:-1]]
    assert cells == ["Town09", "on", "2", "5", "6", "2", "2", "50", "3.00", "250", "5"]


def test_the_command_prints_the_flow_of_each_junction_and_writes_it(tmp_path, capsys):
    out = tmp_path / "flow.json"
    arguments = ["traffic", "--town", "Town02", "--traffic", "light", "--minutes", "0.5"]
    assert main([*arguments, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    content = json.loads(out.read_text(encoding="utf-8"))
    (flow,) = content["flows"]
    assert flow["vehicles"] == 15
    assert flow["contacts"] == 0
    assert all(name in printed for name in flow["per_hour"])
    assert content["provenance"]["command"].startswith("bev-bench traffic")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--town", "Town7"], "unknown town 'Town7'; registered towns: Town01"),
        (["--minutes", "0"], "--minutes must be from 0.01"),
        (["--seed", "-1"], "--seed must be at least 0, got -1"),
    ],
)
def test_a_mistake_is_told_in_one_line(arguments, named, capsys):
    assert main(["traffic", *arguments]) == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
