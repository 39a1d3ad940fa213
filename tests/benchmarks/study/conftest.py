"""Variants with figures made by hand, and short drives of the expert."""

from collections.abc import Callable

import pytest

from benchmarks.study.driving import Driving
from benchmarks.study.findings import Row
from benchmarks.study.frames import Frames, collect_logs
from benchmarks.study.metrics import METRICS
from benchmarks.study.variants import ERRONEOUS_TRUTH, Variant


@pytest.fixture(scope="session")
def frames(tmp_path_factory) -> Frames:
    """Twelve frames of three drives of four seconds."""
    folder = tmp_path_factory.mktemp("drive_logs")
    folders = collect_logs(folder, ["Town02"], 0, 1, time_limit_s=4.0)
    return Frames(tuple(folders), 12, 0)


@pytest.fixture
def make_row() -> Callable[..., Row]:
    """A variant with a share of clean metres; all metrics that are not given are 0.5."""

    def make(number: int, share: float, kind: str = ERRONEOUS_TRUTH, **metrics: float) -> Row:
        driving = Driving(share, share, (share, share), 0, {})
        values = dict.fromkeys((metric.name for metric in METRICS), 0.5)
        return Row(Variant(f"variant_{number}", kind), driving, {**values, **metrics})

    return make
