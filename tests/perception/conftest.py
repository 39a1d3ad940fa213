"""A drive log to learn from."""

import pytest

from agents.cli import main
from perception.models.bev_unet import BEVUNetConfig
from perception.models.presets import ModelSpec


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
