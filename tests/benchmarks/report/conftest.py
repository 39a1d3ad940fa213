"""What drives saw, made by hand, and a short run to report on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.cli import main
from benchmarks.online import NATS
from bev_driving_env.frames import CHANNELS
from perception.places import PLACES


@pytest.fixture
def make_online() -> Callable[..., dict[str, Any]]:
    """Summaries of ``online.summary`` with given IoU of road, route and lane."""

    def make(*iou: float, union: int = 1000, nats: float = 1.0) -> dict[str, Any]:
        histogram = [0] * (len(NATS) - 1)
        histogram[int(np.searchsorted(NATS, nats, "right")) - 1] = 10
        shares = {name: iou[k] if k < len(iou) else 0.0 for k, name in enumerate(CHANNELS)}
        unions = {name: union if k < len(iou) else 0 for k, name in enumerate(CHANNELS)}
        place = {
            "moments": 10,
            "hits": {name: round(share * unions[name]) for name, share in shares.items()},
            "union": unions,
            "divergence": histogram,
        }
        return dict.fromkeys(PLACES, place)

    return make


STRAIGHT_DRIVER = """
import numpy as np

class Driver:
    def __init__(self, env): pass
    def reset(self, seed): pass
    def act(self, observation): return np.array([0.5, 0.0], np.float32)
"""
SHIFTED = "ground_truth~shift=0.3"


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A run of ten short drives that all end in an infraction: the driver never steers."""
    folder = tmp_path_factory.mktemp("report")
    module = "toy_never_steers"
    (folder / f"{module}.py").write_text(STRAIGHT_DRIVER, encoding="utf-8")
    sys.path.insert(0, str(folder))
    arguments = ["run", "--town", "Town02", "--agent", f"{module}:Driver", "--workers", "1"]
    arguments += ["--bev", "ground_truth", SHIFTED, "--out", str(folder / "run")]
    assert main(arguments) == 0
    yield folder / "run"
    sys.path.remove(str(folder))
