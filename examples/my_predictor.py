"""From a torch model to a row of the benchmark; the page docs/your_predictor.md walks through it.

    bev-bench run --bev examples.my_predictor:make --town Town01 --out runs/mine

The network here is small and untrained, and its output shows it. Replace ``Network`` by yours.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from bev_driving_env import SensorFrame


class Network(nn.Module):
    """A toy: the front image and the route map, pooled, and a convolution. Yours goes here."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.image = nn.Sequential(nn.Conv2d(3, 8, 7, 4, 3), nn.ReLU(), nn.AdaptiveAvgPool2d(24))
        self.plan = nn.Sequential(nn.Conv2d(1, 8, 7, 4, 3), nn.ReLU(), nn.AdaptiveAvgPool2d(24))
        self.head = nn.Conv2d(16, 3, 3, 1, 1)

    def forward(self, images: torch.Tensor, route_map: torch.Tensor) -> torch.Tensor:
        """Logits (1, 3, 192, 192) from images (4, 3, H, W) and a route map (1, 192, 192)."""
        features = torch.cat([self.image(images[:1]), self.plan(route_map[None])], dim=1)
        return nn.functional.interpolate(self.head(features), size=192, mode="bilinear")


class MyPredictor:
    """A ``BEVSource``: three channels, the others stay empty."""

    channels = ("road", "route", "lane")

    def __init__(self) -> None:
        self.network = Network().eval()

    def reset(self) -> None:
        """An episode starts; this predictor remembers nothing."""

    @torch.inference_mode()
    def __call__(self, frame: SensorFrame) -> np.ndarray:
        """Predict (3, 192, 192) probabilities in [0, 1]."""
        images = torch.from_numpy(frame.images).permute(0, 3, 1, 2).float() / 255.0
        route_map = torch.from_numpy(frame.route_map)[None].float() / 255.0
        return self.network(images, route_map)[0].sigmoid().numpy()


make = MyPredictor


if __name__ == "__main__":
    import gymnasium as gym

    import bev_driving_env
    from agents import Expert

    bev_driving_env.register_bev_source("mine", MyPredictor)
    env = gym.make("BEVTown01-v0", bev_source="mine")
    observation, info = env.reset(seed=0, options={"episode": 0})
    expert = Expert(env)  # privileged: it drives well whatever the predictor says
    for _ in range(20):
        observation, reward, terminated, truncated, info = env.step(expert.act(observation))
    road = observation["bev"][0]
    truth = env.unwrapped.ground_truth_bev()[0]
    overlap = ((road > 127) & (truth > 0)).sum() / max(1, ((road > 127) | (truth > 0)).sum())
    print(f"{info['route_m']:.1f} m driven, IoU of the road channel {overlap:.2f}")
