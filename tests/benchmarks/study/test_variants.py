"""The list of variants."""

from collections import Counter

import numpy as np
import pytest

from benchmarks.study.variants import (
    CHECKPOINT,
    ERRONEOUS_TRUTH,
    KINDS,
    MIXTURE,
    Variant,
    check_variant,
    chosen_variants,
    default_variants,
    remembered_frames,
)
from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.sources.corrupted import CORRUPTIONS
from bev_driving_env.sources.expressions import corruption, mixture, sources_of
from bev_driving_env.sources.policy_view import PolicyView
from bev_driving_env.sources.registry import bev_source_names

DEFAULT = default_variants()


def test_there_are_over_a_hundred_and_each_is_there_once():
    assert len(DEFAULT) >= 100
    assert len({variant.spec for variant in DEFAULT}) == len(DEFAULT)


def test_no_kind_outweighs_all_others():
    counts = Counter(variant.kind for variant in DEFAULT)
    assert set(counts) == set(KINDS) - {CHECKPOINT}
    assert max(counts.values()) < 0.6 * len(DEFAULT)
    assert min(counts.values()) >= 10


def test_all_name_sources_that_come_with_the_package():
    known = set(bev_source_names())
    for variant in DEFAULT:
        assert set(sources_of(variant.spec)) <= known


def test_every_error_model_is_there_with_several_doses():
    parts = [corruption(v.spec) for v in DEFAULT if v.kind == ERRONEOUS_TRUTH]
    for model in CORRUPTIONS:
        doses = {part.doses[model] for part in parts if model in part.doses}
        assert len(doses) >= 2, model


def test_mixtures_replace_each_channel_both_ways():
    mixed = [mixture(v.spec) for v in DEFAULT if v.kind == MIXTURE]
    for channel in CHANNELS[:3]:
        assert any(m.get(channel) == "ground_truth" for m in mixed)
        assert any(m["default"] == "ground_truth" and channel in m for m in mixed)


@pytest.mark.parametrize("spec", [v.spec for v in DEFAULT if v.kind == ERRONEOUS_TRUTH])
def test_errors_change_the_channels_that_they_name_and_no_others(spec):
    truth = np.zeros((6, 192, 192), np.uint8)
    # a road, a route that bends to the right, and a lane line
    truth[0, :, 60:140] = 255
    truth[1, 60:152, 90:103] = truth[1, 60:73, 90:180] = 255
    truth[2, :, 60:62] = 255
    view = PolicyView(spec, 1, BEVGeometry())
    frames = [np.roll(truth, 4 * k, axis=(1, 2)) for k in range(remembered_frames(spec) + 1)]
    named = corruption(spec).channels
    assert named is not None
    changed = set()
    # by chance a frame may be spared: look at several episodes
    for seed in range(64):
        view.reset(0, seed)
        for frame in frames:
            seen = view.observe([0], pytest.fail, frame[None])[0]
        changed |= {CHANNELS[k] for k in np.flatnonzero((seen != frames[-1]).any(axis=(1, 2)))}
        if seed >= 3 and changed == set(named):
            break
    assert changed == set(named)


def test_patterns_choose_and_checkpoints_are_added_once():
    chosen = chosen_variants(["blind", "ground_truth~shift=*@route"], ["mine.pt2", "mine.pt2"])
    specs = [variant.spec for variant in chosen]
    assert specs[0] == "blind"
    assert chosen[-1] == Variant("mine.pt2", CHECKPOINT)
    assert len(specs) == len(set(specs)) == 4
    assert chosen_variants() == DEFAULT
    assert chosen_variants([], ["blind"]) == DEFAULT


def test_a_pattern_that_matches_nothing_is_an_error():
    with pytest.raises(ValueError, match="'cvt_kd' matches none of the"):
        chosen_variants(["ground_truth", "cvt_kd"])


def test_a_variant_that_cannot_be_made_is_an_error():
    with pytest.raises(ValueError, match="no such file"):
        check_variant(Variant("nowhere/predictor.safetensors", CHECKPOINT))
    with pytest.raises(ValueError, match="kind must be one of"):
        Variant("blind", "other")


def test_latency_says_how_many_frames_are_remembered():
    assert remembered_frames("ground_truth~latency=0.6,shift=0.1@route") == 6
    assert remembered_frames("ground_truth~shift=0.1") == 0
    assert remembered_frames("blind~latency=0.2|route=ground_truth~latency=1") == 10
