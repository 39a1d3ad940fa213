"""The paper's figures, to stand beside ours: another world, another budget, the same protocol.

dos Santos, Antonelo and Couto, "Closed-Loop Evaluation of Bird's-Eye-View Maps from Cross-View
Transformers as Inputs to Behavior-Cloning Policies"; CARLA's Town01 and Town02.
"""

from __future__ import annotations

from dataclasses import dataclass

NAMES = {
    "ground_truth": "Ground-truth BEV",
    "unet": "UNet",
    "cvt_3ch": "CVT 3ch.",
    "cvt": "CVT 6ch.",
    "cvt_kde": "CVT 6ch. KDE",
    "cvt_no_noise": "CVT 6ch. No Noise",
}
"""What the paper calls the systems that are built here under other names, in its order."""


@dataclass(frozen=True)
class PublishedDrive:
    """A system in the paper's five episodes of a town.

    Attributes:
        route_m: Route metres driven.
        infracted: Episodes with an infraction, of five.
    """

    route_m: int
    infracted: int


DRIVES: dict[str, dict[str, PublishedDrive]] = {
    "Town01": {
        "ground_truth": PublishedDrive(598, 0),
        "unet": PublishedDrive(115, 5),
        "cvt_3ch": PublishedDrive(159, 5),
        "cvt": PublishedDrive(151, 5),
        "cvt_kde": PublishedDrive(261, 4),
        "cvt_no_noise": PublishedDrive(120, 5),
    },
    "Town02": {
        "ground_truth": PublishedDrive(604, 0),
        "unet": PublishedDrive(22, 5),
        "cvt_3ch": PublishedDrive(27, 5),
        "cvt": PublishedDrive(52, 5),
        "cvt_kde": PublishedDrive(106, 5),
        "cvt_no_noise": PublishedDrive(28, 5),
    },
}
"""Table "Route completion and number of infractions", by town and system."""

IOU: dict[str, dict[str, tuple[float, ...]]] = {
    "Town01": {
        "cvt": (0.8135, 0.5938, 0.3618, 0.2460, 0.0, 0.0532),
        "cvt_no_noise": (0.5086, 0.1918, 0.0362, 0.0696, 0.0, 0.0031),
        "cvt_kde": (0.8614, 0.6455, 0.4170, 0.2401, 0.0, 0.0499),
    },
    "Town02": {
        "cvt": (0.7889, 0.5569, 0.3098, 0.2419, 0.0001, 0.0240),
        "cvt_no_noise": (0.6810, 0.4082, 0.2485, 0.1221, 0.0, 0.0051),
        "cvt_kde": (0.8160, 0.5755, 0.3086, 0.2252, 0.0003, 0.0302),
        "cvt_3ch": (0.9144, 0.7808, 0.3158),
        "unet": (0.6978, 0.5915, 0.3959),
    },
}
"""Open-loop IoU by town and system, of the channels in order; Town01: validation, Town02: test."""

IOU_WHILE_DRIVING: dict[str, dict[str, tuple[float, float, float]]] = {
    "Town01": {
        "cvt_3ch": (0.933, 0.808, 0.551),
        "cvt": (0.935, 0.788, 0.332),
        "cvt_kde": (0.943, 0.789, 0.406),
    },
    "Town02": {
        "cvt_3ch": (0.871, 0.727, 0.438),
        "cvt": (0.903, 0.680, 0.321),
        "cvt_kde": (0.902, 0.667, 0.340),
    },
}
"""IoU of road, route and lane in the evaluation episodes, by town and system."""
