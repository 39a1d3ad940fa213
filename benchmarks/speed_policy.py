"""Measuring the policy: how fast the shipped ``bc`` answers, and how fast one like it is trained.

It needs PyTorch, so it is imported only when it is measured.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.batches import AHEAD, SampleSet, rare_action_weights
from agents.beta_agent import BetaAgent
from agents.checkpoint import load_weights
from agents.collect import claim_folder, collect, jobs_of, log_settings
from agents.network import NetworkConfig
from agents.policy import BetaPolicy
from agents.registry import agent_source
from agents.training import Trainer
from agents.training_config import TrainingConfig
from bev_driving_env.logs.header import LogHeader
from bev_driving_env.logs.order import batch_numbers, open_logs
from bev_driving_env.settings import EnvSettings
from bev_driving_env.training.threads import one_thread

from .speed_figure import Figure
from .speed_steps import Timing

TOWN, ENV_ID = "Town01", "bev_driving_env:BEVTown01-v0"
TRAINING_ROUTES = (1, 2)
"""What is trained on: some 3,000 samples."""
WORLDS = 64
BATCH = 64
STEPS = 1_000_000
"""Of a training that is never finished, so that timing may go on as long as it likes."""


def shipped_policy() -> BetaPolicy:
    """The policy that ``bc`` drives with."""
    path = agent_source("bc")
    assert path is not None
    return load_weights(path)


def measure_inference(
    worlds: int, *, rounds: int, seconds: float, seed: int = 0
) -> dict[str, list[float]]:
    """Time the policy's decisions while it drives; the steps of the worlds are not timed.

    Args:
        worlds: Worlds of the vector environment.
        rounds: How often each is timed.
        seconds: Roughly how long each timing takes.
        seed: Of the drives.

    Returns:
        Seconds per observation for ``single`` (one environment, as the benchmark drives it) and
        ``vector`` (all worlds in one batch, by ``BetaPolicy.predict``), torch in one thread; a
        list of ``rounds`` values each.
    """
    policy = shipped_policy()
    env = gym.wrappers.Autoreset(gym.make(ENV_ID))
    calls = {
        "single": _decisions(env, BetaAgent(policy, env).act, seed),
        "vector": _decisions(
            gym.make_vec(ENV_ID, num_envs=worlds),
            lambda seen: policy.predict(seen, deterministic=True)[0],
            seed,
        ),
    }
    batch = {"single": 1, "vector": worlds}
    times: dict[str, list[float]] = {name: [] for name in calls}
    with one_thread():
        for call in calls.values():
            call(1)  # the first call also sets up what the others find
        repeats = {name: max(1, round(seconds / call(3))) for name, call in calls.items()}
        for _ in tqdm(range(rounds), unit="round", desc="timing bc"):
            for name, call in calls.items():
                times[name].append(call(repeats[name]) / batch[name])
    return times


def _decisions(
    env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any],
    act: Callable[[Any], NDArray[np.float32]],
    seed: int,
) -> Timing:
    """Times decisions in a closed loop with an environment that resets itself."""
    observation, _ = env.reset(seed=seed)

    def run(decisions: int) -> float:
        nonlocal observation
        taken = 0.0
        for _ in range(decisions):
            start = time.perf_counter()
            action = act(observation)
            taken += time.perf_counter() - start
            observation = env.step(action)[0]
        return taken / decisions

    return run


def training_samples(folder: Path, network: NetworkConfig, seed: int = 0) -> SampleSet:
    """Collect a small log without traffic and open it as ``bev-agents train`` does.

    Args:
        folder: Of the log.
        network: What the policy sees.
        seed: Of the log.
    """
    header = LogHeader(TOWN, log_settings(TOWN, EnvSettings()), 10, 20, seed, (1.0,))
    claim_folder(folder, header)
    collect(folder, header, jobs_of(header, TRAINING_ROUTES), 1)
    depth = max(network.channels) + 1
    logs = open_logs([folder])
    return SampleSet(logs, "train", channels=depth, weigh=rare_action_weights)


def measure_training(
    samples: SampleSet,
    network: NetworkConfig,
    batch: int,
    *,
    rounds: int,
    seconds: float,
    seed: int = 0,
) -> dict[str, list[float]]:
    """Time steps of behaviour cloning, torch in one thread, and rendering alone, in turn.

    As in ``bev-agents train --threads 1`` the next batches are rendered meanwhile, in a thread of
    their own.

    Args:
        samples: What to learn from.
        network: What to train.
        batch: Samples in a batch.
        rounds: How often each is timed.
        seconds: Roughly how long each timing takes.
        seed: Of first weights and order.

    Returns:
        Seconds per sample for ``training`` and ``rendering``; a list of ``rounds`` values each.
    """
    trainer = Trainer(TrainingConfig(steps=STEPS, batch_size=batch, seed=seed), network)
    numbers = batch_numbers(len(samples), batch, seed, 0)
    times: dict[str, list[float]] = {"training": [], "rendering": []}
    with one_thread():
        steps = max(1, round(seconds / _step_s(trainer, samples, 1)))
        for _ in tqdm(range(rounds), unit="round", desc="timing training"):
            times["training"].append(_step_s(trainer, samples, steps) / batch)
            start = time.perf_counter()
            for _ in range(steps):
                samples.batch(numbers)
            times["rendering"].append((time.perf_counter() - start) / steps / batch)
    return times


def _step_s(trainer: Trainer, samples: SampleSet, steps: int) -> float:
    """Mean seconds of so many steps in the midst of training.

    The first may find their batches rendered already, and beside the last nothing is rendered:
    both are done, but not counted.
    """
    ahead = AHEAD + 1  # one more waits for its place in the queue
    until = trainer.step + ahead + steps + ahead + 1
    done = [time.perf_counter() for _ in trainer.train(samples, until)]
    return (done[ahead + steps] - done[ahead]) / steps


def figures(rounds: int, seconds: float, seed: int = 0) -> list[Figure]:
    """Inference and training; the ratio is the median of the ratios of each round."""
    answers = measure_inference(WORLDS, rounds=rounds, seconds=seconds, seed=seed)
    network = shipped_policy().config
    with tempfile.TemporaryDirectory() as folder:
        samples = training_samples(Path(folder), network, seed)
        times = measure_training(samples, network, BATCH, rounds=rounds, seconds=seconds, seed=seed)
    rate = {name: 1.0 / median(values) for name, values in {**answers, **times}.items()}
    share = median(
        alone / whole for alone, whole in zip(times["rendering"], times["training"], strict=True)
    )
    return [
        Figure("bc, one observation", rate["single"], "inferences/s"),
        Figure(f"bc, batches of {WORLDS}", rate["vector"], "inferences/s"),
        Figure(f"training, batches of {BATCH}, rendered meanwhile", rate["training"], "samples/s"),
        Figure("rendering a batch / a training step", share, "x"),
    ]
