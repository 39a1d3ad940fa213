"""What is found in figures made by hand."""

import csv
import math

import numpy as np
import pytest

from benchmarks.study.findings import findings, reliability
from benchmarks.study.text import as_csv, as_markdown, conclusion
from benchmarks.study.variants import MIXTURE


@pytest.fixture
def rows(make_row):
    """Forty variants: divergence foretells driving exactly, mean IoU says nothing."""
    rng = np.random.default_rng(0)
    shares, noise = np.linspace(0.0, 1.0, 40), rng.uniform(0.4, 0.9, 40)
    return [
        make_row(k, share, MIXTURE if k % 2 else "predictor", mean_iou=iou, divergence=1.0 - share)
        for k, (share, iou) in enumerate(zip(shares.tolist(), noise.tolist(), strict=True))
    ]


def test_the_metric_that_foretells_driving_stands_first_and_beats_mean_iou(rows):
    found = findings(rows)
    first = found.standings[0]
    assert (first.metric.name, first.metres.spearman, first.metres.kendall) == (
        "divergence",
        1.0,
        1.0,
    )
    assert first.over_mean_iou.interval[0] > 0.3
    # constant metrics say nothing and are left out
    assert [each.metric.name for each in found.standings] == ["divergence", "mean_iou"]
    assert found.standing("iou_lane") is None
    own = found.standing("mean_iou").over_mean_iou
    assert (own.difference, own.interval) == (0.0, (0.0, 0.0))


def test_the_conclusion_follows_the_figures(rows, make_row):
    text = conclusion(findings(rows))
    assert "a poor proxy" in text
    assert "policy divergence, median (open loop) is better than mean IoU" in text
    good = [
        make_row(k, k / 39, mean_iou=0.3 + k / 60, divergence=float(k * 7 % 40)) for k in range(40)
    ]
    text = conclusion(findings(good))
    assert "a good proxy" in text
    assert "in 100 % of cases" in text
    assert "is worse than mean IoU" in text


def test_a_few_variants_are_not_called_good_or_poor(make_row):
    rows = [make_row(k, share, mean_iou=0.1 * k) for k, share in enumerate((0.1, 0.3, 0.5, 0.9))]
    text = conclusion(findings(rows))
    assert "too few to tell whether mean IoU is a proxy" in text
    assert " a good proxy" not in text


def test_variants_that_drive_alike_keep_any_metric_under_one(rows, make_row):
    assert findings(rows).tie_ceiling == pytest.approx(1.0)
    tied = [make_row(k, min(1.0, k / 10), mean_iou=k / 40) for k in range(40)]
    found = findings(tied)
    assert found.tie_ceiling == pytest.approx(found.standing("mean_iou").metres.spearman)
    assert found.tie_ceiling < 0.9


def test_kinds_are_looked_at_apart(rows):
    by_kind = findings(rows).by_kind
    assert by_kind["predictor"][0] == by_kind["mixture"][0] == 20
    assert by_kind["predictor"][1]["divergence"] == pytest.approx(1.0)
    assert by_kind["upper half by mean IoU"][0] == 20
    assert "checkpoint" not in by_kind
    assert math.isnan(by_kind["predictor"][1]["iou_route"])


def test_pairs_of_equal_mean_iou_are_counted_and_no_variant_is_in_more_than_two(make_row):
    shares = [1.0, 0.9, 0.1, 0.0, 0.2, 0.3]
    rows = [make_row(k, share, mean_iou=0.7) for k, share in enumerate(shares)]
    rows.append(make_row(6, 0.6, mean_iou=0.9))
    found = findings(rows)
    assert (found.equal_pairs, found.different_pairs) == (15, 8)
    best = found.pairs[0]
    assert (best.better.variant.spec, best.worse.variant.spec) == ("variant_0", "variant_3")
    assert best.gap == pytest.approx(1.0)
    specs = [row.variant.spec for pair in found.pairs for row in pair]
    assert max(specs.count(spec) for spec in specs) == 2
    assert "Of 15 pairs" in as_markdown(found, "bc", "made by hand")


def test_an_outcome_that_repeats_itself_is_reliable_and_noise_is_not():
    skill = np.linspace(0.0, 1.0, 30)
    assert reliability(np.tile(skill[:, None], 8)) == pytest.approx(1.0)
    noisy = skill[:, None] + np.random.default_rng(0).normal(0.0, 0.6, (30, 8))
    assert 0.4 < reliability(noisy) < 0.95
    assert math.isnan(reliability(skill[:, None]))


def test_the_most_that_a_metric_can_reach_is_about_right():
    """Against the correlation of the outcome with the skill behind it."""
    rng = np.random.default_rng(1)
    skill = rng.normal(size=2000)
    table = skill[:, None] + rng.normal(0.0, 2.0, (2000, 10))
    real = np.corrcoef(skill, table.mean(axis=1))[0, 1]
    assert reliability(table) == pytest.approx(real, abs=0.03)


def test_variants_that_all_drive_alike_are_an_error(make_row):
    with pytest.raises(ValueError, match=r"from 1\.00 to 1\.00: choose more variants"):
        findings([make_row(k, 1.0) for k in range(5)])
    with pytest.raises(ValueError, match="at least 3 variants"):
        findings([make_row(0, 1.0), make_row(1, 0.0)])


def test_the_csv_has_a_row_a_variant_below_its_origin(rows):
    text = as_csv(rows, {"command": "bev-bench study", "seeds": [0]})
    lines = text.splitlines()
    assert lines[:2] == ["# command: bev-bench study", "# seeds: [0]"]
    table = list(csv.DictReader(lines[2:]))
    assert len(table) == 40
    assert float(table[3]["divergence"]) == pytest.approx(rows[3].metrics["divergence"], rel=1e-5)
    assert table[1]["kind"] == "mixture"
