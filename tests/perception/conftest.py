"""A drive log to learn from, a network, and evaluations made up."""

import numpy as np
import pytest

from agents.cli import main
from perception.evaluation import Evaluation
from perception.evaluation_frames import FrameKey, View
from perception.iou_counts import IoUCounts
from perception.models.bev_unet import BEVUNetConfig
from perception.models.presets import ModelSpec
from perception.places import Places


@pytest.fixture(scope="session")
def log_folder(tmp_path_factory):
    """Three seconds each of routes 0 (validation) and 3 through dense traffic in Town02."""
    folder = tmp_path_factory.mktemp("log")
    arguments = ["--levels", "1", "--routes", "0", "3", "--time-limit", "3", "--workers", "1"]
    arguments += ["--town", "Town02", "--traffic", "dense", "--lights"]
    assert main(["collect", *arguments, "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def tiny_spec():
    """A network of a few hundred weights that sees ground and route map."""
    config = BEVUNetConfig(widths=(4, 4), encoder_blocks=(0, 0), decoder_blocks=(0,))
    return ModelSpec("bev_unet", config)


@pytest.fixture
def with_route_iou():
    """Makes evaluations of frames with a route of 100 pixels."""

    def evaluation(percent, critical):
        """So many of the route's pixels are found in each frame; -1: it has no route at all."""
        hits = np.array(percent, np.int32).reshape(-1, 1, 1, 1)
        actual = np.where(hits[..., 0] < 0, 0, 100).astype(np.int32)
        hits = np.maximum(hits, 0)
        counts = IoUCounts(np.array([[0.5]]), hits, hits, actual)
        places = Places(np.array(critical), np.array(critical))
        keys = tuple(FrameKey(0, k, 0) for k in range(len(percent)))
        return Evaluation("toy", ("route",), counts, places, keys, keys, View())

    return evaluation
