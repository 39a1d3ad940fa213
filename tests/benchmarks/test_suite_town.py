"""The expert on suite ``town``: all ten long routes of both towns, light and dense."""

from __future__ import annotations

from statistics import mean

import pytest

from benchmarks.drive import drive
from benchmarks.suites import SUITES, jobs_of


@pytest.mark.parametrize("traffic", ["light", pytest.param("dense", marks=pytest.mark.slow)])
@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_the_expert_scores_at_least_95_and_hits_nobody(town, traffic):
    suite = SUITES["town"].with_traffic(traffic)
    results = [drive(job) for job in jobs_of(suite, [town], ["ground_truth"], ["expert"], [0])]
    assert len(results) == 10
    assert not any(result.error for result in results)
    for version in ("1.0", "2.1"):
        assert mean(result.driving_score(version) for result in results) >= 95.0
    hit = [event for result in results for event in result.events if "collision" in event["name"]]
    assert hit == []
    assert not any(result.counts["red_light"] for result in results)
