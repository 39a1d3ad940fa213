"""The policies that come with BEVTown drive."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
import bev_driving_env
from agents import make_agent
from agents.checkpoint import weights_card
from agents.registry import SHIPPED
from benchmarks.drive import drive
from benchmarks.suites import SUITES, Conditions, jobs_of


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_bc_drives_the_papers_episodes_on_true_bev_without_an_infraction(town):
    jobs = jobs_of(SUITES["paper"], [town], ["ground_truth"], ["bc"], [0])
    results = [drive(job) for job in jobs]
    assert [result.clean for result in results] == [True] * 5


def test_bc_town_gives_way_and_stops_for_signals_in_dense_traffic():
    dense = Conditions(traffic="dense", traffic_lights=True)
    suite = replace(SUITES["paper"], conditions=dense)
    jobs = islice(jobs_of(suite, ["Town02"], ["ground_truth"], ["bc_town"], [0]), 2)
    assert [drive(job).clean for job in jobs] == [True] * 2


def test_it_lives_on_its_bev():
    # with nothing to see, it does not find its way
    jobs = jobs_of(SUITES["paper"], ["Town01"], ["tests_nothing_seen"], ["bc"], [0])
    assert not any(drive(job).clean for job in jobs)


@pytest.fixture(autouse=True, scope="module")
def nothing_seen():
    """A predictor that predicts nothing."""

    class Nothing:
        channels = ("road",)

        def reset(self):
            pass

        def __call__(self, frame):
            return np.zeros((1, 192, 192), np.uint8)

    bev_driving_env.register_bev_source("tests_nothing_seen", Nothing, overwrite=True)


def test_each_has_a_card_that_says_where_it_came_from():
    folder = Path(agents.__file__).parent / "weights"
    for name in SHIPPED:
        path = folder / f"{name}.safetensors"
        assert path.stat().st_size < 5_000_000
        card = weights_card(path)
        assert {"command", "git_commit", "seeds", "data", "steps", "hours", "machine"} <= set(card)
        text = (folder / f"{name}.md").read_text(encoding="utf-8")
        assert card["git_commit"][:12] in text
        assert f"`{card['command']}`" in text


def test_sampled_actions_follow_from_the_seed():
    env = gym.make("BEVTown01-v0")
    observation, _ = env.reset(seed=0)
    agent = make_agent("bc:sample", env)

    def draw(seed):
        agent.reset(seed)
        return [agent.act(observation).tolist() for _ in range(3)]

    assert draw(1) == draw(1)
    assert draw(1) != draw(2)
