"""Driving a split with a policy in training."""

from __future__ import annotations

import numpy as np
import pytest

from agents.checkpoint import load_weights
from agents.registry import agent_source
from agents.split_drive import SplitDrive
from bev_driving_env.env import BEVTownEnv

ROUTES = 2


def test_a_policy_that_drives_well_drives_all_of_them_clean():
    result = SplitDrive("Town02", "val", ROUTES).drive(load_weights(agent_source("bc")))
    assert (result.routes, result.clean) == (ROUTES, 1.0)
    assert result.route_share > 0.99


def test_it_is_what_single_environments_say():
    policy = load_weights(agent_source("bc"))
    returns, shares = [], []
    for index in range(ROUTES):
        env = BEVTownEnv("Town02", time_limit_s=8.0)
        seen, _ = env.reset(seed=0, options={"split": "val", "index": index})
        ended = False
        while not ended:
            seen, _, terminated, truncated, info = env.step(
                policy.predict(seen, None, None, True)[0]
            )
            ended = terminated or truncated
        summary = info["episode_summary"]
        returns.append(summary["return"])
        shares.append(summary["route_m"] / summary["route_length_m"])
    drive = SplitDrive("Town02", "val", ROUTES, time_limit_s=8.0)
    result = drive.drive(policy)
    assert drive.drive(policy) == result, "a second look is at the same drives"
    assert result.clean == 0.0, "eight seconds are not enough for a route"
    assert result.mean_return == pytest.approx(np.mean(returns), rel=1e-3)
    assert result.route_share == pytest.approx(np.mean(shares), rel=1e-3)
