from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

import benchmarks.drive
from benchmarks import driving_score
from benchmarks.driving_score import (
    FACTORS,
    WEIGHTS,
    WITHOUT_FACTOR,
    count_infractions,
    infraction_penalty,
)
from bev_driving_env.world.infractions import INFRACTIONS

CASES = [
    # route, infractions, outside, 1.0 (and 2.0), 2.1; by hand
    (1.0, {}, 0.0, 100.0, 100.0),
    (0.0, {"red_light": 3}, 0.0, 0.0, 0.0),
    (1.0, {"collision_pedestrian": 1}, 0.0, 50.0, 50.0),
    (1.0, {"collision_vehicle": 1}, 0.0, 60.0, 58.8235294),
    (1.0, {"collision_static": 1}, 0.0, 65.0, 62.5),
    (1.0, {"red_light": 1}, 0.0, 70.0, 71.4285714),
    (1.0, {"collision_pedestrian": 2}, 0.0, 25.0, 33.3333333),
    (0.5, {"collision_vehicle": 1, "red_light": 2}, 0.0, 14.7, 20.0),
    (0.8, {"collision_static": 1, "collision_pedestrian": 1}, 0.25, 19.5, 23.0769231),
    (1.0, {"off_road": 4, "wrong_lane": 2}, 0.1, 90.0, 90.0),
    (0.3, {"route_deviation": 1, "blocked": 1}, 0.0, 30.0, 30.0),
    (0.9, {"red_light": 0}, 1.0, 0.0, 0.0),
]


@pytest.mark.parametrize(("route", "infractions", "outside", "old", "new"), CASES)
def test_each_version_gives_what_its_formula_gives_by_hand(route, infractions, outside, old, new):
    assert driving_score(route, infractions, "1.0", outside) == pytest.approx(old)
    assert driving_score(route, infractions, "2.0", outside) == pytest.approx(old)
    assert driving_score(route, infractions, "2.1", outside) == pytest.approx(new)


def test_version_2_1_is_the_default():
    assert driving_score(1.0, ["collision_static"]) == pytest.approx(62.5)


@dataclass(frozen=True)
class Event:
    name: str
    fault: str = ""


@pytest.mark.parametrize(
    "infractions",
    [
        {"red_light": 2, "blocked": 1},
        {"red_light": np.int64(2), "blocked": 1},
        ["red_light", "blocked", "red_light"],
        iter(("red_light", "red_light", "blocked")),
        [{"name": "red_light"}, {"name": "red_light", "fault": "ego"}, {"name": "blocked"}],
        [Event("red_light"), Event("red_light", "ego"), Event("blocked")],
    ],
)
def test_counts_names_and_events_mean_the_same(infractions):
    counts = count_infractions(infractions)
    assert {name: count for name, count in counts.items() if count} == {
        "red_light": 2,
        "blocked": 1,
    }


def test_what_was_the_fault_of_others_does_not_count():
    hit = {"name": "collision_vehicle", "fault": "other"}
    assert driving_score(1.0, [hit, Event("collision_pedestrian", "other")]) == 100.0
    assert driving_score(1.0, [hit, {**hit, "fault": "ego"}], "1.0") == pytest.approx(60.0)
    assert driving_score(1.0, [{**hit, "fault": ""}], "1.0") == pytest.approx(60.0)


def test_the_penalty_is_the_score_of_a_whole_route():
    infractions = {"red_light": 1, "collision_static": 1}
    for version in ("1.0", "2.0", "2.1"):
        penalty = infraction_penalty(infractions, version, 0.2)
        assert driving_score(1.0, infractions, version, 0.2) == pytest.approx(100.0 * penalty)


def test_every_infraction_of_the_environment_is_known_and_no_other():
    assert set(count_infractions(())) == set(INFRACTIONS)
    assert set(FACTORS) == set(WEIGHTS)
    assert not set(FACTORS) & set(WITHOUT_FACTOR)


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ((1.0, ["stop_sign"]), ["'stop_sign'", "red_light", "blocked"]),
        ((1.0, {"name": "red_light"}), ["'name'", "red_light"]),
        ((1.0, "red_light"), ["'red_light'", "list"]),
        ((1.0, [{"fault": "ego"}]), ["None", "red_light"]),
        ((1.0, [7]), ["7", "red_light"]),
        ((1.0, [Event("red_light", "theirs")]), ["'theirs'", "other"]),
        ((1.0, {"red_light": -1}), ["red_light", "-1"]),
        ((1.0, {"red_light": 0.5}), ["red_light", "0.5"]),
        ((1.0, {}, "2.2"), ["'2.2'", "1.0", "2.0", "2.1"]),
        ((1.0, {}, 2.1), ["2.1"]),
        ((1.01, {}), ["route_fraction", "1.01"]),
        ((-0.1, {}), ["route_fraction", "-0.1"]),
        ((float("nan"), {}), ["route_fraction", "nan"]),
        ((1.0, {}, "2.1", 1.5), ["outside_fraction", "1.5"]),
    ],
)
def test_what_is_not_valid_is_named_with_what_is(arguments, names):
    with pytest.raises(ValueError, match=r".") as caught:
        driving_score(*arguments)
    assert all(name in str(caught.value) for name in names)


def test_the_packages_name_stays_a_function_whatever_else_is_imported():
    assert callable(benchmarks.driving_score)
    assert benchmarks.drive.driving_score is benchmarks.driving_score


def test_importing_the_package_loads_nothing_heavy():
    code = (
        "import sys, benchmarks; "
        "print(sorted({'numpy', 'cv2', 'numba', 'gymnasium', 'bev_driving_env'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
