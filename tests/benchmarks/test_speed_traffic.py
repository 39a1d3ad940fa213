from __future__ import annotations

import pytest

from benchmarks import speed_traffic


def test_highway_v0_costs_far_more_than_any_traffic():
    times = speed_traffic.measure_traffic(1, 0.05, seed=0)
    assert set(times) == {"empty", "busy", "dense", "highway"}
    assert times["empty"][0] < times["highway"][0] / 5.0
    assert times["dense"][0] < times["highway"][0] / 5.0


def test_figures_are_medians_of_ratios_and_targets_are_judged(monkeypatch):
    times = {
        "empty": [1e-4, 2e-4, 1e-4],
        "busy": [1.4e-4, 3.2e-4, 1.2e-4],
        "dense": [3e-4, 3e-4, 3e-4],
        "highway": [4e-3, 8e-3, 4e-3],
    }
    monkeypatch.setattr(speed_traffic, "measure_traffic", lambda *_: times)
    monkeypatch.setattr(speed_traffic, "metadrive_steps_per_s", lambda: 500.0)
    figures = {entry.name: entry for entry in speed_traffic.figures(3, 0.1, 0)}
    cost = figures["with 30 and 40 / empty, cost of a step"]
    assert cost.value == pytest.approx(1.4)
    assert cost.met
    faster = figures["with 30 and 40 / highway-v0"]
    assert faster.value == pytest.approx(4e-3 / 1.4e-4)
    assert not faster.met
    assert figures["with 30 and 40 / MetaDrive, top-down"].value == pytest.approx(1 / 1.4e-4 / 500)
    assert figures["with 100 and 250 / empty"].target == ""


def test_metadrive_is_left_out_where_it_is_not_installed(monkeypatch):
    monkeypatch.setattr(speed_traffic.importlib.util, "find_spec", lambda name: None)
    assert speed_traffic.metadrive_steps_per_s() is None
