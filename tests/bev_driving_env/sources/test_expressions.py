"""BEV sources as text."""

import numpy as np
import pytest

from bev_driving_env import CorruptedBEV
from bev_driving_env.env import BEVTownEnv
from bev_driving_env.sources.expressions import corruption, mixture, sources_of
from bev_driving_env.sources.registry import make_bev_source


def first_bev(source, seed=3):
    with BEVTownEnv("Town02", bev_source=source) as env:
        return env.reset(seed=seed)[0]["bev"]


def test_text_and_object_see_the_same():
    text = "ground_truth~straightening=0.5,shift=0.25"
    wanted = first_bev(CorruptedBEV("ground_truth", straightening=0.5, shift=0.25))
    np.testing.assert_array_equal(first_bev(text), wanted)
    assert (wanted != first_bev("ground_truth")).any()


def test_a_mixture_takes_each_channel_from_its_source():
    mixed = first_bev("ground_truth~shift=1|route=ground_truth,lane=ground_truth~erosion=1")
    np.testing.assert_array_equal(mixed[1], first_bev("ground_truth")[1])
    np.testing.assert_array_equal(mixed[2], first_bev("ground_truth~erosion=1")[2])
    np.testing.assert_array_equal(mixed[0], first_bev("ground_truth~shift=1")[0])


def test_error_models_can_be_kept_to_some_channels():
    made = corruption("ipm~blob_dropout=0.5,ghosts=0.1@road,lane")
    assert made == ("ipm", {"blob_dropout": 0.5, "ghosts": 0.1}, ("road", "lane"))
    assert mixture("a|road=b~shift=1,ghosts=1,lane=c")["road"] == "b~shift=1,ghosts=1"


def test_all_sources_that_take_part_are_known():
    text = "cvt_kde|route=ipm~latency=0.2,lane=runs/x.safetensors"
    assert sources_of(text) == ["cvt_kde", "ipm", "runs/x.safetensors"]
    assert sources_of("ground_truth") == ["ground_truth"]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("ground_truth~shift", "SOURCE~MODEL=DOSE"),
        ("ground_truth~shift=much", "SOURCE~MODEL=DOSE"),
        ("ground_truth~shift=2", "dose from 0 to 1"),
        ("ground_truth~wobble=0.5", "wobble"),
        ("nothing~shift=0.5", "unknown bev_source 'nothing'"),
    ],
)
def test_what_cannot_be_read_is_one_clear_error(text, named):
    with pytest.raises(ValueError, match=named):
        make_bev_source(text)


def test_a_mixture_without_a_source_is_an_error():
    with pytest.raises(ValueError, match="NAME=VALUE"):
        BEVTownEnv("Town02", bev_source="ground_truth|route")
    with pytest.raises(ValueError, match="unknown channel 'rout'"):
        BEVTownEnv("Town02", bev_source="ground_truth|rout=ipm")
