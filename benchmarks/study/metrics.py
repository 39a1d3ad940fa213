"""The metrics that the study compares, each a figure a variant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.sources.expressions import TRUTH
from perception.evaluation import BANDS

from ..online import Seen, pooled
from .open_loop import OpenLoop
from .variants import STATIC

OPEN_LOOP, ONLINE = "open loop", "online"
NEAR, FAR = 0, len(BANDS) - 1
ROUTE, STEERING = STATIC.index("route"), 1
GOOD_ENOUGH = 0.7
MEAN_IOU, ROUTE_TURN, DIVERGENCE = "mean_iou", "iou_route_turn", "divergence"


@dataclass(frozen=True)
class Metric:
    """A metric.

    Attributes:
        name: Its column.
        title: What it is, for people.
        family: Open loop: on the fixed frames; online: while the variant drove.
        lower_is_better: Whether less of it is better.
    """

    name: str
    title: str
    family: str = OPEN_LOOP
    lower_is_better: bool = False

    def oriented(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values of which more is better."""
        return -values if self.lower_is_better else values


METRICS = (
    Metric(MEAN_IOU, "mean IoU of road, route, lane"),
    Metric("iou_road", "IoU, road"),
    Metric("iou_route", "IoU, route"),
    Metric("iou_lane", "IoU, lane"),
    Metric("mean_iou_critical", "mean IoU at critical places"),
    Metric("mean_iou_turn", "mean IoU at turns"),
    Metric("mean_iou_near", f"mean IoU, {BANDS[NEAR]}"),
    Metric("mean_iou_far", f"mean IoU, {BANDS[FAR]}"),
    Metric("mean_iou_frame", "mean IoU, mean over frames"),
    Metric("iou_route_critical", "IoU, route, at critical places"),
    Metric(ROUTE_TURN, "IoU, route, at turns"),
    Metric("iou_route_near", f"IoU, route, {BANDS[NEAR]}"),
    Metric("iou_route_far", f"IoU, route, {BANDS[FAR]}"),
    Metric("route_turn_median", "IoU, route, of the median turn frame"),
    Metric("route_turn_q05", "IoU, route, that 5 % of turn frames stay under"),
    Metric("route_turn_good", f"share of turn frames with route IoU from {GOOD_ENOUGH}"),
    Metric(DIVERGENCE, "policy divergence, median", lower_is_better=True),
    Metric("divergence_q95", "policy divergence, worst 5 % of frames", lower_is_better=True),
    Metric("divergence_critical", "policy divergence at critical places", lower_is_better=True),
    Metric("divergence_turn", "policy divergence at turns", lower_is_better=True),
    Metric("steering_gap", "steering off, mean", lower_is_better=True),
    Metric("steering_gap_turn", "steering off at turns, mean", lower_is_better=True),
    Metric("online_mean_iou", "mean IoU of road, route, lane", ONLINE),
    Metric("online_iou_road", "IoU, road", ONLINE),
    Metric("online_iou_route", "IoU, route", ONLINE),
    Metric("online_iou_lane", "IoU, lane", ONLINE),
    Metric("online_mean_iou_critical", "mean IoU at critical places", ONLINE),
    Metric("online_iou_route_turn", "IoU, route, at turns", ONLINE),
    Metric("online_divergence", "policy divergence, median", ONLINE, lower_is_better=True),
    Metric("online_divergence_turn", "policy divergence at turns", ONLINE, lower_is_better=True),
)
"""All that are compared; the first is what the others are compared with."""


def open_loop_metrics(found: OpenLoop) -> dict[str, float]:
    """Metrics of a variant on the fixed frames; NaN where there was nothing to measure."""
    turn, critical = found.places.turn, found.places.critical
    frame_iou = found.counts.frame_iou()[turn, ROUTE, 0]
    frame_iou = frame_iou[np.isfinite(frame_iou)]
    whole, steering = _iou(found), found.action_gap[:, STEERING]
    return {
        MEAN_IOU: fmean(whole),
        **{f"iou_{name}": value for name, value in zip(STATIC, whole, strict=True)},
        "mean_iou_critical": fmean(_iou(found, critical)),
        "mean_iou_turn": fmean(_iou(found, turn)),
        "mean_iou_near": fmean(_iou(found, band=NEAR)),
        "mean_iou_far": fmean(_iou(found, band=FAR)),
        "mean_iou_frame": float(np.mean(found.counts.mean_frame_iou())),
        "iou_route_critical": _iou(found, critical)[ROUTE],
        ROUTE_TURN: _iou(found, turn)[ROUTE],
        "iou_route_near": _iou(found, band=NEAR)[ROUTE],
        "iou_route_far": _iou(found, band=FAR)[ROUTE],
        "route_turn_median": _quantile(frame_iou, 0.5),
        "route_turn_q05": _quantile(frame_iou, 0.05),
        "route_turn_good": _mean(frame_iou >= GOOD_ENOUGH),
        DIVERGENCE: _quantile(found.divergence, 0.5),
        "divergence_q95": _quantile(found.divergence, 0.95),
        "divergence_critical": _quantile(found.divergence[critical], 0.5),
        "divergence_turn": _quantile(found.divergence[turn], 0.5),
        "steering_gap": _mean(steering),
        "steering_gap_turn": _mean(steering[turn]),
    }


def online_metrics(spec: str, summaries: Iterable[Mapping[str, Any] | None]) -> dict[str, float]:
    """Metrics of a variant on the frames that it came to itself.

    Args:
        spec: The variant; of drives on the truth no summary is made.
        summaries: Of its drives, see ``online.summary``.
    """
    names = [metric.name for metric in METRICS if metric.family == ONLINE]
    if spec == TRUTH:
        return {name: 0.0 if "divergence" in name else 1.0 for name in names}
    seen = pooled(summaries)
    values = [
        _mean_iou(seen["all"]),
        *(seen["all"].iou[name] for name in STATIC),
        _mean_iou(seen["critical"]),
        seen["turn"].iou["route"],
        seen["all"].divergence,
        seen["turn"].divergence,
    ]
    return dict(zip(names, values, strict=True))


def _mean_iou(seen: Seen) -> float:
    return fmean(seen.iou[name] for name in STATIC)


def _iou(
    found: OpenLoop, frames: NDArray[np.bool_] | None = None, band: int | None = None
) -> list[float]:
    """Dataset-level IoU of road, route and lane."""
    counts = found.counts.subset(frames, None if band is None else [band])
    values: list[float] = counts.dataset_iou()[:, 0].tolist()
    return values


def _quantile(values: NDArray[Any], share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else float("nan")


def _mean(values: NDArray[Any]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
