"""PPO in one file, in the manner of CleanRL, on BEVTown's vector environment with a Beta policy.

    python examples/ppo.py --steps 200000

A small BEV (96 x 96, the same 38 m) and many worlds in one process; written to be read and changed.
What it reaches depends on how long it runs: print-outs are the mean return and route share of the
episodes that ended.
"""

from __future__ import annotations

import argparse
import time

import gymnasium as gym
import numpy as np
import torch
from torch import nn

import bev_driving_env
from agents.beta import beta_entropy, beta_mode, beta_nll, beta_sample

gym.register_envs(bev_driving_env)
BEV = {"size": 96, "px_per_m": 2.5, "ego_row": 76}
CHANNELS = 3


class Driver(nn.Module):
    """Three convolutions, then alpha and beta of two actions, and a value."""

    def __init__(self) -> None:
        super().__init__()
        self.see = nn.Sequential(
            nn.Conv2d(CHANNELS, 16, 8, 4), nn.ReLU(),
            nn.Conv2d(16, 32, 4, 2), nn.ReLU(),
            nn.Conv2d(32, 32, 3, 2), nn.ReLU(), nn.Flatten(),
        )  # fmt: skip
        self.think = nn.Sequential(nn.Linear(32 * 4 * 4 + 1, 128), nn.ReLU())
        self.concentrations, self.value = nn.Linear(128, 4), nn.Linear(128, 1)

    def forward(
        self, bev: torch.Tensor, speed: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Alpha and beta (N, 2) and values (N,) of bev (N, 3, 96, 96) uint8 and speed (N, 1)."""
        seen = torch.cat([self.see(bev.float() / 255.0), speed / 6.0], dim=1)
        hidden = self.think(seen)
        # at least 1, so that every distribution has one peak
        alpha, beta = (nn.functional.softplus(self.concentrations(hidden)) + 1.0).chunk(2, dim=1)
        return alpha, beta, self.value(hidden)[:, 0]


def inputs(observations: dict[str, np.ndarray]) -> tuple[torch.Tensor, torch.Tensor]:
    """What the driver sees of a batch of observations."""
    bev = torch.from_numpy(observations["bev"][:, :CHANNELS].copy())
    return bev, torch.from_numpy(observations["measurements"][:, :1].copy())


def main() -> None:
    """Train."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=200_000, help="of all worlds together")
    parser.add_argument("--worlds", type=int, default=16)
    parser.add_argument("--horizon", type=int, default=128, help="steps a world between updates")
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--minibatches", type=int, default=8)
    parser.add_argument("--learning-rate", type=float, default=3e-4)
    parser.add_argument("--gamma", type=float, default=0.97)
    parser.add_argument("--trace", type=float, default=0.95, help="lambda of GAE")
    parser.add_argument("--clip", type=float, default=0.2)
    parser.add_argument("--entropy", type=float, default=0.003)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    envs = gym.make_vec("BEVTown01-v0", num_envs=options.worlds, bev=BEV)
    driver = Driver()
    optimizer = torch.optim.Adam(driver.parameters(), lr=options.learning_rate, eps=1e-5)
    observations, _ = envs.reset(seed=options.seed)
    # the step after an end only resets; it teaches nothing
    resetting = np.zeros(options.worlds, bool)
    taken, start = 0, time.perf_counter()
    while taken < options.steps:
        rows, ended = [], []
        for _ in range(options.horizon):
            bev, speed = inputs(observations)
            with torch.no_grad():
                alpha, beta, value = driver(bev, speed)
                action = beta_sample(alpha, beta).float()
                chance = -beta_nll(alpha, beta, action)
            observations, reward, terminated, truncated, infos = envs.step(action.numpy())
            over = terminated | truncated
            rows.append((bev, speed, action, chance, value, reward, over, ~resetting))
            if "episode_summary" in infos:
                summary, which = infos["episode_summary"], infos["_episode_summary"]
                shares = summary["route_m"][which] / summary["route_length_m"][which]
                ended += zip(summary["return"][which], shares, strict=True)
            resetting = over
        taken += options.horizon * options.worlds
        columns = list(zip(*rows, strict=True))
        bev, speed, action, chance, value = (torch.stack(part) for part in columns[:5])
        reward, over, counts = (torch.from_numpy(np.stack(part)).float() for part in columns[5:])
        with torch.no_grad():
            following = driver(*inputs(observations))[2]
        advantage, trail = torch.zeros_like(value), torch.zeros(options.worlds)
        for t in reversed(range(options.horizon)):
            surprise = reward[t] + options.gamma * (1.0 - over[t]) * following - value[t]
            trail = surprise + options.gamma * options.trace * (1.0 - over[t]) * trail
            advantage[t], following = trail, value[t]
        target = advantage + value
        flat = [part.flatten(0, 1) for part in (bev, speed, action, chance, advantage, target)]
        useful = torch.nonzero(counts.flatten() > 0.0)[:, 0]
        for _ in range(options.epochs):
            order = useful[torch.randperm(len(useful))]
            for chosen in order.chunk(options.minibatches):
                sight, pace, did, before, better, aim = (part[chosen] for part in flat)
                alpha, beta, guess = driver(sight, pace)
                ratio = (-beta_nll(alpha, beta, did) - before).exp()
                better = (better - better.mean()) / (better.std() + 1e-8)
                clipped = ratio.clamp(1.0 - options.clip, 1.0 + options.clip)
                loss = -torch.min(ratio * better, clipped * better).mean()
                loss = loss + 0.5 * (guess - aim).square().mean()
                loss = loss - options.entropy * beta_entropy(alpha, beta).mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(driver.parameters(), 0.5)
                optimizer.step()
        rate = taken / (time.perf_counter() - start)
        returns, shares = np.array(ended).reshape(-1, 2).T
        text = f"return {returns.mean():8.2f}, route {shares.mean():6.1%}" if len(ended) else ""
        print(f"{taken:9,d} steps, {rate:6.0f}/s, {len(ended):4d} episodes {text}", flush=True)
    with torch.no_grad():
        alpha, beta, _ = driver(*inputs(observations))
    print("last action of the first world:", beta_mode(alpha, beta)[0].tolist())


if __name__ == "__main__":
    main()
