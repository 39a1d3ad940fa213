"""Results to sum up, made by hand, and short drive logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import pytest

from benchmarks import speed_logs
from benchmarks.drive import EpisodeResult
from benchmarks.suites import Conditions, Job


@pytest.fixture
def short_logs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drive logs whose speed is measured have episodes of two seconds."""
    whole = speed_logs.log_settings
    monkeypatch.setattr(
        speed_logs, "log_settings", lambda *given: {**whole(*given), "time_limit_s": 2.0}
    )


@pytest.fixture
def make_result() -> Callable[..., EpisodeResult]:
    def make(town: str = "Town01", index: int = 0, **changes: object) -> EpisodeResult:
        job = {
            "town": town,
            "routes": "episode",
            "index": index,
            "bev": changes.pop("bev", "ground_truth"),
            "agent": changes.pop("agent", "expert"),
            "seed": changes.pop("seed", 0),
            "appearance": "train",
            "conditions": asdict(changes.pop("conditions", Conditions())),
        }
        row = {
            "job": job,
            "planned_m": 100.0,
            "driven_m": 99.5,
            "success": True,
            "truncated": False,
            "infraction": "",
            "infraction_m": None,
            "infraction_pose": None,
            "infractions": 0,
            "steps": 200,
            "time_s": 20.0,
            "episode_return": 190.0,
            "failure": "",
            "error": "",
            "trajectory": [[0.0, -2.0], [10.0, -2.0]],
            "events": [],
            "travelled_m": 100.0,
            "outside_m": 0.0,
            "online": None,
        }
        return EpisodeResult.from_dict({**row, **changes})

    return make


@pytest.fixture
def make_event() -> Callable[..., dict[str, Any]]:
    def make(name: str, fault: str = "ego", **changes: object) -> dict[str, Any]:
        event = {
            "name": name,
            "time_s": 5.0,
            "x": 10.0,
            "y": -2.0,
            "heading": 0.0,
            "speed_mps": 4.0,
            "route_m": 20.0,
            "actor": "",
            "fault": fault,
        }
        return {**event, **changes}

    return make


@pytest.fixture
def job() -> Job:
    return Job("Town02", "episode", 0, "ground_truth", "expert", 7, "test")
