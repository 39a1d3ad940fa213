from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from benchmarks.suite_options import SuiteOptions, add_suite_arguments, suite_values


def parsed(*arguments: str) -> SuiteOptions:
    parser = argparse.ArgumentParser()
    add_suite_arguments(parser, "bc", ["ground_truth"])
    return SuiteOptions(**suite_values(parser.parse_args([*arguments, "--out", "x"])))


def test_what_is_named_twice_is_driven_once():
    options = parsed("--bev", "cvt", "unet", "cvt", "--seed", "2", "0", "2", "--town", "Town02")
    assert (options.bev, options.seed, options.town) == (("cvt", "unet"), (2, 0), ("Town02",))


def test_defaults_are_both_towns_of_the_papers_suite():
    options = parsed()
    assert options.identity == {
        "suite": "paper",
        "bev": ["ground_truth"],
        "agent": ["bc"],
        "town": ["Town01", "Town02"],
        "seed": [0],
    }
    assert options.out == Path("x")
    assert options.workers >= 1


def test_a_verb_without_a_default_source_demands_one(capsys):
    parser = argparse.ArgumentParser()
    add_suite_arguments(parser, "bc")
    with pytest.raises(SystemExit):
        parser.parse_args(["--out", "x"])
    assert "--bev" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--town", "Town01", "Town09"], "Town09"),
        (["--seed", "0", "-3"], r"--seed must be at least 0, got -3"),
        (["--workers", "0"], r"--workers must be an int of at least 1, got 0"),
    ],
)
def test_what_cannot_be_driven_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        parsed(*arguments)
